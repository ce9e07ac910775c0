"""The flow of a cycle: the reports of all sensors become tracks in the regional centres, and a picture in the high-level centre.

It consumes the memory: (memory, reports) -> (memory, what the stages yielded).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from coastwatch.alarms import (
    Numbered,
)
from coastwatch.batches import (
    AisAlarms,
    AisDetection,
    BearingTracks,
    DecidedPath,
    ExpectedVessels,
    Extractions,
    Fault,
    Measurements,
    Messages,
    Plots,
    RadarCorrections,
    RadarCover,
    Reports,
    Sensors,
    StandingEchoes,
    Tracks,
    Unproven,
    limits,
)
from coastwatch.centre import CentreMemory, Cycle, Received, Timer, run_centre, start_centre
from coastwatch.cover import CoverInput, RadarCoverageMemory, SilenceInput, SilenceMemory
from coastwatch.plots import HeadingMemory, true_azimuths
from coastwatch.regional import RegionMemory, reports_of_regions, start_region, step_of_regions
from coastwatch.registration import RegistrationInput, RegistrationMemory
from coastwatch.scenario import Scenario
from coastwatch.stage import Map, RegionMap, Running, serial_regions
from coastwatch.tracks import AisInput, AisMemory, Antennas, BearingInput, BearingMemory, ReceivedInput, ReceivedMemory
from coastwatch.tracks.bearing.vessels import expected_vessels
from coastwatch.tracks.radar.messages import messages_of

LEFT_OUT = {
    "tracks": "choices of the plots of a crowd of tracks not proven best: each is the best one found within the limit of nodes",
    "associations": "pairs of tracks not compared: each track of a crowd is compared with the nearest alone",
    "alarms": "pairs of vessels not watched for close approach: of each vessel of a crowd the nearest and most urgent are",
    "octants": "pairs of a bearing and a vessel not compared: each bearing track is compared with the nearest in direction",
    "bearing_tracks": "bearings not used: more than a cycle takes of one sensor or contact",
    "azimuths": "plots and spokes of a ship not used: no heading of it within 5 s",
}
"""What `left_out` counts, by stage: at most so many choices, pairs, bearings, plots or spokes."""


@dataclass(frozen=True)
class Memory:
    """The memory of every stage: plain data, saved as arrays with a schema, with which a run resumes bit for bit.

    While a worker keeps the memory of a region, something else stands in its place. `gathered` gives the plain data.
    """

    regions: tuple[RegionMemory, ...]  # or what stands for it while a worker keeps it
    ais_positions: Antennas
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
    # By sensors without contact numbers, in the next cycle
    expected: ExpectedVessels = field(default_factory=ExpectedVessels.empty)
    beyond: dict[str, int] = field(default_factory=dict)  # reports, tracks and vessels that were dropped as none, by kind
    left_out: dict[str, int] = field(default_factory=dict)  # as of Cycle, of all cycles
    unproven: Unproven = Unproven()  # choices of the trackers of all regions and cycles
    unknown_radar: int = 0  # reports of a radar that the scenario does not have
    headings: HeadingMemory = field(default_factory=HeadingMemory)  # of ships with radars that count azimuths from the bow


def start_run(scenario: Scenario, sensors: Sensors) -> Memory:
    """The memory before the first cycle."""
    s = scenario
    return Memory(
        tuple(start_region(s) for _ in sensors.region_names),
        s.ais_positions.init(),
        s.ais_tracks.init(),
        s.bearing_tracks.init(),
        s.received_tracks.init(),
        start_centre(s),
        s.registration.init(),
        RadarCorrections.empty(R=len(sensors.radars)),
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
    counts += [("bearing not used: far from the others of its contact", "bearing_tracks", m.bearing_tracks.far_off)]
    counts += [
        (f"track state dropped: {stamp}, or a newer one is known", "received_tracks", int(m.received_tracks.dropped.sum()))
    ]
    counts += [(limits.BEYOND + kind, "pipeline", count) for kind, count in m.beyond.items()]
    counts += [(LEFT_OUT[stage], stage, count) for stage, count in m.left_out.items()]
    examples = {"tracks": f"their costs sum to at most {m.unproven.excess:.3g} more than the least, as log-likelihoods"}
    return tuple(Fault(kind, count, where, examples.get(where, "")) for kind, where, count in counts if count)


def run_cycle(
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
    headings, reports = true_azimuths(m.headings, reports, sensors.radars)
    with timer("ais_tracks"):
        antennas, of_hulls = s.ais_positions.step(m.ais_positions, (reports.ais, reports.statics, time_s))
        heard = AisInput(of_hulls, time_s, sensors)
        ais_memory, (ais_tracks, alarms, ais_taken) = s.ais_tracks.step(m.ais_tracks, heard)
    with timer("tracks"):
        messages = [
            messages_of(ais_taken, ais_tracks, sensors, k, alarms.interval_s) if s.tracks.takes_messages else Messages.empty()
            for k in range(len(sensors.region_names))
        ]
        region_inputs, unknown = reports_of_regions(reports.radar, messages, m.corrections, time_s, sensors, reports.video)
        stepped = regions(step_of_regions(s), m.regions, region_inputs)
        regional_memory, regional = tuple(after for after, _ in stepped), [cycle for _, cycle in stepped]
    heard_bearings = BearingInput(reports.bearing, time_s, sensors, m.expected)
    with timer("bearing_tracks"):
        bearing_memory, bearing_tracks = s.bearing_tracks.step(m.bearing_tracks, heard_bearings)
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
    hulls = s.ais_positions.hull_offsets(antennas, time_s)
    received = Received(
        tracks,
        measurements,
        alarms,
        bearing_tracks,
        reports.statics,
        m.ais_detection,
        m.radar_cover,
        hearing,
        m.corrections.jumped,
        hulls,
    )
    centre_memory, cycle = run_centre(s, sensors, m.centre, received, time_s, map_, timer, zones)
    with timer("bearing_tracks"):
        expected = expected_vessels(*bearing_memory.unnumbered(), cycle.picture, cycle.bearing_associations, sensors)
    beyond = _summed(m.beyond, beyond, unsound, {"vessel of the picture": cycle.unsound})
    of_bearings, of_azimuths = bearing_memory.left_out - m.bearing_tracks.left_out, headings.left_out - m.headings.left_out
    unproven = sum((region.unproven for region in regional), Unproven())
    left_out = {"tracks": unproven.count, "bearing_tracks": of_bearings, "azimuths": of_azimuths}
    left_out = _summed(cycle.left_out, left_out)
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
            hulls,
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
        decided=DecidedPath.join([region.decided for region in regional]),
        left_out=left_out,
        extractions=Extractions.join([region.extractions for region in regional]),
    )
    after = Memory(
        regions=regional_memory,
        ais_positions=antennas,
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
        expected=expected,
        beyond=beyond,
        left_out=_summed(m.left_out, left_out),
        unproven=m.unproven + unproven,
        unknown_radar=m.unknown_radar + unknown,
        headings=headings,
    )
    return after, cycle


def _sound(
    tracks: Tracks, measurements: Measurements, alarms: AisAlarms, bearings: BearingTracks
) -> tuple[Tracks, Measurements, AisAlarms, BearingTracks, dict[str, int]]:
    """The same without tracks whose state is none, and how many those are: no later stage can use them.

    A track that passes the highest latitude ends, and is not counted.
    """
    good = limits.are_sound(tracks.position_deg, tracks.covariance)
    seen = np.isfinite(bearings.bearing_rad) & np.isfinite(bearings.covariance.sum(axis=(1, 2)))
    if good.all() and seen.all():
        return tracks, measurements, alarms, bearings, {}
    gone = tracks.track_id[~good]
    kept = measurements.take(~np.isin(measurements.track_id, gone)), alarms.take(~np.isin(alarms.track_id, gone))
    counts = {"track": int((~good & ~limits.are_near_a_pole(tracks.position_deg)).sum()), "bearing track": int((~seen).sum())}
    return tracks.take(good), *kept, bearings.take(seen), counts


def _summed(*parts: dict[str, int]) -> dict[str, int]:
    """The sums of counts by kind, without zeros."""
    sums: dict[str, int] = {}
    for counts in parts:
        for kind, count in counts.items():
            if count:
                sums[kind] = sums.get(kind, 0) + count
    return sums
