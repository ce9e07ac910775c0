"""Scores of the whole paths of the radar tracks of a few targets: as they were shown at the time, and with hindsight."""

from __future__ import annotations

import numpy as np

from coastwatch import kernels
from coastwatch.batches import ID_STRIDE, DecidedPath, Floats, Ints
from coastwatch.geodesy import from_plane, to_plane
from coastwatch.kernels.filters.smoothing import Steps
from coastwatch.kernels.tracks.thesis_growth import process_noise
from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.systems import as_paths
from coastwatch.reproduction.targets import cycles
from coastwatch.scenario import Scenario
from coastwatch.scores.track_loss import initiation_scores, path_scores, shadow_scores
from coastwatch.sensors import StartStates
from coastwatch.server.timing import Stopwatch
from coastwatch.tracks import ForestMemory, MultiHypothesisLiteral, RadarMemory
from coastwatch.tracks.radar.multi_hypothesis.trees import decide_open
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import Decided
from coastwatch.tracks.radar.multi_hypothesis_literal.initiation import transition
from coastwatch.tracks.radar.report import report_decided

SAME_S = 1e-3  # a plot and the end of its cycle that are closer are of one instant


def measure(scenario: Scenario, seed: int, asked: TrackLoss) -> dict[str, float | None]:
    """The scores of the tracks of region 0 from the first instant of the truth on.

    Returns: those of `path_scores` with hindsight, and as `online_...` as shown at the time; of `initiation_scores` and `shadow_scores`
    as shown; smoothed_rmsd_m: of the whole final paths of the literal tracker, smoothed; look_s: mean time of a step of the tracker.
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
    if isinstance(memory, RadarMemory):
        rest = decide_open(memory.without_reported().forest, memory.table, memory.table.live)
        past.append(report_decided(rest.decided, sensors, 0))
    final_m = as_paths(corrected(shown, DecidedPath.join(past), instants_s, site_deg))
    smoothed_rmsd_m: float | None = None
    if isinstance(memory, ForestMemory) and isinstance(method, MultiHypothesisLiteral):
        every = Decided.join([*decided, memory.open_path()])
        both = [
            as_paths([(every.number[at], position_m[at]) for at in (every.time_s == now_s for now_s in instants_s)])
            for position_m in (
                to_plane(from_plane(state[:, :2], region_deg), site_deg)
                for state in (every.state, smoothed(every, method.process_noise))
            )
        ]
        final_m = both[0]
        smoothed_rmsd_m = path_scores(both[1], true_m, asked.limit_m, asked.for_good)["rmsd_m"]
    hidden = np.zeros(true_m.shape[:2], np.bool_)
    if isinstance(scenario.input, StartStates):
        hidden = scenario.input.in_shadow(true_m)
    online = path_scores(online_m, true_m, asked.limit_m, asked.for_good)
    return {
        **path_scores(final_m, true_m, asked.limit_m, asked.for_good),
        **{f"online_{name}": value for name, value in online.items()},
        **initiation_scores(online_m, true_m, asked.limit_m, scenario.period_s),
        **shadow_scores(online_m, true_m, hidden, asked.near_m, asked.after_looks),
        "smoothed_rmsd_m": smoothed_rmsd_m,
        "look_s": float(np.mean(watch.seconds["tracks"])),
    }


def smoothed(path: Decided, noise: float) -> Floats:
    """The states of whole paths by all of their looks (D, 4), by Rauch, Tung and Striebel, thesis section 4.10.

    A look without a measurement is a step as any other. A report counts at its look, as between two looks the motion is one step.
    Args: path: in any order, each instant of a track once; noise: factor of the process noise.
    """
    if not len(path):
        return path.state
    order = np.lexsort((path.time_s, path.number))
    path, count = path.take(order), len(path)
    same = np.append(False, path.number[1:] == path.number[:-1])[:count]
    mean, covariance = path.state.copy(), path.covariance.copy()  # before the first look of a track; not used
    elapsed_s = np.diff(path.time_s, prepend=0.0)
    for step_s in np.unique(elapsed_s[same]):
        rows = np.flatnonzero(same & (elapsed_s == step_s))
        move = transition(float(step_s))
        mean[rows] = path.state[rows - 1] @ move.T
        covariance[rows] = move @ path.covariance[rows - 1] @ move.T + process_noise(float(step_s), noise)
    first = np.flatnonzero(~same)
    end = np.repeat(np.append(first[1:], count), np.diff(np.append(first, count)))  # of the track of each row
    later = np.arange(count)[:, None] + np.arange((end - np.arange(count)).max(initial=0))
    steps = Steps(path.time_s, path.state, path.covariance, mean, covariance)
    out = np.empty((count, 4))
    out[order] = kernels.filters.smoothing.fixed_lag(steps, np.where(later < end[:, None], later, -1))[0]
    return out


def corrected(
    shown: list[tuple[Ints, Floats]], past: DecidedPath, instants_s: list[float], site_deg: Floats
) -> list[tuple[Ints, Floats]]:
    """The paths as decided later, and as shown where nothing was, of tracks that were ever shown.

    Args: shown: names (n,) and positions (n, 2) at each instant.
    """
    ever = np.concatenate([name for name, _ in shown])
    past = past.take(np.flatnonzero(np.isin(past.track_id % ID_STRIDE, ever)))
    past = past.take(np.lexsort((past.time_s, past.track_id)))
    number, position_m = past.track_id % ID_STRIDE, to_plane(past.position_deg, site_deg)
    start = np.append(np.flatnonzero(np.diff(number, prepend=-1)), len(number))
    instant = np.array(instants_s)
    decided: list[tuple[Ints, Ints, Floats]] = []
    for first, end in zip(start[:-1].tolist(), start[1:].tolist(), strict=True):
        time_s = past.time_s[first:end]
        within = np.flatnonzero((instant > time_s[0] - SAME_S) & (instant < time_s[-1] + SAME_S))
        path_m = path_between(time_s, position_m[first:end], past.velocity_m_s[first:end], instant[within])
        decided.append((np.full(len(within), number[first]), within, path_m))
    if not decided:
        return shown
    names, at, where_m = (np.concatenate(column) for column in zip(*decided, strict=True))
    out = []
    for k, (name, shown_m) in enumerate(shown):
        here = at == k
        kept = ~np.isin(name, names[here])
        out.append((np.append(names[here], name[kept]), np.concatenate([where_m[here], shown_m[kept]])))
    return out


def path_between(time_s: Floats, position_m: Floats, velocity_m_s: Floats, instant_s: Floats) -> Floats:
    """Positions at some instants of a path that is known at others (n, 2): the cubic through both states about each.

    Given these states, that is the mean of a motion whose acceleration is white noise.
    Args: time_s: (N,) sorted; position_m, velocity_m_s: (N, 2); instant_s: between the first of them and the last.
    """
    time_s, at = np.unique(time_s, return_index=True)
    position_m, velocity_m_s = position_m[at], velocity_m_s[at]
    left = np.clip(np.searchsorted(time_s, instant_s, side="right") - 1, 0, max(len(time_s) - 2, 0))
    right = np.minimum(left + 1, len(time_s) - 1)
    span = np.maximum(time_s[right] - time_s[left], SAME_S)[:, None]
    u = np.clip((instant_s - time_s[left])[:, None] / span, 0.0, 1.0)
    chord = position_m[right] - position_m[left]
    bend = (1.0 - u) * (velocity_m_s[left] * span - chord) - u * (velocity_m_s[right] * span - chord)
    path: Floats = position_m[left] + u * chord + u * (1.0 - u) * bend
    return path
