"""The Scenario: all settings of a run except the seed, as one frozen, validated struct."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AwareDatetime, BaseModel, Field, model_validator

from coastwatch.alarms import AlarmRules, Zone
from coastwatch.associations import (
    Associator,
    BearingAssociator,
    BearingLikelihood,
    CountedTest,
    SingleScanTest,
    WindowedCovariance,
)
from coastwatch.batches import Sensors
from coastwatch.cover import LearntCover, RadarCoverage, UsualPauses
from coastwatch.errors import InputError
from coastwatch.fused_tracks import CentralImm, Fuser
from coastwatch.geodesy import scale_m_deg
from coastwatch.picture import Identity
from coastwatch.plots import CfarExtraction, PlotConverter, PlotExtractor, PolarConversion
from coastwatch.registration import OnlineRegistration, Registrar
from coastwatch.scenario.sites import (
    Area,
    Name,
    Radar,
    Sonar,
    Station,
    TrackSource,
    refuse_scattered_regions,
    refuse_shared_names,
    sensors_of,
)
from coastwatch.sensors import SIMULATIONS, Feed, LiveFeeds, Tables
from coastwatch.shipped import scenarios_folder
from coastwatch.spots import KMeansSpots, OctantGrouper, OctantSpots, SpotGrouper
from coastwatch.stage import Count, CountOrZero, Method, NotNegative, Plan, Positive, Settings
from coastwatch.tracks import (
    AisDeadReckoning,
    AisFilter,
    AisPositions,
    AisTracker,
    BearingTracker,
    BearingWindow,
    ConstantVelocity,
    HullMiddle,
    RadarTracker,
    ReceivedTracks,
    TableTracker,
    TrackAligner,
    TrackReceiver,
)

OWN = "own"
"""As `coastline`: that in the folder of the shipped scenario."""

BEYOND_RANGE_M = 1000.0
"""Of radars, in which land is known too."""

MOST_CYCLES = 100_000_000
"""Ten years of cycles of 3 s."""


LIVE_HOURS = {
    "history_hours": 168.0,
    "details_hours": 24.0,
    "event_hours": 2160.0,
    "picture_hours": 24.0,
    "recording_hours": 168.0,
    "audit_hours": 8760.0,
}
"""For how long a live run keeps what its settings say nothing of: a week of history, a day of details, 90 days of events."""


Hours = Annotated[float, Field(ge=0.0, le=876_600.0)]  # up to a century


class StoreSettings(Settings):
    """What is stored of a run, and for how long. A live run (`coastwatch serve`) has a limit for each time that is not set.

    These are 168 hours of history and recording, 24 of details and of pictures after the end, 2160 of events, 8760 of the audit.
    """

    picture_large: CountOrZero = 100_000  # tracks; up to this many the current picture is written every cycle
    picture_every_s: NotNegative = 12.0  # with more tracks
    history_error_m: Positive = 10.0  # largest position error of a vessel's history, dead-reckoned from its stored points
    history_max_s: NotNegative = 60.0  # between two stored points of a vessel; 0: a point every cycle
    spots_every: Count = 1  # cycles
    associations_every: Count = 1  # cycles
    registration_every: Count = 1  # cycles
    cover_every_s: NotNegative = 60.0  # between two writings of the learnt cover of radars; the newest is kept
    checkpoint_every: Count = 10  # cycles
    checkpoint_mb_s: Positive = (
        32.0  # megabytes a second before compression that checkpoints of a live run may take, to save more often than that
    )
    history_hours: Hours = 0.0  # of history; 0: all
    details_hours: Hours = 0.0  # of associations, spots, timings and registrations; 0: all
    event_hours: Hours = 0.0  # of events, by their end; 0: all
    event_gap_s: NotNegative = 60.0  # a flag that returns within this time goes on with its event
    picture_hours: Hours = 0.0  # after the end of a run until its last picture is deleted; 0: never
    recording_hours: Hours = 0.0  # of recording; 0: all
    audit_hours: Hours = 0.0  # of who changed what, and of versions of zones before the newest; 0: all
    journal_minutes: NotNegative = (
        30.0  # of a regional centre's tracks, for centres that fall behind; the newest cycle is always kept
    )
    overlap: bool = True  # write cycles while the next ones are computed, at most two behind; the rows are the same
    recording: bool = False  # store every picture with its members, bit for bit

    def of_live_run(self) -> StoreSettings:
        """The settings with a limit for each time that is not set. One that is set to 0 stays: that is kept for ever."""
        return self.model_copy(update={name: hours for name, hours in LIVE_HOURS.items() if name not in self.model_fields_set})

    def event_s(self, period_s: float) -> float:
        """How long an event is kept after its end; inf: for ever. Until its gap has ended it may return."""
        return max(self.event_hours * 3600.0, self.event_gap_s + period_s) if self.event_hours > 0.0 else math.inf


class WorkerSettings(Settings):
    """How the work of a run is shared; all methods give the same picture.

    `method`: `threads` of this process, `processes` of this machine, or `ray`, the machines of a cluster (see ops/ray). `auto` is
    the fastest on one machine: threads. All of them compute regional centres side by side.
    """

    method: Literal["auto", "threads", "processes", "ray"] = "auto"  # auto: threads, for work that is large enough
    count: Annotated[int, Field(ge=0, le=4096)] = 0  # processors; 0: all of the machine, or of the cluster


class Scenario(Settings):
    """All settings of a run except the seed."""

    name: Name  # the name under which the run is stored
    title: str  # one line, for lists and plots
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1  # whole number that all randomness starts from
    start_utc: AwareDatetime | None = None  # none: the start of the recording; live feeds do not use it
    period_s: Annotated[float, Field(ge=0.01, le=3600.0)] = 3.0  # of a cycle
    cycles: Annotated[int, Field(ge=0, le=MOST_CYCLES)] = 40  # scored cycles; 0: to the end of the recording
    warmup_s: NotNegative = 60.0  # before the first scored cycle
    area: Area
    radars: tuple[Radar, ...] = ()
    stations: tuple[Station, ...] = ()
    sonars: tuple[Sonar, ...] = ()
    track_sources: tuple[TrackSource, ...] = ()
    zones: tuple[Zone, ...] = ()
    coastline: str = ""
    """Land in which no radar looks for ships in its video: a GeoJSON file, "own" (coastline.geojson of the shipped scenario) or
    "natural_earth", right to about 500 m; empty: none."""
    input: Feed = Field(default_factory=LiveFeeds)
    extraction: PlotExtractor = CfarExtraction()
    plots: PlotConverter = PolarConversion()
    tracks: RadarTracker = TableTracker(method="guided_vimmjipda")
    ais_positions: AisPositions = HullMiddle()
    ais_tracks: AisTracker = AisFilter()
    bearing_tracks: BearingTracker = BearingWindow()
    received_tracks: TrackReceiver = ReceivedTracks()
    alignment: TrackAligner = ConstantVelocity()
    spots: SpotGrouper = KMeansSpots()
    octants: OctantGrouper = OctantSpots()
    associations: Associator = WindowedCovariance()
    bearing_associations: BearingAssociator = BearingLikelihood()
    fused_tracks: Fuser = CentralImm()
    picture: Identity = Identity()
    alarms: AlarmRules = AlarmRules()
    registration: Registrar = OnlineRegistration()
    cover: RadarCoverage = LearntCover()
    silence: UsualPauses = UsualPauses()
    store: StoreSettings = StoreSettings()
    workers: WorkerSettings = WorkerSettings()

    @model_validator(mode="before")
    @classmethod
    def _default_method_where_none_is_named(cls, data: object) -> object:
        """A table without `method` has the settings of the default method of its stage."""
        if not isinstance(data, dict):
            return data
        out = dict(data)
        for name, field in cls.model_fields.items():
            if isinstance(field.default, Method) and isinstance(out.get(name), dict):
                out[name] = {"method": field.default.model_dump()["method"], **out[name]}
        return out

    @model_validator(mode="after")
    def _names_are_unique(self) -> Scenario:
        for kind in ("radars", "stations", "sonars", "track_sources", "zones"):
            names = [s.name for s in getattr(self, kind)]
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise InputError(f"{kind}: got the name {twice!r} {names.count(twice)} times, needed each once")
        refuse_shared_names(self.radars, self.track_sources, self.sonars)
        refuse_scattered_regions(self.radars)
        return self

    @model_validator(mode="after")
    def _settings_of_radars_name_radars(self) -> Scenario:
        names = [radar.name for radar in self.radars]
        stages = {"plots": self.plots, "tracks": self.tracks}
        by_radar = dict(table for path, stage in stages.items() for table in _tables(stage, path))
        by_radar["extraction.masks.sectors"] = {s.radar: s for s in self.extraction.masks.sectors if s.radar}
        for path, table in by_radar.items():
            for name in table:
                if name not in names:
                    raise InputError(f"{path}: got radar {name!r}, needed one of {names}")
        return self

    @model_validator(mode="after")
    def _has_few_enough_cycles(self) -> Scenario:
        if self.warmup_s / self.period_s + self.cycles > MOST_CYCLES:
            raise InputError(
                f"warmup_s: got {self.warmup_s:g} with period_s = {self.period_s:g} and cycles = {self.cycles}, needed at most "
                f"{MOST_CYCLES} cycles in all"
            )
        return self

    @model_validator(mode="after")
    def _halo_covers_the_gate(self) -> Scenario:
        if 0.0 < self.spots.halo_m < self.associations.gate_m:
            raise InputError(
                f"spots.halo_m: got {self.spots.halo_m}, needed at least associations.gate_m = {self.associations.gate_m}, "
                "else pairs across the border of two spots are lost (0: no halo, as in the paper, which loses them)"
            )
        return self

    @model_validator(mode="after")
    def _tests_have_covariances(self) -> Scenario:
        if isinstance(self.associations, SingleScanTest | CountedTest) and isinstance(self.ais_tracks, AisDeadReckoning):
            raise InputError(
                f"associations.method: got {self.associations.method!r}, which needs covariances, with ais_tracks.method = "
                f"{self.ais_tracks.method!r}, which gives none; needed 'counting'"
            )
        return self

    def sensors(self) -> Sensors:
        """The sensors as arrays, with numbered regions and sources; a radar that moves where its first plot was measured.

        Raises: InputError if the input does not say where that was.
        """
        moving = [r.name for r in self.radars if r.latitude_deg is None]
        if not moving:
            return self._with_land(sensors_of(self.radars, self.stations, self.sonars, self.track_sources))
        places = self.input.first_sites() if isinstance(self.input, Tables) else {}
        lost = [name for name in moving if not places or (name not in places and len(self.radars) > 1)]
        if lost:
            raise InputError(
                f"radar {lost[0]!r}: got no position, needed latitude_deg and longitude_deg, or the columns site_latitude and "
                "site_longitude in its plots"
            )
        only = next(iter(places.values()))
        placed = []
        for radar in self.radars:
            latitude, longitude = places.get(radar.name, only)
            update = {"latitude_deg": latitude, "longitude_deg": longitude} if radar.name in moving else {}
            placed.append(radar.model_copy(update=update))
        return self._with_land(sensors_of(placed, self.stations, self.sonars, self.track_sources))

    def _with_land(self, sensors: Sensors) -> Sensors:
        """The sensors with the land around the radars. Raises: InputError that names the file of the coastline."""
        if not self.coastline or not len(sensors.radars):
            return sensors
        from coastwatch.formats import coastline  # here: only a run with land needs its 30 MB

        given = scenarios_folder() / self.name / "coastline.geojson" if self.coastline == OWN else Path(self.coastline)
        path = next((place for place in (given, scenarios_folder().parent / given) if place.is_file()), given)
        if self.coastline != coastline.NATURAL and not path.is_file():
            raise InputError(
                f"coastline: got {str(given)!r}, which is no file, needed GeoJSON, {OWN!r} or {coastline.NATURAL!r}"
            )
        site_deg, reach_m = sensors.radars.site_deg, sensors.radars.range_m + BEYOND_RANGE_M
        scale_north, scale_east = scale_m_deg(site_deg[:, 0])
        low = site_deg - np.column_stack([reach_m / scale_north, reach_m / scale_east])
        high = 2.0 * site_deg - low
        box = float(low[:, 0].min()), float(low[:, 1].min()), float(high[:, 0].max()), float(high[:, 1].max())
        return replace(sensors, land_deg=coastline.rings_within(path, box))

    @property
    def warmup_cycles(self) -> int:
        return int(np.ceil(self.warmup_s / self.period_s))

    def plan(self) -> Plan:
        """The instants of the run. If start or length are not set, they follow from the span of the input.

        Raises: InputError: a simulation has no span of its own, or a file cannot be read.
        """
        if self.start_utc is not None and self.cycles > 0:
            cycles = self.warmup_cycles + self.cycles
            return Plan(start_s=self.start_utc.timestamp(), period_s=self.period_s, cycles=cycles)
        feed = self.input
        if isinstance(feed, SIMULATIONS):
            raise InputError(f"start_utc, cycles: got none or 0, needed both where input.method is {feed.method}")
        after_s = -math.inf if self.start_utc is None else self.start_utc.timestamp()
        first_s, stop_s = feed.span(self.sensors, after_s, to_the_end=not self.cycles)
        start_s = float(np.floor(first_s)) - 1.0 if self.start_utc is None else after_s
        cycles = self.warmup_cycles + self.cycles if self.cycles else max(int(np.ceil((stop_s - start_s) / self.period_s)), 0)
        return Plan(start_s=start_s, period_s=self.period_s, cycles=cycles)


def _tables(settings: BaseModel, path: str) -> Iterator[tuple[str, dict[str, object]]]:
    """The tables by name of sensors in these settings and in the parts of them, each with its path."""
    for key, given in settings:
        if isinstance(given, dict):
            yield f"{path}.{key}", given
        elif isinstance(given, BaseModel):
            yield from _tables(given, f"{path}.{key}")
