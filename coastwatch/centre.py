"""The flow of the high-level centre: what it receives from sensors and regional centres becomes the picture.

It consumes its memory: (memory, received) -> (memory, what the stages yielded).
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
    merged_ais,
)
from coastwatch.associations.antennas_beside_echoes import BesideEchoes, join_beside
from coastwatch.associations.antennas_on_echoes import antennas_on_echoes
from coastwatch.associations.bearing_members import bearing_members, bearing_only_vessels, vessel_bearings
from coastwatch.batches import (
    AisAlarms,
    AisDetection,
    AisFeeds,
    AisStatics,
    Associations,
    BearingAssociations,
    BearingMembers,
    BearingTracks,
    Bools,
    DecidedPath,
    EventChanges,
    Extractions,
    Floats,
    FusedTracks,
    HullOffsets,
    Measurements,
    Members,
    Octants,
    Picture,
    RadarCorrections,
    RadarCover,
    SensorHearing,
    Sensors,
    Spots,
    StandingEchoes,
    Tracks,
    TrackSourceStates,
    VesselAlarms,
    limits,
)
from coastwatch.fused_tracks import FusionInput, FusionMemory
from coastwatch.picture import PictureInput, PictureMemory
from coastwatch.scenario import Scenario
from coastwatch.spots import KMeansMemory, OctantInput
from coastwatch.stage import Map, NoMemory, Running

Timer = Callable[[str], AbstractContextManager[object]]
"""A context manager for the name of a stage, inside which the stage runs."""


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
    bearing_bias_rad: Floats  # (K,) of each bearing sensor, as known before this cycle; of none before the first
    beside: BesideEchoes = field(default_factory=BesideEchoes.empty)


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
    jumped: Bools | None = None  # (R,) radars whose corrections jumped before this cycle; none: no one
    hulls: HullOffsets = field(default_factory=HullOffsets.empty)  # of ships whose size is known


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
    decided: DecidedPath = field(default_factory=DecidedPath.empty)  # of radar tracks; empty for trackers that decide at once
    vessel_alarms: VesselAlarms = field(default_factory=VesselAlarms.empty)
    events: EventChanges = field(default_factory=EventChanges.empty)  # flags and alarms that begin or end
    unsound: int = 0  # vessels that were left out of the picture, because their state is none
    left_out: dict[str, int] = field(default_factory=dict)  # by stage: choices, pairs or bearings that a crowd has too many of
    extractions: Extractions = field(default_factory=Extractions.empty)  # of the video of this cycle

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
        np.zeros(0),
    )


def run_centre(
    scenario: Scenario,
    sensors: Sensors,
    memory: CentreMemory,
    received: Received,
    time_s: float,
    map_: Map,
    timer: Timer,
    zones: tuple[Numbered, ...] | None = None,
) -> tuple[CentreMemory, Cycle]:
    """One cycle of the high-level centre. It does not estimate registration errors of radars. Args: as of `run_cycle`."""
    s, m = scenario, memory
    measurements, alarms = received.measurements, received.alarms
    bearing_tracks, statics, detection = received.bearing_tracks, received.statics, received.ais_detection
    cover, hearing, jumped, hulls = received.radar_cover, received.hearing, received.jumped, received.hulls
    with timer("alignment"):
        tracks = s.alignment.step(received.tracks, time_s)
    del received  # frees the tracks at their own times, if the caller has dropped them too
    with timer("spots"):
        spots_memory, spots = s.spots.step(m.spots, tracks)
    with timer("associations"):
        on_echoes = antennas_on_echoes(tracks, sensors.source_kinds)
        every = AssociationInput(on_echoes.at_middles(tracks) if len(on_echoes.ais) else tracks, spots, map_)
        comparing = Running(s.associations, m.associations)
        associations_memory, associations = merged_ais.associate(comparing, s.associations.gate_m, every, sensors.source_kinds)
        beside, associations, on_hulls = join_beside(
            m.beside, tracks, associations, sensors.source_kinds, hulls, time_s, s.period_s
        )
    with timer("fused_tracks"):
        bearings = vessel_bearings(m.bearing_members, bearing_tracks, tracks, associations)
        tracks, measurements = on_hulls.inflated(*on_echoes.inflated(tracks, measurements))
        counted, of_counted = tracks, associations
        if s.tracks.holds_messages and not s.fused_tracks.of_measurements:
            counted, of_counted, bearings = merged_ais.counted_once(tracks, associations, bearings, sensors.source_kinds)
        fusion = FusionInput(counted, measurements, of_counted, time_s, sensors.source_kinds, bearings, alarms)
        fused_memory, fused = Running(s.fused_tracks, m.fused_tracks).next(fusion)
        fused, by_bearings = bearing_only_vessels(bearings, fused, int(associations.vessel.max(initial=-1)) + 1)
    with timer("picture"):
        shown = PictureInput(tracks, associations, fused, alarms, time_s, sensors, by_bearings, detection, hearing, jumped)
        picture_memory, (picture, members) = s.picture.step(m.picture, shown)
        sound = limits.are_sound(picture.position_deg, picture.covariance)
        odd = ~sound & ~limits.are_near_a_pole(picture.position_deg)
        good = sound & picture_memory.confirmed
        if not good.all():
            members = members.take(~np.isin(members.vessel_id, picture.vessel_id[~good]))
            picture = picture.take(good)
    with timer("alarms"):
        numbered_zones = numbered(s.zones) if zones is None else zones
        watched = AlarmInput(picture, members, time_s, sensors, numbered_zones, cover, hearing)
        alarms_memory, vessel_alarms = s.alarms.step(m.alarms, watched)
    with timer("octants"):
        octants_memory, octants = s.octants.step(m.octants, OctantInput(bearing_tracks, picture, sensors, m.bearing_bias_rad))
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
        bearing_bias_rad=bearing_associations.sensor_bias_rad,
        beside=beside,
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
        RadarCorrections.empty(R=len(sensors.radars)),
        vessel_alarms=vessel_alarms,
        events=events,
        unsound=int(odd.sum()),
        left_out=left_out,
    )
