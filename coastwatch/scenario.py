"""One TOML file to one frozen, validated Scenario."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AwareDatetime, Field, ValidationError, model_validator

from coastwatch.associations import Associator, BearingAssociator, BearingLikelihood, WindowedCovariance
from coastwatch.batches import Radars, Sensors, Sonars, Stations
from coastwatch.fused_tracks import CovarianceIntersection, Fuser
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.picture import Identity
from coastwatch.plots import PlotConverter, PolarConversion
from coastwatch.sensors import Feed
from coastwatch.shipped import scenarios_folder
from coastwatch.spots import KMeansSpots, OctantGrouper, OctantSpots, SpotGrouper
from coastwatch.stage import Method, Plan, Settings
from coastwatch.tracks import AisFilter, AisTracker, BearingTracker, BearingWindow, Imm, RadarTracker

Latitude = Annotated[float, Field(gt=-85.0, lt=85.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]
Positive = Annotated[float, Field(gt=0.0)]
Name = Annotated[str, Field(min_length=1, max_length=32)]


class ScenarioError(Exception):
    """A scenario cannot be read; the message names the file, the key, what it got and what it needed."""


class Area(Settings):
    """The rectangle that is plotted."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    width_nm: Positive = 10.0
    height_nm: Positive = 10.0


class Radar(Settings):
    """A radar by its specification."""

    name: Name
    region: Name = "region"
    latitude_deg: Latitude
    longitude_deg: Longitude
    range_nm: Positive
    rpm: Positive
    range_noise_m: Positive = 10.0
    azimuth_noise_deg: Positive = 0.3


class Station(Settings):
    """An AIS receiver: inside its range AIS would be heard."""

    name: Name
    latitude_deg: Latitude
    longitude_deg: Longitude
    range_nm: Positive


class Sonar(Settings):
    """A sensor that gives bearings: a passive sonar, a camera, a direction finder."""

    name: Name
    latitude_deg: Latitude
    longitude_deg: Longitude
    range_nm: Positive
    bearing_noise_deg: Positive = 1.0
    interval_s: Positive = 3.0
    arc_from_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0
    arc_to_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 360.0


class StoreSettings(Settings):
    """What is kept of a run."""

    history_every: Annotated[int, Field(ge=1)] = 1  # cycles
    associations_every: Annotated[int, Field(ge=1)] = 1  # cycles
    checkpoint_every: Annotated[int, Field(ge=1)] = 10  # cycles


class WorkerSettings(Settings):
    """How per-spot work is spread; the picture is the same for all."""

    count: Annotated[int, Field(ge=1, le=256)] = 1  # 1: in this process


class Scenario(Settings):
    """Everything that decides a run but the seed."""

    name: Name
    title: str
    seed: Annotated[int, Field(ge=0)] = 1
    start_utc: AwareDatetime | None = None  # none: where the recording begins
    period_s: Positive = 3.0
    cycles: Annotated[int, Field(ge=0)] = 40  # scored; 0: to the end of the recording
    warmup_s: Annotated[float, Field(ge=0.0)] = 60.0  # before the first scored cycle
    area: Area
    radars: tuple[Radar, ...] = ()
    stations: tuple[Station, ...] = ()
    sonars: tuple[Sonar, ...] = ()
    input: Feed
    plots: PlotConverter = PolarConversion()
    tracks: RadarTracker = Imm()
    ais_tracks: AisTracker = AisFilter()
    bearing_tracks: BearingTracker = BearingWindow()
    spots: SpotGrouper = KMeansSpots()
    octants: OctantGrouper = OctantSpots()
    associations: Associator = WindowedCovariance()
    bearing_associations: BearingAssociator = BearingLikelihood()
    fused_tracks: Fuser = CovarianceIntersection()
    picture: Identity = Identity()
    store: StoreSettings = StoreSettings()
    workers: WorkerSettings = WorkerSettings()

    @model_validator(mode="before")
    @classmethod
    def _default_method_where_none_is_named(cls, data: Any) -> Any:
        """So that a setting of the default method of a stage can be changed without naming the method."""
        if not isinstance(data, dict):
            return data
        out = dict(data)
        for name, field in cls.model_fields.items():
            if isinstance(field.default, Method) and isinstance(out.get(name), dict):
                out[name] = {"method": field.default.model_dump()["method"], **out[name]}
        return out

    @model_validator(mode="after")
    def _names_are_unique(self) -> Scenario:
        for kind in ("radars", "stations", "sonars"):
            names = [s.name for s in getattr(self, kind)]
            if len(set(names)) < len(names):
                raise ValueError(f"{kind}: got names {names}, needed each once")
        return self

    @model_validator(mode="after")
    def _halo_covers_the_gate(self) -> Scenario:
        if self.spots.halo_m < self.associations.gate_m:
            raise ValueError(
                f"spots.halo_m: got {self.spots.halo_m}, needed at least associations.gate_m = {self.associations.gate_m}, "
                "or pairs across the border of two spots are lost"
            )
        return self

    def sensors(self) -> Sensors:
        """The sensors as arrays; regions are numbered in order of first mention, their planes touch at the mean of their radars."""
        regions = list(dict.fromkeys(r.region for r in self.radars))
        sites = np.array([[r.latitude_deg, r.longitude_deg] for r in self.radars]).reshape(-1, 2)
        number = np.array([regions.index(r.region) for r in self.radars], np.int64)
        origins = [_mean_place(sites[number == k]) for k in range(len(regions))]
        return Sensors(
            radars=self._radars(number, sites),
            stations=Stations(
                name=_names(self.stations),
                site_deg=_sites(self.stations),
                range_m=_column(self.stations, "range_nm") * NAUTICAL_MILE_M,
            ),
            sonars=self._sonars(),
            region_names=tuple(regions),
            region_origin_deg=np.array(origins).reshape(-1, 2),
        )

    def _radars(self, region: Any, sites: Any) -> Radars:
        return Radars(
            name=_names(self.radars),
            region=region,
            site_deg=sites,
            range_m=_column(self.radars, "range_nm") * NAUTICAL_MILE_M,
            period_s=60.0 / _column(self.radars, "rpm"),
            range_sigma_m=_column(self.radars, "range_noise_m"),
            azimuth_sigma_rad=np.radians(_column(self.radars, "azimuth_noise_deg")),
        )

    def _sonars(self) -> Sonars:
        return Sonars(
            name=_names(self.sonars),
            site_deg=_sites(self.sonars),
            range_m=_column(self.sonars, "range_nm") * NAUTICAL_MILE_M,
            bearing_sigma_rad=np.radians(_column(self.sonars, "bearing_noise_deg")),
            interval_s=_column(self.sonars, "interval_s"),
            arc_from_deg=_column(self.sonars, "arc_from_deg"),
            arc_to_deg=_column(self.sonars, "arc_to_deg"),
        )

    @property
    def warmup_cycles(self) -> int:
        return int(np.ceil(self.warmup_s / self.period_s))

    def plan(self) -> Plan:
        """The instants of the run. Where start or length are left open the input is asked for its span."""
        if self.start_utc is not None and self.cycles > 0:
            cycles = self.warmup_cycles + self.cycles
            return Plan(start_s=self.start_utc.timestamp(), period_s=self.period_s, cycles=cycles)
        first_s, stop_s = self.input.span()
        start_s = float(np.floor(first_s)) - 1.0 if self.start_utc is None else self.start_utc.timestamp()
        cycles = self.warmup_cycles + self.cycles if self.cycles else max(int(np.ceil((stop_s - start_s) / self.period_s)), 0)
        return Plan(start_s=start_s, period_s=self.period_s, cycles=cycles)


def _names(sensors: Any) -> Any:
    return np.array([s.name for s in sensors], "U32")


def _column(sensors: Any, field: str) -> Any:
    return np.array([getattr(s, field) for s in sensors], float)


def _sites(sensors: Any) -> Any:
    return np.array([[s.latitude_deg, s.longitude_deg] for s in sensors], float).reshape(-1, 2)


def _mean_place(places_deg: Any) -> Any:
    """The mean of nearby places, right across the antimeridian."""
    first = places_deg[0]
    return first + np.column_stack([places_deg[:, 0] - first[0], (places_deg[:, 1] - first[1] + 180.0) % 360.0 - 180.0]).mean(0)


def scenario_names() -> list[tuple[str, str]]:
    """Name and title of every scenario that is shipped, sorted."""
    found = []
    for path in sorted(scenarios_folder().glob("*/scenario.toml")):
        found.append((path.parent.name, str(tomllib.loads(path.read_text("utf-8")).get("title", ""))))
    return found


def load_scenario(name_or_path: str, overrides: Mapping[str, str] | None = None) -> Scenario:
    """The scenario of this name, or in this file or folder, with settings overridden.

    Args: overrides: dotted key to value written as in TOML; a bare word counts as text. `radars.0.rpm` names a list item.
    Raises: ScenarioError that names the file and the key.
    """
    path = _find(name_or_path)
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not TOML: {error}") from error
    return make_scenario(data, str(path), overrides or {})


def make_scenario(data: dict[str, Any], where: str, overrides: Mapping[str, str]) -> Scenario:
    """The scenario that a parsed TOML document describes, with settings overridden. Raises: ScenarioError."""
    for key, text in overrides.items():
        _override(data, key, text)
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        lines = [f"{where}: {_path(e['loc'])}: {e['msg']}, got {_short(e['input'])}" for e in error.errors()]
        raise ScenarioError("\n".join(lines)) from error


def _find(name_or_path: str) -> Path:
    path = Path(name_or_path)
    if path.is_dir():
        path = path / "scenario.toml"
    if path.suffix == ".toml":
        return path
    shipped = scenarios_folder() / name_or_path / "scenario.toml"
    if not shipped.is_file():
        known = ", ".join(name for name, _ in scenario_names())
        raise ScenarioError(f"no scenario is called {name_or_path!r}; there are: {known}; or give a path to a .toml file")
    return shipped


def _override(data: dict[str, Any], key: str, text: str) -> None:
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *parents, last = key.split(".")
    here: Any = data
    for depth, part in enumerate(parents):
        here = _step_into(here, part, ".".join(parents[: depth + 1]))
    if isinstance(here, list):
        here[_index(here, last, key)] = value
    else:
        here[last] = value


def _step_into(here: Any, part: str, path: str) -> Any:
    if isinstance(here, list):
        return here[_index(here, part, path)]
    found = here.setdefault(part, {})
    if not isinstance(found, dict | list):
        raise ScenarioError(f"--set {path}: is {found!r}, not a table")
    return found


def _index(items: list[Any], part: str, path: str) -> int:
    if not part.isdigit() or int(part) >= len(items):
        raise ScenarioError(f"--set {path}: got {part!r}, needed a number from 0 to {len(items) - 1}")
    return int(part)


def _path(loc: tuple[int | str, ...]) -> str:
    return ".".join(str(part) for part in loc) or "scenario"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def utc_text(time_s: float) -> str:
    """Seconds since the Unix epoch as ISO 8601 text, UTC."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
