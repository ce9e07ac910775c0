"""Scores of the radar tracks of a few targets, beside the bound: the same filters with the origin of every plot known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from coastwatch.batches import RadarCorrections, Sensors, Tracks, Truth
from coastwatch.geodesy import difference_m
from coastwatch.operators.reproduction.published import Targets
from coastwatch.scenario import Scenario
from coastwatch.scores.targets import TargetScores
from coastwatch.stage import Method
from coastwatch.tracks.imm import Imm, SidedImm
from coastwatch.tracks.motion import Motion
from coastwatch.tracks.track_management import TrackManagement

NEVER = 10**6  # turns or seconds that no run has: tracks of known origin end with their targets


def measure(scenario: Scenario, seed: int, asked: Targets) -> dict[str, Any]:
    """The scores of the tracks of region 0, and as `genie_...` those of the bound."""
    both = {"": scenario.tracks, "genie_": of_known_origin(scenario)}
    return {
        f"{name}{key}": value for name, method in both.items() for key, value in _run(scenario, method, seed, asked).items()
    }


def of_known_origin(scenario: Scenario) -> Method:
    """The filters of a scenario's tracker, given every plot of a target and no other."""
    upkeep = TrackManagement(delete_misses=NEVER, misses_per_hit=NEVER, coast_s=NEVER)
    motion = scenario.tracks.motion
    if isinstance(motion, Motion):
        return Imm(plot_origin="known", motion=motion, upkeep=upkeep)
    return SidedImm(plot_origin="known", motion=motion, upkeep=upkeep)


def _run(scenario: Scenario, method: Any, seed: int, asked: Targets) -> dict[str, float | None]:
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, seed, plan), RadarCorrections.none(len(sensors.radars))
    assert recording.truth is not None
    scores = TargetScores(asked.cutoff_m, asked.near_m)
    memory, converted = method.init(), scenario.plots.init()
    known = getattr(method, "plot_origin", "estimated") == "known"
    echo_m = getattr(scenario.tracks.upkeep, "echo_sigma_m", 0.0)
    for cycle in range(plan.cycles):
        since = plan.instant_s(cycle - 1) if cycle else -np.inf
        reports = recording.reports.between(since, plan.instant_s(cycle)).radar
        converted, plots = scenario.plots.step(converted, reports, sensors, none)
        if known:  # the bound knows all noise
            plots = replace(plots, covariance=plots.covariance + echo_m**2 * np.eye(2))
        memory, tracks, _ = method.step(memory, plots, plan.instant_s(cycle), sensors, 0)
        truth = recording.truth.at(plan.instant_s(cycle))
        scores = scores.seen(truth, _counted(tracks, truth, sensors, asked.within_m, known))
    return scores.as_dict()


def _counted(tracks: Tracks, truth: Truth, sensors: Sensors, within_m: float, known: bool) -> Tracks:
    """The tracks in the area; where the origin is known those of targets that are there."""
    near = np.hypot(*difference_m(tracks.position_deg, sensors.radars.site_deg[0]).T) <= within_m
    return tracks.take(np.isin(tracks.origin, truth.vessel) if known else near)
