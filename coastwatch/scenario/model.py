"""Everything that decides a run but the seed: one frozen, validated struct."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AwareDatetime, Field, model_validator

from coastwatch.associations import Associator, BearingAssociator, BearingLikelihood, WindowedCovariance
from coastwatch.batches import Sensors
from coastwatch.fused_tracks import CentralImm, Fuser
from coastwatch.picture import Identity
from coastwatch.plots import PlotConverter, PolarConversion
from coastwatch.registration import OnlineRegistration, Registrar
from coastwatch.scenario.sites import Area, Name, Positive, Radar, Sonar, Station, sensors_of
from coastwatch.sensors import Feed
from coastwatch.spots import KMeansSpots, OctantGrouper, OctantSpots, SpotGrouper
from coastwatch.stage import Method, Plan, Settings
from coastwatch.tracks import (
    AisFilter,
    AisTracker,
    BearingTracker,
    BearingWindow,
    ConstantVelocity,
    RadarTracker,
    SidedImm,
    TrackAligner,
)


class StoreSettings(Settings):
    """What is kept of a run."""

    picture_large: Annotated[int, Field(ge=0)] = 100_000  # tracks; up to so many the current picture is written every cycle
    picture_every_s: Annotated[float, Field(ge=0.0)] = 12.0  # of more tracks
    history_error_m: Positive = 10.0  # that a vessel may be off where its past is dead-reckoned from the points that are kept
    history_max_s: Annotated[float, Field(ge=0.0)] = 60.0  # between two points of a vessel; 0: one in every cycle
    spots_every: Annotated[int, Field(ge=1)] = 1  # cycles
    associations_every: Annotated[int, Field(ge=1)] = 1  # cycles
    registration_every: Annotated[int, Field(ge=1)] = 1  # cycles
    checkpoint_every: Annotated[int, Field(ge=1)] = 10  # cycles
    history_hours: Annotated[float, Field(ge=0.0)] = 0.0  # of the past that can be asked for; 0: all
    details_hours: Annotated[float, Field(ge=0.0)] = 0.0  # of associations, spots, timings and registrations; 0: all
    picture_hours: Annotated[float, Field(ge=0.0)] = 0.0  # that the last picture of a run is kept after its end; 0: for ever
    recording_hours: Annotated[float, Field(ge=0.0)] = 0.0  # of the recording; 0: all
    overlap: bool = True  # a cycle is written while the next one is computed; the rows are the same
    recording: bool = False  # of every picture with its members, bit for bit


class WorkerSettings(Settings):
    """Over what a run is spread; the picture is the same to the bit for all.

    `method`: `threads` of this process, `processes`, or `ray`, the machines of a cluster (see ops/ray); `auto` takes threads, and the best
    way on one machine is left to it.
    """

    method: Literal["auto", "threads", "processes", "ray"] = "auto"  # auto: threads, for work that is large enough
    count: Annotated[int, Field(ge=0, le=4096)] = 0  # processors; 0: all of the machine, or of the cluster


class Scenario(Settings):
    """Everything that decides a run but the seed."""

    name: Name  # the run is kept under it
    title: str  # one line for lists and plots
    seed: Annotated[int, Field(ge=0)] = 1  # of all that is random
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
    tracks: RadarTracker = SidedImm()
    ais_tracks: AisTracker = AisFilter()
    bearing_tracks: BearingTracker = BearingWindow()
    alignment: TrackAligner = ConstantVelocity()
    spots: SpotGrouper = KMeansSpots()
    octants: OctantGrouper = OctantSpots()
    associations: Associator = WindowedCovariance()
    bearing_associations: BearingAssociator = BearingLikelihood()
    fused_tracks: Fuser = CentralImm()
    picture: Identity = Identity()
    registration: Registrar = OnlineRegistration()
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
        if 0.0 < self.spots.halo_m < self.associations.gate_m:
            raise ValueError(
                f"spots.halo_m: got {self.spots.halo_m}, needed at least associations.gate_m = {self.associations.gate_m}, "
                "or pairs across the border of two spots are lost (0: no halo, as in the paper, and they are)"
            )
        return self

    def sensors(self) -> Sensors:
        """The sensors as arrays, regions and sources numbered."""
        return sensors_of(self.radars, self.stations, self.sonars)

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
