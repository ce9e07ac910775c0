"""The flow of a regional centre: the video of its radars becomes reports, these become plots, and the plots tracks.

A regional centre knows its own radars only, so its cost and memory do not depend on the other regions. It may run in another process
or on another machine (`coastwatch.workers`). What goes there and back are `RegionReports` and `RegionCycle`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from coastwatch.batches import (
    DecidedPath,
    Extractions,
    Ints,
    Measurements,
    Messages,
    Plots,
    RadarCorrections,
    RadarReports,
    Sensors,
    StandingEchoes,
    Tracks,
    Unproven,
    Videos,
)
from coastwatch.plots import ExtractionInput, ExtractionMemory, PlotConverter, PlotExtractor, PolarMemory, over_background
from coastwatch.scenario import Scenario
from coastwatch.stage import Groups, Running
from coastwatch.tracks import ForestMemory, ImmJpdaMemory, ParticlesMemory, RadarMemory, RadarTracker, RegionInput


@dataclass(frozen=True)
class RegionMemory:
    """The memory of a regional centre between two cycles: plain data."""

    extraction: ExtractionMemory
    plots: PolarMemory
    tracks: RadarMemory | ForestMemory | ImmJpdaMemory | ParticlesMemory
    dropped: int  # plots that are not finite or from the future, since the start


@dataclass(frozen=True, eq=False)
class RegionReports:
    """What a regional centre is given in a cycle. Radars have their numbers within the region."""

    reports: RadarReports
    messages: Messages  # AIS, if its tracker takes them
    corrections: RadarCorrections
    time_s: float
    sensors: Sensors  # with these radars
    radars: Ints  # (R,) their numbers among all, in order
    region: int
    video: Videos = Videos()  # of these radars


@dataclass(frozen=True, eq=False)
class RegionCycle:
    """What a regional centre yields in a cycle. Radars have their numbers among all."""

    tracks: Tracks
    measurements: Measurements  # the plots and messages of this cycle in these tracks
    standing_echoes: StandingEchoes
    plots: Plots  # for registration and cover
    decided: DecidedPath  # the past that became final; empty for trackers that decide at once
    extractions: Extractions = field(default_factory=Extractions.empty)
    unproven: Unproven = Unproven()  # choices of its tracker


def start_region(scenario: Scenario) -> RegionMemory:
    """The memory of a regional centre before the first cycle."""
    return RegionMemory(scenario.extraction.init(), scenario.plots.init(), scenario.tracks.init(), 0)


def step_of_regions(scenario: Scenario) -> Callable[[RegionMemory, RegionReports], tuple[RegionMemory, RegionCycle]]:
    """One cycle of a regional centre, as a `coastwatch.stage.RegionMap` takes it."""
    return partial(run_regional_centre, scenario.extraction, scenario.plots, scenario.tracks)


def run_regional_centre(
    extractor: PlotExtractor, converter: PlotConverter, tracker: RadarTracker, memory: RegionMemory, given: RegionReports
) -> tuple[RegionMemory, RegionCycle]:
    """One cycle of a regional centre. Tracks that hold plots of a radar whose corrections have jumped are dropped."""
    sensors, radars = given.sensors, given.radars
    seen = ExtractionInput(given.video, sensors)
    extraction_memory, (extracted, summary) = extractor.step(memory.extraction, seen)
    video = over_background(extraction_memory, seen) if tracker.takes_video else ()
    reports = RadarReports.join([given.reports, extracted]) if len(extracted) else given.reports
    plots_memory, plots = converter.step(memory.plots, reports, sensors, given.corrections)
    jumped = given.corrections.jumped
    tracks_memory, found = Running(tracker, memory.tracks).next(
        RegionInput(plots, given.messages, jumped, given.time_s, sensors, given.region, video)
    )
    measurements, standing, decided = found.measurements, found.standing_echoes, found.decided
    after = RegionMemory(extraction_memory, plots_memory, tracks_memory, memory.dropped + found.dropped)
    return after, RegionCycle(
        found.tracks,
        replace(measurements, sensor=radars[measurements.sensor]),
        replace(standing, radar=radars[standing.radar]),
        replace(plots, sensor=radars[plots.sensor]),
        replace(decided, radar=np.where(decided.radar < 0, -1, radars[np.maximum(decided.radar, 0)])),
        replace(summary, radar=radars[summary.radar]),
        found.unproven,
    )


def reports_of_regions(
    reports: RadarReports,
    messages: list[Messages],
    corrections: RadarCorrections,
    time_s: float,
    sensors: Sensors,
    video: Videos,
) -> tuple[list[RegionReports], int]:
    """What each regional centre is given, and how many reports are of an unknown radar. Radars have the noise that was learnt.

    Args: reports, corrections, video: of all radars; messages: for each region.
    """
    radars, factor = sensors.radars, corrections.noise_factor
    radars = replace(
        radars, range_sigma_m=factor[:, 0] * radars.range_sigma_m, azimuth_sigma_rad=factor[:, 1] * radars.azimuth_sigma_rad
    )
    known = (reports.sensor >= 0) & (reports.sensor < len(radars))
    if not known.all():
        reports = reports.take(known)
    count = len(sensors.region_names)
    rows, ours = Groups.by_key(radars.region[reports.sensor], count), Groups.by_key(radars.region, count)
    given = []
    for k in range(count):
        own, mine = ours.of(k), reports.take(rows.of(k))
        given.append(
            RegionReports(
                replace(mine, sensor=np.searchsorted(own, mine.sensor)),
                messages[k],
                corrections.take(own),
                time_s,
                replace(sensors, radars=radars.take(own)),
                own,
                k,
                Videos(tuple(replace(p, sensor=int(np.searchsorted(own, p.sensor))) for p in video.parts if p.sensor in own)),
            )
        )
    return given, int((~known).sum())
