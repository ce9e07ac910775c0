"""Quality of a task's result: association F1, position error, compactness of spots."""

from __future__ import annotations

import numpy as np

from coastwatch.scores.confusion import Confusion, count_decisions
from scaling.peers.exchange import RADAR, Ints, TaskResult, TrackHistory


def quality(kind: str, history: TrackHistory, result: TaskResult) -> tuple[str, float]:
    """Name and value of the quality figure. Args: kind: a task of `scaling.peers.ours`."""
    if kind == "association":
        return "F1 %", 100.0 * float(decisions(history, result.pairs).as_dict()["f1"])
    if kind == "spots":
        return "RMS to centre m", rms_to_centre_m(history, result.spot)
    return "RMSE m", position_rmse_m(history, result)


def decisions(history: TrackHistory, pairs: Ints) -> Confusion:
    """Counts over radar tracks and measured cycles: is there an AIS track of the same vessel, and which?"""
    radar = np.flatnonzero(history.source == RADAR)
    exists = np.bincount(history.vessel)[history.vessel[radar]] > 1
    right_pair = history.vessel[pairs[:, 1]] == history.vessel[pairs[:, 2]]
    total = Confusion()
    for cycle in range(history.first, len(history.time_s)):
        now = pairs[:, 0] == cycle
        right, wrong = (np.isin(radar, pairs[now & which, 1]) for which in (right_pair, ~right_pair))
        total = total + count_decisions(exists, right, wrong)
    return total


def position_rmse_m(history: TrackHistory, result: TaskResult) -> float:
    """Root mean square position error, two-dimensional, of the vessels with two tracks at the measured cycles."""
    both = np.bincount(history.vessel) > 1
    error = (result.position_m - history.true_position_m[history.first :])[:, both]
    return float(np.sqrt((error**2).sum(axis=2).mean()))


def rms_to_centre_m(history: TrackHistory, spot: Ints) -> float:
    """Root mean square distance of the tracks from the mean of their spot, at the last cycle."""
    last, size = history.position_m[-1], np.bincount(spot)
    mean = np.stack([np.bincount(spot, last[:, k]) for k in range(2)], axis=1) / np.maximum(size, 1)[:, None]
    return float(np.sqrt(((last - mean[spot]) ** 2).sum(axis=1).mean()))
