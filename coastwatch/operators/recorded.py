"""A scenario made from recorded files and a line about each sensor, for `coastwatch fuse`."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from coastwatch.geodesy import NAUTICAL_MILE_M, scale_m_deg, wrap_deg
from coastwatch.operators.bad_input import BadInput
from coastwatch.scenario import Area, Scenario
from coastwatch.sensors.ais_table import AisColumns
from coastwatch.sensors.tables import BearingColumns, PlotColumns

LOOK_BYTES = 65_536
SENTENCE = re.compile(rb"[!$][A-Z]{2}VD[MO],")
COLUMNS: dict[str, type[BaseModel]] = {"ais": AisColumns, "plots": PlotColumns, "bearings": BearingColumns}
SETTING = {"ais": "ais_columns", "plots": "plot_columns", "bearings": "bearing_columns"}
MARGIN = 1.1
SMALLEST_NM = 1.0
HIGHEST_LATITUDE_DEG = 84.0
OUTLIERS_PERCENT = 1.0  # of positions may lie outside the frame: one bad fix must not shrink a coast to a point


@dataclass(frozen=True)
class Files:
    """What was recorded. columns: our name of a column, "mmsi" or "plots.time", to the name in the file."""

    ais: tuple[str, ...]
    plots: str | None
    bearings: str | None
    columns: Mapping[str, str]


def document(files: Files, sensors: Mapping[str, list[dict[str, Any]]], period_s: float) -> dict[str, Any]:
    """What a scenario file would say. Raises: BadInput, OSError."""
    sentences = {name: is_nmea(name) for name in files.ais}
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
    """A name of its own for each set of files, so that --restart and --resume touch no other recording's run."""
    digest = zlib.crc32("\n".join(str(Path(name).resolve()) for name in files).encode())
    return f"fuse-{re.sub(r'[^A-Za-z0-9_]+', '-', Path(files[0]).name)[:16].strip('-')}-{digest:08x}"


def is_nmea(name: str) -> bool:
    """Whether a file, packed or not, holds AIS sentences near its beginning. Raises: OSError."""
    with open(name, "rb") as file:
        head = file.read(LOOK_BYTES)
    if head[:2] == b"\x1f\x8b":
        with gzip.open(name, "rb") as file:
            head = file.read(LOOK_BYTES)
    return SENTENCE.search(head) is not None


def _columns(wanted: Mapping[str, str], parts: list[str]) -> dict[str, dict[str, str]]:
    """The settings of columns: a name without a part goes to every table that knows it."""
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
    """The scenario with an area that holds what its sensors cover, or without any, what AIS said."""
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
