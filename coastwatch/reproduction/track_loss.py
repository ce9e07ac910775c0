"""Scores of the whole paths of the radar tracks of a few targets: as they were shown at the time, and with hindsight."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import ID_STRIDE, DecidedPath, Floats, Ints
from coastwatch.geodesy import from_plane, to_plane
from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.systems import as_paths
from coastwatch.reproduction.targets import cycles
from coastwatch.scenario import Scenario
from coastwatch.scores.track_loss import initiation_scores, path_scores, shadow_scores
from coastwatch.sensors import StartStates
from coastwatch.server.timing import Stopwatch
from coastwatch.tracks import ForestMemory, MultiHypothesisLiteral
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import Decided

SAME_S = 1e-3  # a plot and the end of its cycle that are closer are of one instant


def measure(scenario: Scenario, seed: int, asked: TrackLoss) -> dict[str, float | None]:
    """The scores of the tracks of region 0 from the first instant of the truth on.

    Returns: those of `path_scores` with hindsight, and as `online_...` as shown at the time; of `initiation_scores` and `shadow_scores`
    as shown; look_s: mean time of a step of the tracker.
    """
    sensors = scenario.sensors()
    recording = scenario.input.load(sensors, seed, scenario.plan())
    assert recording.truth is not None
    watch, site_deg, region_deg = Stopwatch(), sensors.radars.site_deg[0], sensors.region_origin_deg[0]
    method, start_s = scenario.tracks, float(recording.truth.time_s[0])
    instants_s = [at for at in map(scenario.plan().instant_s, range(scenario.plan().cycles)) if at >= start_s]
    first, begun = scenario.plan().cycles - len(instants_s), scenario.tracks.init()
    true = [(now.vessel, to_plane(now.position_deg, site_deg)) for now in map(recording.truth.at, instants_s)]
    shown: list[tuple[Ints, Floats]] = []
    decided, past = [], []
    if isinstance(method, MultiHypothesisLiteral) and first:  # it is told of the tracks, where others get a lead-in
        now = recording.truth.at(start_s)
        begun = method.begun(np.hstack([to_plane(now.position_deg, region_deg), now.velocity_m_s]), start_s)
        decided.append(begun.decided)
        shown.append((begun.trees.number, to_plane(now.position_deg, site_deg)))
    for now_s, memory, found in cycles(scenario, method, recording, begun, first + 1 if shown else 0, watch):
        if now_s >= start_s:
            number = found.tracks.track_id % ID_STRIDE
            shown.append((number, to_plane(found.tracks.position_deg, site_deg)))
            past.append(found.decided)
            if isinstance(memory, ForestMemory):
                decided.append(memory.decided)
    true_m, online_m = as_paths(true), as_paths(shown)
    final_m = as_paths(corrected(shown, DecidedPath.join(past), instants_s, site_deg))
    if isinstance(memory, ForestMemory):
        every = Decided.join([*decided, memory.open_path()])
        position_m = to_plane(from_plane(every.state[:, :2], region_deg), site_deg)
        final_m = as_paths([(every.number[at], position_m[at]) for at in (every.time_s == now_s for now_s in instants_s)])
    hidden = np.zeros(true_m.shape[:2], np.bool_)
    if isinstance(scenario.input, StartStates):
        hidden = scenario.input.in_shadow(true_m)
    online = path_scores(online_m, true_m, asked.limit_m, asked.for_good)
    return {
        **path_scores(final_m, true_m, asked.limit_m, asked.for_good),
        **{f"online_{name}": value for name, value in online.items()},
        **initiation_scores(online_m, true_m, asked.limit_m, scenario.period_s),
        **shadow_scores(online_m, true_m, hidden, asked.near_m, asked.after_looks),
        "look_s": float(np.mean(watch.seconds["tracks"])),
    }


def corrected(
    shown: list[tuple[Ints, Floats]], past: DecidedPath, instants_s: list[float], site_deg: Floats
) -> list[tuple[Ints, Floats]]:
    """The paths as decided later, and as shown where nothing was, of tracks that were ever shown.

    Args: shown: names (n,) and positions (n, 2) at each instant.
    """
    number, ever = past.track_id % ID_STRIDE, np.concatenate([name for name, _ in shown])
    position_m, out = to_plane(past.position_deg, site_deg), []
    for now_s, (name, shown_m) in zip(instants_s, shown, strict=True):
        at = np.flatnonzero((np.abs(past.time_s - now_s) < SAME_S) & np.isin(number, ever))
        kept = ~np.isin(name, number[at])
        out.append((np.append(number[at], name[kept]), np.concatenate([position_m[at], shown_m[kept]])))
    return out
