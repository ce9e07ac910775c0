"""The scenario of `coastwatch fuse`: made from recorded files and the options that describe the sensors."""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, unquote

import numpy as np
from pydantic import BaseModel, ValidationError

from coastwatch.batches import Floats
from coastwatch.errors import InputError
from coastwatch.formats.registry import FORMATS
from coastwatch.geodesy import NAUTICAL_MILE_M, scale_m_deg, wrap_deg
from coastwatch.scenario import Area, Scenario
from coastwatch.scenario.reading import typed_value
from coastwatch.scenario.refusing import refusals
from coastwatch.scenario.sites import Radar, Sonar, Station
from coastwatch.sensors.recorded.files import has_sentences
from coastwatch.sensors.recorded.tables.feed import Tables
from coastwatch.sensors.recorded.tables.rows import SETTING
from coastwatch.sensors.recorded.video.haxr import HaxrFile
from coastwatch.sensors.recorded.video.pictures import Pictures
from coastwatch.sensors.recorded.wire.stream import WireFile
from coastwatch.spelling import did_you_mean

COLUMNS = {part: type(Tables.model_fields[setting].default) for part, setting in SETTING.items()}
"""Settings of the names of columns, by kind of table."""

MARGIN = 1.1
SMALLEST_NM = 1.0
HIGHEST_LATITUDE_DEG = 84.0
STORE = {"picture_large": 0, "picture_every_s": 60.0, "checkpoint_every": 30}
"""Files are fused faster than anybody reads: the current picture is written each minute of the recording, the history every cycle."""
OUTLIERS_PERCENT = 1.0  # of the positions may be outside the area, so that one bad fix does not enlarge it


HDF5 = b"\x89HDF"
TABLES = (".csv", ".tsv", ".parquet")
SCREENS: dict[str, tuple[type[BaseModel], str]] = {"pictures": (Pictures, "table"), "haxr": (HaxrFile, "file")}
"""Files of video that are no wire format: the settings of each, and which of them is the file."""

SCREEN_EXAMPLES = {
    "pictures": "pictures+file:turns.csv?pixel_m=10&head_up=true",
    "haxr": "haxr+file:port.hdf5?day=2025-06-01",
}

Site = Mapping[str, str | float]
"""The settings of a sensor: its name, and numbers."""


@dataclass(frozen=True)
class ScreenFile:
    """A table of pictures of a radar's screen, or an HDF5 file of HAXR. `text` is how it was given."""

    text: str
    kind: str  # of SCREENS
    path: Path
    options: Mapping[str, str]

    def settings(self) -> dict[str, object]:
        """Its settings in a document. Raises: InputError: they are none of its kind."""
        model, key = SCREENS[self.kind]
        values: dict[str, object] = {name: typed_value(value) for name, value in self.options.items()} | {key: self.path}
        try:
            model.model_validate(values)
        except ValidationError as error:
            example = SCREEN_EXAMPLES[self.kind]
            said = "; ".join(refusals(error, model))
            raise InputError(f"--video {self.text}: {said}; settings stand behind '?', as in {example}") from error
        return values


def screen_file(text: str) -> ScreenFile | None:
    """The file of pictures+file:turns.csv?pixel_m=10 or haxr+file:port.hdf5?day=2025-06-01, or of the same without the format, by its
    content or name; None: it is another. Raises: OSError.
    """
    scheme, divided, rest = text.partition("+file:")
    place, _, query = (rest if divided else text).partition("?")
    path = Path(unquote(place))
    if divided:
        kind = scheme if scheme in SCREENS else None
    elif path.suffix.lower() in TABLES:
        kind = "pictures"
    else:
        with path.open("rb") as file:
            kind = "haxr" if file.read(len(HDF5)) == HDF5 else None
    return None if kind is None else ScreenFile(text, kind, path, dict(parse_qsl(query)))


@dataclass(frozen=True)
class Files:
    """The recorded files. columns: our name of a column, "mmsi" or "plots.time", to the name in the file."""

    ais: tuple[str, ...]
    plots: str | None
    bearings: str | None
    tracks: tuple[str, ...]
    columns: Mapping[str, str]
    feeds: tuple[WireFile, ...] = ()
    screens: tuple[ScreenFile, ...] = ()

    @property
    def default_period_s(self) -> float:
        """Seconds of a cycle: about a turn of a radar; of AIS alone the slowest report of a class A vessel under way."""
        of_ais = all(FORMATS[feed.format].numbered for feed in self.feeds)
        return 3.0 if self.plots or self.bearings or self.tracks or self.screens or not of_ais else 10.0


def document(files: Files, sensors: Mapping[str, Sequence[Site]], period_s: float) -> dict[str, object]:
    """The scenario as a document, as parsed from TOML. Raises: InputError, OSError."""
    ais, tracks = (
        {name: has_sentences(Path(name), option) for name in names}
        for option, names in (("ais", files.ais), ("tracks", files.tracks))
    )
    parts: dict[str, list[str]] = {
        "nmea": [name for name, so in ais.items() if so],
        "ais": [name for name, so in ais.items() if not so],
        "plots": [files.plots] if files.plots else [],
        "bearings": [files.bearings] if files.bearings else [],
        "tracks": [name for name, so in tracks.items() if not so],
        "track_sentences": [name for name, so in tracks.items() if so],
    }
    paths = [name for part in parts.values() for name in part] + [str(feed.path) for feed in files.feeds]
    paths += [str(file.path) for file in files.screens]
    screens = {kind: [file.settings() for file in files.screens if file.kind == kind] for kind in SCREENS}
    is_cleaned = bool(screens["haxr"]) and not screens["pictures"] and not any(feed.format == "video" for feed in files.feeds)
    parts["feeds"] = [feed.text for feed in files.feeds]
    # The name is unique to the set of files, so that --restart and --resume affect no other run.
    stem = re.sub(r"[^A-Za-z0-9_]+", "-", Path(paths[0]).name)[:16].strip("-")
    digest = zlib.crc32("\n".join(str(Path(name).resolve()) for name in paths).encode())
    return {
        "name": f"fuse-{stem}-{digest:08x}",
        "title": "Recorded: " + ", ".join(Path(path).name for path in paths),
        "period_s": period_s,
        "cycles": 0,
        "warmup_s": 0.0,
        "area": {"latitude_deg": 0.0, "longitude_deg": 0.0},
        **sensors,
        "store": STORE,
        **({"extraction": {"method": "absolute"}} if is_cleaned else {}),
        "input": {"method": "tables", **parts, **screens, **_columns(files.columns, [part for part in COLUMNS if parts[part]])},
    }


def track_sources(files: Files, site: tuple[float, float] | None, taken: Collection[str] = ()) -> list[Site]:
    """The track sources of files, each with a name made of its file's, then those of feeds. Files with NMEA come last, as in `document`.

    Args: site: of all; taken: names of sonars.
    """
    ordered = sorted(files.tracks, key=lambda name: has_sentences(Path(name), "tracks"))
    stems = [re.sub(r"[^A-Za-z0-9_]+", "-", Path(name).name.split(".")[0])[:24] or "tracks" for name in ordered]
    stems = [f"{stem}-tracks" if stem in ("ais", *taken) else stem for stem in stems]
    names = [stem if stems.count(stem) == 1 else f"{stem}-{k}" for k, stem in enumerate(stems, 1)]
    place: dict[str, str | float] = {} if site is None else {"latitude_deg": site[0], "longitude_deg": site[1]}
    names += dict.fromkeys(feed.source for feed in files.feeds if feed.source is not None)
    return [{"name": name, **place} for name in names]


def check_sensors(radars: Sequence[Site], stations: Sequence[Site], sonars: Sequence[Site]) -> None:
    """Refuses wrong values of --radar, --station and --sonar. Raises: InputError that names the option."""
    kinds: tuple[tuple[str, type[BaseModel], Sequence[Site]], ...] = (
        ("--radar", Radar, radars),
        ("--station", Station, stations),
        ("--sonar", Sonar, sonars),
    )
    for option, model, sites in kinds:
        names = [sensor["name"] for sensor in sites]
        for sensor in sites:
            if names.count(sensor["name"]) > 1:
                raise InputError(
                    f"{option}: got the name {sensor['name']!r} {names.count(sensor['name'])} times, needed it once"
                )
            try:
                model.model_validate(sensor)
            except ValidationError as error:
                raise InputError(f"{option} {sensor['name']}: {'; '.join(refusals(error, model))}") from error


def _columns(wanted: Mapping[str, str], parts: list[str]) -> dict[str, dict[str, str]]:
    """The settings of columns. A name without a prefix applies to every table that has such a column."""
    settings: dict[str, dict[str, str]] = {}
    for ours, yours in wanted.items():
        part, _, key = ours.rpartition(".")
        takers = [p for p in parts if part in ("", p) and key in COLUMNS[p].model_fields]
        if not takers:
            columns = "; ".join(f"{p}: {', '.join(COLUMNS[p].model_fields)}" for p in parts) or "none, NMEA has no columns"
            names = [name for p in parts for field in COLUMNS[p].model_fields for name in (field, f"{p}.{field}")]
            raise InputError(f"--columns: got {ours!r}, needed one of {columns}{did_you_mean(ours, names)}")
        for p in takers:
            settings.setdefault(SETTING[p], {})[key] = yours
    return settings


def framed(scenario: Scenario) -> Scenario:
    """The scenario with an area around the coverage of its sensors, or without sensors around the AIS positions."""
    sensors = scenario.sensors()
    kinds = (sensors.radars, sensors.stations, sensors.sonars)
    if any(map(len, kinds)):
        site = np.concatenate([sensor.site_deg for sensor in kinds])
        reach_m = np.concatenate([sensor.range_m for sensor in kinds])
    else:
        site = scenario.input.first_positions() if isinstance(scenario.input, Tables) else np.zeros((0, 2))
        reach_m = np.zeros(len(site))
    return scenario.model_copy(update={"area": _around(site, reach_m)}) if len(site) else scenario


def _around(site_deg: Floats, reach_m: Floats) -> Area:
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
