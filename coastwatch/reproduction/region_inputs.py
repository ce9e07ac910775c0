"""What the first region of a scenario is given in each cycle: plots, also of video, and AIS reports. No stage after them runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from coastwatch.batches import AisReports, Plots, RadarCorrections, RadarExcess, RadarReports, Recording
from coastwatch.plots import ExtractionInput, HeadingMemory, over_background, true_azimuths
from coastwatch.scenario import Scenario


class CycleInput(NamedTuple):
    """The input of a cycle."""

    now_s: float  # its end
    plots: Plots
    ais: AisReports
    video: tuple[RadarExcess, ...]  # over the background; empty unless it was asked for


def cycle_inputs(scenario: Scenario, recording: Recording, first: int = 0, video: bool = False) -> Iterator[CycleInput]:
    """Each cycle from the first one asked for on. Video is let go once its plots are extracted, so a long stream needs no memory.

    Args: first: number of the cycle; video: it is wanted too.
    """
    sensors, plan, none = scenario.sensors(), scenario.plan(), RadarCorrections.empty(R=len(scenario.radars))
    converted, extraction, headings = scenario.plots.init(), scenario.extraction.init(), HeadingMemory()
    for cycle in range(first, plan.cycles):
        now_s = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1) if cycle else -np.inf, now_s)
        headings, reports = true_azimuths(headings, reports, sensors.radars)
        shown, radar = ExtractionInput(reports.video, sensors), reports.radar
        over: tuple[RadarExcess, ...] = ()
        if len(reports.video):
            extraction, (extracted, _) = scenario.extraction.step(extraction, shown)
            radar = RadarReports.join([radar, extracted])
            over = over_background(extraction, shown) if video else ()
        converted, plots = scenario.plots.step(converted, radar, sensors, none)
        yield CycleInput(now_s, plots, reports.ais, over)
