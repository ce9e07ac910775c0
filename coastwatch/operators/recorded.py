"""The scenario of `coastwatch fuse`: made from recorded files and the options that describe the sensors."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from coastwatch.geodesy import NAUTICAL_MILE_M, scale_m_deg, wrap_deg
from coastwatch.operators.bad_input import BadInput
from coastwatch.scenario import Area, Scenario
from coastwatch.scenario.sites import Radar, Sonar, Station
from coastwatch.sensors.recorded.ais_table import AisColumns
from coastwatch.sensors.recorded.tables import BearingColumns, PlotColumns

LOOK_BYTES = 65_536
SENTENCE = re.compile(rb"[!$][A-Z]{2}VD[MO],")
GZIP_MAGIC, PARQUET_MAGIC = b"\x1f\x8b", b"PAR1"
NEVER_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
BINARY_SHARE = 0.02  # random bytes have 11 %; one bad cell does not make a table binary
COLUMNS: dict[str, type[BaseModel]] = {"ais": AisColumns, "plots": PlotColumns, "bearings": BearingColumns}
SETTING = {"ais": "ais_columns", "plots": "plot_columns", "bearings": "bearing_columns"}
MARGIN = 1.1
SMALLEST_NM = 1.0
HIGHEST_LATITUDE_DEG = 84.0
OUTLIERS_PERCENT = 1.0  # of the positions may be outside the area, so that one bad fix does not enlarge it


@dataclass(frozen=True)
class Files:
    """The recorded files. columns: our name of a column, "mmsi" or "plots.time", to the name in the file."""

    ais: tuple[str, ...]
    plots: str | None
    bearings: str | None
    columns: Mapping[str, str]


def document(files: Files, sensors: Mapping[str, list[dict[str, Any]]], period_s: float) -> dict[str, Any]:
    """The scenario as a document, as parsed from TOML. Raises: BadInput, OSError."""
    sentences = {name: is_nmea(name) for name in files.ais}
    for name in (*(name for name, so in sentences.items() if not so), files.plots, files.bearings):
        if name is not None:
            _check_table(name, "neither NMEA 0183 nor a table" if name in sentences else "no table")
    given: dict[str, list[str]] = {
        "nmea": [name for name, so in sentences.items() if so],
        "ais": [name for name, so in sentences.items() if not so],
        "plots": [files.plots] if files.plots else [],
        "bearings": [files.bearings] if files.bearings else [],
    }
    names = [Path(name).name for part in given.values() for name in part]
    return {
        "name": _name([name for part in given.values() for name in part]),
        "title": "Recorded: " + ", ".join(names),
        "period_s": period_s,
        "cycles": 0,
        "warmup_s": 0.0,
        "area": {"latitude_deg": 0.0, "longitude_deg": 0.0},
        **sensors,
        "input": {"method": "tables", **given, **_columns(files.columns, [part for part in COLUMNS if given[part]])},
    }


def _name(files: list[str]) -> str:
    """A name that is unique to a set of files, so that --restart and --resume affect no other run."""
    digest = zlib.crc32("\n".join(str(Path(name).resolve()) for name in files).encode())
    return f"fuse-{re.sub(r'[^A-Za-z0-9_]+', '-', Path(files[0]).name)[:16].strip('-')}-{digest:08x}"


def is_nmea(name: str) -> bool:
    """Whether a file, compressed or not, starts with AIS sentences. Raises: OSError."""
    return SENTENCE.search(_head(name)) is not None


def _head(name: str) -> bytes:
    """The first bytes of a file, decompressed if needed. Raises: BadInput for gzip that cannot be decompressed; OSError."""
    with open(name, "rb") as file:
        head = file.read(LOOK_BYTES)
    if not head.startswith(GZIP_MAGIC):
        return head
    try:
        return zlib.decompressobj(wbits=31).decompress(head, LOOK_BYTES)
    except zlib.error as error:
        raise BadInput(f"{name}: got gzip that cannot be decompressed ({error}), needed text, gzip or Parquet") from error


def _check_table(name: str, what: str) -> None:
    """Refuses a file that cannot be a table. The reader of tables reports errors inside one."""
    head = _head(name)
    if Path(name).suffix == ".parquet":
        got = "" if head.startswith(PARQUET_MAGIC) else "bytes that are not Parquet"
    elif not head.strip():
        got = "an empty file"
    else:
        got = "bytes that are not text" if len(NEVER_TEXT.findall(head)) > BINARY_SHARE * len(head) else ""
    if got:
        raise BadInput(f"{name}: {what}: got {got}, needed {'NMEA lines, ' if 'NMEA' in what else ''}CSV or Parquet")


def check_sensors(radars: list[dict[str, Any]], stations: list[dict[str, Any]], sonars: list[dict[str, Any]]) -> None:
    """Refuses wrong values of --radar, --station and --sonar. Raises: BadInput that names the option."""
    kinds: tuple[tuple[str, type[BaseModel], list[dict[str, Any]]], ...] = (
        ("--radar", Radar, radars),
        ("--station", Station, stations),
        ("--sonar", Sonar, sonars),
    )
    for option, model, given in kinds:
        names = [sensor["name"] for sensor in given]
        for sensor in given:
            if names.count(sensor["name"]) > 1:
                raise BadInput(f"{option}: got the name {sensor['name']!r} {names.count(sensor['name'])} times, needed it once")
            try:
                model.model_validate(sensor)
            except ValidationError as error:
                wrong = "; ".join(f"{e['loc'][0]}: got {e['input']!r}: {e['msg']}" for e in error.errors())
                raise BadInput(f"{option} {sensor['name']}: {wrong}") from error


def _columns(wanted: Mapping[str, str], parts: list[str]) -> dict[str, dict[str, str]]:
    """The settings of columns. A name without a prefix applies to every table that has such a column."""
    out: dict[str, dict[str, str]] = {}
    for ours, yours in wanted.items():
        part, _, key = ours.rpartition(".")
        takers = [p for p in parts if part in ("", p) and key in COLUMNS[p].model_fields]
        if not takers:
            known = "; ".join(f"{p}: {', '.join(COLUMNS[p].model_fields)}" for p in parts) or "none, NMEA has no columns"
            raise BadInput(f"--columns: got {ours!r}, needed one of {known}")
        for p in takers:
            out.setdefault(SETTING[p], {})[key] = yours
    return out


def framed(scenario: Scenario) -> Scenario:
    """The scenario with an area around the coverage of its sensors, or without sensors around the AIS positions."""
    sensors: list[Any] = [*scenario.radars, *scenario.stations, *scenario.sonars]
    if sensors:
        site = np.array([[s.latitude_deg, s.longitude_deg] for s in sensors])
        reach_m = np.array([s.range_nm for s in sensors]) * NAUTICAL_MILE_M
    else:
        site = scenario.input.load(scenario.sensors(), scenario.seed, scenario.plan()).reports.ais.position_deg
        reach_m = np.zeros(len(site))
    return scenario.model_copy(update={"area": _around(site, reach_m)}) if len(site) else scenario


def _around(site_deg: Any, reach_m: Any) -> Area:
    """The area around discs."""
    north_m, east_m = scale_m_deg(site_deg[:, 0])
    lat, lon = site_deg[:, 0], site_deg[0, 1] + wrap_deg(site_deg[:, 1] - site_deg[0, 1])
    edges = []
    for value, reach in ((lat, reach_m / north_m), (lon, reach_m / east_m)):
        cut = OUTLIERS_PERCENT if not reach_m.any() else 0.0
        edges.append((np.percentile(value - reach, cut), np.percentile(value + reach, 100.0 - cut)))
    (south, north), (west, east) = edges
    centre = float(np.clip(0.5 * (south + north), -HIGHEST_LATITUDE_DEG, HIGHEST_LATITUDE_DEG))
    scale_north, scale_east = (float(s) / NAUTICAL_MILE_M for s in scale_m_deg(np.array(centre)))
    return Area(
        latitude_deg=centre,
        longitude_deg=float(wrap_deg(0.5 * (west + east))),
        width_nm=max(MARGIN * float(east - west) * scale_east, SMALLEST_NM),
        height_nm=max(MARGIN * float(north - south) * scale_north, SMALLEST_NM),
    )
