"""The whole flow on one page. It consumes the memory: (memory, reports) -> (memory, what the stages yielded).

Two kinds of centre run it. A regional centre makes tracks of the reports of its radars (`regional`). The high-level centre makes
the picture of the tracks that it receives (`fuse`, which also takes tracks made elsewhere). `step` is both in one.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

import numpy as np

from coastwatch.alarms import (
    AlarmInput,
    AlarmMemory,
    EventMemory,
    EvidenceContext,
    Numbered,
    expected_sensors,
    next_events,
    numbered,
)
from coastwatch.associations import (
    AssociationInput,
    AssociationMemory,
    BearingAssociationInput,
    BearingAssociationMemory,
    held,
)
from coastwatch.associations.bearing_members import bearing_members, held_vessels, vessel_bearings
from coastwatch.batches import (
    AisAlarms,
    AisDetection,
    AisFeeds,
    AisStatics,
    Associations,
    BearingAssociations,
    BearingMembers,
    BearingTracks,
    EventChanges,
    Fault,
    FusedTracks,
    Measurements,
    Members,
    Octants,
    Picture,
    Plots,
    RadarCorrections,
    RadarCover,
    Reports,
    SensorHearing,
    Sensors,
    Spots,
    StandingEchoes,
    Tracks,
    TrackSourceStates,
    VesselAlarms,
    limits,
)
from coastwatch.cover import CoverInput, RadarCoverageMemory, SilenceInput, SilenceMemory
from coastwatch.fused_tracks import FusionInput, FusionMemory
from coastwatch.picture import PictureInput, PictureMemory
from coastwatch.regional import RegionMemory, reports_of_regions, start_region, step_of_regions
from coastwatch.registration import RegistrationInput, RegistrationMemory
from coastwatch.scenario import Scenario
from coastwatch.spots import KMeansMemory, OctantInput
from coastwatch.stage import Map, NoMemory, RegionMap, Running, serial_regions
from coastwatch.tracks import AisInput, AisMemory, BearingInput, BearingMemory, ReceivedInput, ReceivedMemory

Timer = Callable[[str], AbstractContextManager[object]]

LEFT_OUT = {
    "associations": "pairs of tracks not compared: each track of a crowd is compared with the nearest alone",
    "alarms": "pairs of vessels not watched for close approach: of each vessel of a crowd the nearest and most urgent are",
    "octants": "pairs of a bearing and a vessel not compared: each bearing track is compared with the nearest in direction",
    "bearing_tracks": "bearings not used: more than a cycle takes of one sensor or contact",
}
"""What `left_out` counts, by stage: at most so many pairs, or bearings."""


@dataclass(frozen=True)
class CentreMemory:
    """The memory of the stages of the high-level centre."""

    spots: KMeansMemory
    associations: AssociationMemory
    fused_tracks: FusionMemory
    picture: PictureMemory
    octants: NoMemory
    bearing_associations: BearingAssociationMemory
    bearing_members: BearingMembers  # for the fused tracks of the next cycle
    alarms: AlarmMemory
    events: EventMemory


@dataclass(frozen=True)
class Memory:
    """The memory of every stage: plain data, saved as arrays with a schema, with which a run resumes bit for bit.

    While a worker keeps the memory of a region, something else stands in its place. `gathered` gives the plain data.
    """

    regions: tuple[RegionMemory, ...]  # or what stands for it while a worker keeps it
    ais_tracks: AisMemory
    bearing_tracks: BearingMemory
    received_tracks: ReceivedMemory
    centre: CentreMemory
    registration: RegistrationMemory
    corrections: RadarCorrections  # of the radars, for the next cycle
    cover: RadarCoverageMemory
    ais_detection: AisDetection  # by the cover of the radars, for the next cycle
    silence: SilenceMemory  # which sensors were heard, and how often
    radar_cover: RadarCover = field(default_factory=RadarCover.empty)  # for the next cycle
    beyond: dict[str, int] = field(default_factory=dict)  # reports, tracks and vessels that were dropped as none, by kind
    left_out: dict[str, int] = field(default_factory=dict)  # as of Cycle, of all cycles
    unknown_radar: int = 0  # reports of a radar that the scenario does not have


@dataclass(frozen=True)
class Received:
    """What the high-level centre receives in a cycle."""

    tracks: Tracks  # of every region, every track source and AIS, each track at its own time
    measurements: Measurements  # plots and reports in these tracks, if the sender gives them
    alarms: AisAlarms
    bearing_tracks: BearingTracks
    statics: AisStatics
    ais_detection: AisDetection | None = None  # none: a radar should see every vessel within its range
    radar_cover: RadarCover | None = None  # the same
    hearing: SensorHearing | None = None  # which sensors are heard; none: all


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
    ais_feeds: AisFeeds = field(default_factory=AisFeeds.empty)
    track_sources: TrackSourceStates = field(default_factory=TrackSourceStates.empty)
    radar_cover: RadarCover = field(default_factory=RadarCover.empty)  # empty where none is learnt
    standing_echoes: StandingEchoes = field(default_factory=StandingEchoes.empty)  # empty where no clutter map is learnt
    vessel_alarms: VesselAlarms = field(default_factory=VesselAlarms.empty)
    events: EventChanges = field(default_factory=EventChanges.empty)  # flags and alarms that begin or end
    unsound: int = 0  # vessels that were left out of the picture, because their state is none
    left_out: dict[str, int] = field(default_factory=dict)  # by stage: pairs, or bearings, that a crowd has too many of

    def to_write(self) -> Cycle:
        """The cycle without arrays that the store does not read, so that their memory is free while the store writes."""
        return replace(self, tracks=self.tracks.without_values("track_id", "source"), fused=self.fused.without_values())


def start_centre(scenario: Scenario) -> CentreMemory:
    """The memory of the high-level centre before the first cycle."""
    s = scenario
    return CentreMemory(
        s.spots.init(),
        s.associations.init(),
        s.fused_tracks.init(),
        s.picture.init(),
        s.octants.init(),
        s.bearing_associations.init(),
        BearingMembers.empty(),
        s.alarms.init(),
        EventMemory.none(),
    )


def start(scenario: Scenario, sensors: Sensors) -> Memory:
    """The memory before the first cycle."""
    s = scenario
    return Memory(
        tuple(start_region(s) for _ in sensors.region_names),
        s.ais_tracks.init(),
        s.bearing_tracks.init(),
        s.received_tracks.init(),
        start_centre(s),
        s.registration.init(),
        RadarCorrections.none(len(sensors.radars)),
        s.cover.init(),
        AisDetection.empty(),
        s.silence.init(),
    )


def gathered(memory: Memory, regions: RegionMap) -> Memory:
    """The memory with that of every region in this process, for a checkpoint."""
    return replace(memory, regions=tuple(regions.gather(memory.regions)))


def dropped(memory: Memory, sensors: Sensors) -> tuple[Fault, ...]:
    """How many records the stages dropped since the start, by stage and reason. Args: memory: as of `gathered`."""
    m, stamp = memory, "its time is not a number or too far from that of its cycle"
    unusable = m.unknown_radar + sum(region.plots.dropped for region in m.regions)
    counts = [("radar report dropped: not finite, of negative range or of an unknown radar", "plots", unusable)]
    regions = zip(sensors.region_names, m.regions, strict=True)
    counts += [(f"plot dropped: {stamp}", f"tracks of {name}", region.dropped) for name, region in regions]
    counts += [(f"AIS report dropped: {reason}", "ais_tracks", count) for reason, count in m.ais_tracks.refused.items()]
    counts += [(f"bearing dropped: {stamp}", "bearing_tracks", m.bearing_tracks.dropped)]
    counts += [
        (f"track state dropped: {stamp}, or a newer one is known", "received_tracks", int(m.received_tracks.dropped.sum()))
    ]
    counts += [(limits.BEYOND + kind, "pipeline", count) for kind, count in m.beyond.items()]
    counts += [(LEFT_OUT[stage], stage, count) for stage, count in m.left_out.items()]
    return tuple(Fault(kind, count, where, "") for kind, where, count in counts if count)


def fuse(
    scenario: Scenario,
    sensors: Sensors,
    memory: CentreMemory,
    received: Received,
    time_s: float,
    map_: Map,
    timer: Timer,
    zones: tuple[Numbered, ...] | None = None,
) -> tuple[CentreMemory, Cycle]:
    """One cycle of the high-level centre. It does not estimate registration errors of radars. Args: as in `step`."""
    s, m = scenario, memory
    measurements, alarms = received.measurements, received.alarms
    bearing_tracks, statics, detection = received.bearing_tracks, received.statics, received.ais_detection
    cover, hearing = received.radar_cover, received.hearing
    with timer("alignment"):
        tracks = s.alignment.step(received.tracks, time_s)
    del received  # frees the tracks at their own times, if the caller has dropped them too
    with timer("spots"):
        spots_memory, spots = s.spots.step(m.spots, tracks)
    with timer("associations"):
        comparing, every = Running(s.associations, m.associations), AssociationInput(tracks, spots, map_)
        associations_memory, associations = held.associate(comparing, s.associations.gate_m, every, sensors.source_kinds)
    with timer("fused_tracks"):
        bearings = vessel_bearings(m.bearing_members, bearing_tracks, tracks, associations)
        counted, of_counted, bearings = held.counted_once(tracks, associations, bearings, sensors.source_kinds)
        fusion = FusionInput(counted, measurements, of_counted, time_s, sensors.source_kinds, bearings)
        fused_memory, fused = Running(s.fused_tracks, m.fused_tracks).next(fusion)
        fused, by_bearings = held_vessels(bearings, fused, int(associations.vessel.max(initial=-1)) + 1)
    with timer("picture"):
        shown = PictureInput(tracks, associations, fused, alarms, time_s, sensors, by_bearings, detection, hearing)
        picture_memory, (picture, members) = s.picture.step(m.picture, shown)
        good = limits.are_sound(picture.position_deg, picture.covariance)
        if not good.all():
            members = members.take(~np.isin(members.vessel_id, picture.vessel_id[~good]))
            picture = picture.take(good)
    with timer("alarms"):
        known = numbered(s.zones) if zones is None else zones
        watched = AlarmInput(picture, members, time_s, sensors, known, cover, hearing)
        alarms_memory, vessel_alarms = s.alarms.step(m.alarms, watched)
    with timer("octants"):
        octants_memory, octants = s.octants.step(m.octants, OctantInput(bearing_tracks, picture, sensors))
    with timer("bearing_associations"):
        compared = BearingAssociationInput(bearing_tracks, picture, octants, time_s, sensors, statics, map_)
        bearings_memory, bearing_associations = Running(s.bearing_associations, m.bearing_associations).next(compared)
        next_bearings = bearing_members(bearing_associations, bearing_tracks, picture, members, sensors)
    with timer("alarms"):
        stations, radars = expected_sensors(sensors, s.picture.cover_margin, s.picture.dark_after_s, s.picture.unseen_after_s)
        evidence = EvidenceContext(
            tracks=tracks,
            members=members,
            bearing_tracks=bearing_tracks,
            bearing_associations=bearing_associations,
            names=sensors.source_names,
            stations=stations,
            radars=radars,
            ais_heard_s=picture_memory.flags.ais_heard_s[good],
            hearing=hearing,
        )
        events_memory, events = next_events(m.events, picture, vessel_alarms, time_s, s.store.event_gap_s, evidence)
    after = CentreMemory(
        spots=spots_memory,
        associations=associations_memory,
        fused_tracks=fused_memory,
        picture=picture_memory,
        octants=octants_memory,
        bearing_associations=bearings_memory,
        bearing_members=next_bearings,
        alarms=alarms_memory,
        events=events_memory,
    )
    left_out = {
        "associations": associations.left_out,
        "alarms": alarms_memory.approaching.left_out,
        "octants": octants.left_out,
    }
    return after, Cycle(
        time_s,
        tracks,
        alarms,
        bearing_tracks,
        spots,
        associations,
        fused,
        picture,
        members,
        octants,
        bearing_associations,
        RadarCorrections.none(len(sensors.radars)),
        vessel_alarms=vessel_alarms,
        events=events,
        unsound=int((~good).sum()),
        left_out=_summed(left_out),
    )


def step(
    scenario: Scenario,
    sensors: Sensors,
    memory: Memory,
    reports: Reports,
    time_s: float,
    map_: Map,
    timer: Timer,
    regions: RegionMap = serial_regions,
    *,
    zones: tuple[Numbered, ...] | None = None,
) -> tuple[Memory, Cycle]:
    """One cycle of all centres.

    Args: reports: all that arrived since the last cycle; time_s: of the picture; map_: maps the work of spots over processors;
    timer: returns a context manager for the name of a stage, inside which the stage runs; regions: maps the regional centres;
    zones: with their numbers; none: the zones of the scenario.
    Returns: the memory for the next cycle, and the outputs of all stages.
    """
    s, m = scenario, memory
    reports, beyond = limits.reports_within(reports)
    with timer("ais_tracks"):
        heard = AisInput(reports.ais, time_s, sensors)
        ais_memory, (ais_tracks, alarms, ais_taken) = s.ais_tracks.step(m.ais_tracks, heard)
    with timer("tracks"):
        messages = [s.tracks.messages_of(ais_taken, ais_tracks, sensors, k) for k in range(len(sensors.region_names))]
        given, unknown = reports_of_regions(reports.radar, messages, m.corrections, time_s, sensors)
        found = regions(step_of_regions(s), m.regions, given)
        regional_memory, regional = tuple(after for after, _ in found), [cycle for _, cycle in found]
    with timer("bearing_tracks"):
        bearing_memory, bearing_tracks = s.bearing_tracks.step(m.bearing_tracks, BearingInput(reports.bearing, time_s, sensors))
    with timer("received_tracks"):
        states = ReceivedInput(reports.tracks, time_s, sensors, ais_tracks)
        received_memory, received_tracks = s.received_tracks.step(m.received_tracks, states)
    plots = Plots.join([region.plots for region in regional])
    tracks = Tracks.join([*(region.tracks for region in regional), received_tracks, ais_tracks])
    measurements = Measurements.join([*(region.measurements for region in regional), ais_taken])
    tracks, measurements, alarms, bearing_tracks, unsound = _sound(tracks, measurements, alarms, bearing_tracks)
    if unsound:
        ais_tracks = ais_tracks.take(limits.are_sound(ais_tracks.position_deg, ais_tracks.covariance))
    with timer("silence"):
        silence_memory, hearing = s.silence.step(m.silence, SilenceInput(reports, ais_tracks, time_s, sensors))
    received = Received(tracks, measurements, alarms, bearing_tracks, reports.statics, m.ais_detection, m.radar_cover, hearing)
    centre_memory, cycle = fuse(s, sensors, m.centre, received, time_s, map_, timer, zones)
    beyond = _summed(m.beyond, beyond, unsound, {"vessel of the picture": cycle.unsound})
    left_out = _summed(cycle.left_out, {"bearing_tracks": bearing_memory.left_out - m.bearing_tracks.left_out})
    with timer("registration"):
        seen = RegistrationInput(
            plots,
            ais_tracks,
            alarms,
            measurements,
            cycle.picture,
            cycle.members,
            bearing_tracks,
            cycle.bearing_associations,
            time_s,
            sensors,
            m.corrections,
        )
        registration_memory, corrections = Running(s.registration, m.registration).next(seen)
    with timer("cover"):
        alarmed = np.isin(cycle.tracks.track_id, alarms.track_id[alarms.twice | alarms.impossible_speed])
        shown = CoverInput(
            plots,
            cycle.tracks,
            cycle.associations,
            measurements,
            alarmed,
            m.corrections.jumped,
            sensors,
            hearing.radars.silent,
        )
        cover_memory, (radar_cover, ais_detection) = Running(s.cover, m.cover).next(shown)
    cycle = replace(
        cycle,
        corrections=corrections,
        ais_feeds=ais_memory.clocks.summary(),
        track_sources=s.received_tracks.summary(received_memory, sensors),
        radar_cover=radar_cover,
        standing_echoes=StandingEchoes.join([region.standing_echoes for region in regional]),
        left_out=left_out,
    )
    after = Memory(
        regions=regional_memory,
        ais_tracks=ais_memory,
        bearing_tracks=bearing_memory,
        received_tracks=received_memory,
        centre=centre_memory,
        registration=registration_memory,
        corrections=corrections,
        cover=cover_memory,
        ais_detection=ais_detection,
        silence=silence_memory,
        radar_cover=radar_cover,
        beyond=beyond,
        left_out=_summed(m.left_out, left_out),
        unknown_radar=m.unknown_radar + unknown,
    )
    return after, cycle


def _sound(
    tracks: Tracks, measurements: Measurements, alarms: AisAlarms, bearings: BearingTracks
) -> tuple[Tracks, Measurements, AisAlarms, BearingTracks, dict[str, int]]:
    """The same without tracks whose state is none, and how many those are: no later stage can use them."""
    good = limits.are_sound(tracks.position_deg, tracks.covariance)
    seen = np.isfinite(bearings.bearing_rad) & np.isfinite(bearings.covariance.sum(axis=(1, 2)))
    if good.all() and seen.all():
        return tracks, measurements, alarms, bearings, {}
    gone = tracks.track_id[~good]
    kept = measurements.take(~np.isin(measurements.track_id, gone)), alarms.take(~np.isin(alarms.track_id, gone))
    counts = {"track": int((~good).sum()), "bearing track": int((~seen).sum())}
    return tracks.take(good), *kept, bearings.take(seen), counts


def _summed(*some: dict[str, int]) -> dict[str, int]:
    """The sums of counts by kind, without zeros."""
    out: dict[str, int] = {}
    for counts in some:
        for kind, count in counts.items():
            if count:
                out[kind] = out.get(kind, 0) + count
    return out
