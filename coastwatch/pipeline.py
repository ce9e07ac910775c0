"""The whole flow on one page. Pure: (memory, reports) -> (memory, what the stages yielded).

Two kinds of centre run it: regional centres make tracks of reports, the high-level centre makes the picture of the tracks that it
receives. `step` is both in one; `fuse` is the high-level centre alone, for tracks that were made elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

from coastwatch.batches import (
    AisAlarms,
    AisStatics,
    Associations,
    BearingAssociations,
    BearingTracks,
    FusedTracks,
    Measurements,
    Members,
    Octants,
    Picture,
    RadarCorrections,
    Reports,
    Sensors,
    Spots,
    Tracks,
)
from coastwatch.scenario import Scenario
from coastwatch.stage import Map, RegionMap, serial_regions

Timer = Callable[[str], AbstractContextManager[object]]


@dataclass(frozen=True)
class CentreMemory:
    """The memory of the stages of the high-level centre."""

    spots: Any
    associations: Any
    fused_tracks: Any
    picture: Any
    octants: Any
    bearing_associations: Any


@dataclass(frozen=True)
class Memory:
    """The memory of every stage. It is plain data, saved as arrays with a schema: a run resumes bit for bit."""

    plots: Any
    tracks: tuple[Any, ...]  # one memory for each region
    ais_tracks: Any
    bearing_tracks: Any
    centre: CentreMemory
    registration: Any
    corrections: RadarCorrections  # of the radars, for the next cycle


@dataclass(frozen=True)
class Received:
    """What the high-level centre receives in a cycle."""

    tracks: Tracks  # of every region and of AIS, each track at its own time
    measurements: Measurements  # plots and reports in these tracks, if the sender gives them
    alarms: AisAlarms
    bearing_tracks: BearingTracks
    statics: AisStatics


@dataclass(frozen=True)
class Cycle:
    """What the stages yielded in one cycle."""

    time_s: float
    tracks: Tracks  # of radars and AIS, at time_s
    alarms: AisAlarms
    bearing_tracks: BearingTracks
    spots: Spots
    associations: Associations
    fused: FusedTracks
    picture: Picture
    members: Members
    octants: Octants
    bearing_associations: BearingAssociations
    corrections: RadarCorrections  # found in this cycle, for the next

    def to_write(self) -> Cycle:
        """The cycle without arrays that the store does not read, so that their memory is free while the store writes."""
        return replace(self, tracks=self.tracks.without_values("track_id", "source"), fused=self.fused.without_values())


def start_centre(scenario: Scenario) -> CentreMemory:
    """The memory of the high-level centre before the first cycle."""
    s = scenario
    first = s.spots.init(), s.associations.init(), s.fused_tracks.init(), s.picture.init()
    return CentreMemory(*first, s.octants.init(), s.bearing_associations.init())


def start(scenario: Scenario, sensors: Sensors) -> Memory:
    """The memory before the first cycle."""
    s = scenario
    return Memory(
        s.plots.init(),
        tuple(s.tracks.init() for _ in sensors.region_names),
        s.ais_tracks.init(),
        s.bearing_tracks.init(),
        start_centre(s),
        s.registration.init(),
        RadarCorrections.none(len(sensors.radars)),
    )


def fuse(
    scenario: Scenario,
    sensors: Sensors,
    memory: CentreMemory,
    received: Received,
    time_s: float,
    map_: Map,
    timer: Timer,
) -> tuple[CentreMemory, Cycle]:
    """One cycle of the high-level centre. It does not estimate registration errors of radars. Args: as in `step`."""
    s, m = scenario, memory
    measurements, alarms = received.measurements, received.alarms
    bearing_tracks, statics = received.bearing_tracks, received.statics
    with timer("alignment"):
        tracks = s.alignment.step(received.tracks, time_s)
    del received  # frees the tracks at their own times, if the caller has dropped them too
    with timer("spots"):
        spots_memory, spots = s.spots.step(m.spots, tracks)
    with timer("associations"):
        associations_memory, associations = s.associations.step(m.associations, tracks, spots, map_)
    with timer("fused_tracks"):
        fused_memory, fused = s.fused_tracks.step(
            m.fused_tracks, tracks, measurements, associations, time_s, sensors.source_kinds
        )
    with timer("picture"):
        picture_memory, picture, members = s.picture.step(m.picture, tracks, associations, fused, alarms, time_s, sensors)
    with timer("octants"):
        octants_memory, octants = s.octants.step(m.octants, bearing_tracks, picture, sensors)
    with timer("bearing_associations"):
        bearings_memory, bearing_associations = s.bearing_associations.step(
            m.bearing_associations, bearing_tracks, picture, octants, time_s, sensors, map_, statics
        )
    after = CentreMemory(spots_memory, associations_memory, fused_memory, picture_memory, octants_memory, bearings_memory)
    found = spots, associations, fused, picture, members, octants, bearing_associations
    return after, Cycle(time_s, tracks, alarms, bearing_tracks, *found, RadarCorrections.none(len(sensors.radars)))


def step(
    scenario: Scenario,
    sensors: Sensors,
    memory: Memory,
    reports: Reports,
    time_s: float,
    map_: Map,
    timer: Timer,
    regions: RegionMap = serial_regions,
) -> tuple[Memory, Cycle]:
    """One cycle of all centres.

    Args: reports: all that arrived since the last cycle; time_s: of the picture; map_: maps the work of spots over processors;
    timer: returns a context manager for the name of a stage, inside which the stage runs; regions: maps the regional centres.
    Returns: the memory for the next cycle, and the outputs of all stages.
    """
    s, m = scenario, memory
    with timer("plots"):
        plots_memory, plots = s.plots.step(m.plots, reports.radar, sensors, m.corrections)
    with timer("tracks"):
        by_region = [(plots.take(plots.region == k), time_s, sensors, k) for k in range(len(m.tracks))]
        regional = regions(s.tracks.step, m.tracks, by_region)
    with timer("ais_tracks"):
        ais_memory, ais_tracks, alarms, ais_taken = s.ais_tracks.step(m.ais_tracks, reports.ais, time_s, sensors)
    with timer("bearing_tracks"):
        bearing_memory, bearing_tracks = s.bearing_tracks.step(m.bearing_tracks, reports.bearing, time_s, sensors)
    tracks = Tracks.join([*(yielded for _, yielded, _ in regional), ais_tracks])
    measurements = Measurements.join([*(taken for *_, taken in regional), ais_taken])
    received = Received(tracks, measurements, alarms, bearing_tracks, reports.statics)
    centre_memory, cycle = fuse(s, sensors, m.centre, received, time_s, map_, timer)
    with timer("registration"):
        seen = plots, ais_tracks, alarms, measurements, cycle.picture, cycle.members, bearing_tracks, cycle.bearing_associations
        registration_memory, corrections = s.registration.step(m.registration, *seen, time_s, sensors, m.corrections)
    # When the corrections of a radar jump, its next plots lie elsewhere: tracks that hold its plots are dropped.
    radar_memory = tuple(new.without_radars(corrections.jumped) for new, *_ in regional)
    first = plots_memory, radar_memory, ais_memory, bearing_memory, centre_memory
    return Memory(*first, registration_memory, corrections), replace(cycle, corrections=corrections)
