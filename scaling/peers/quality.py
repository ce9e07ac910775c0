"""Quality of a task's result: association F1, position error, compactness of spots, completeness of tracks."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.scores.confusion import Confusion, count_decisions
from coastwatch.scores.ospa import gospa
from scaling.peers.exchange import RADAR, Ints, PlotHistory, TaskResult, TrackHistory
from scaling.peers.plots import in_cover

CUTOFF_M = 100.0  # of GOSPA of tracks: twice the largest cross-range error of one plot


def quality(kind: str, history: Any, result: TaskResult) -> tuple[str, float]:
    """Name and value of the quality figure. Args: kind: a task of `scaling.peers.ours`; history: its input."""
    if kind == "tracking":
        return "GOSPA m a vessel", track_figures(history, result)["gospa_m"]
    if kind in ("association", "counting"):
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


def track_figures(history: PlotHistory, result: TaskResult) -> dict[str, float]:
    """Confirmed tracks against the vessels in cover, over the measured cycles, by the assignment of GOSPA.

    Returns: completeness (share of vessels with a track within `CUTOFF_M`); false tracks a cycle; position RMSE of the
    assigned tracks; GOSPA, the root of its mean square per vessel.
    """
    vessels = assigned = false = 0
    squares_m2 = gospa_m2 = 0.0
    for cycle in range(history.first, len(history.time_s)):
        mine = result.tracks[result.tracks[:, 0] == cycle, 2:4]
        found, true = (p[in_cover(history, p)] for p in (mine, history.true_position_m[cycle]))
        made = gospa(found, true, CUTOFF_M, 2.0)
        vessels, assigned, false = vessels + len(true), assigned + made.assigned_count, false + made.false_count
        squares_m2, gospa_m2 = squares_m2 + made.localisation, gospa_m2 + made.total_m**2
    return {
        "completeness": assigned / vessels,
        "false_tracks": false / history.measured,
        "rmse_m": float(np.sqrt(squares_m2 / max(assigned, 1))),
        "gospa_m": float(np.sqrt(gospa_m2 / vessels)),
    }


def rms_to_centre_m(history: TrackHistory, spot: Ints) -> float:
    """Root mean square distance of the tracks from the mean of their spot, at the last cycle."""
    last, size = history.position_m[-1], np.bincount(spot)
    mean = np.stack([np.bincount(spot, last[:, k]) for k in range(2)], axis=1) / np.maximum(size, 1)[:, None]
    return float(np.sqrt(((last - mean[spot]) ** 2).sum(axis=1).mean()))
