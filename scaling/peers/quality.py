"""How good an answer is: association F1, errors of estimates, spread of spots."""

from __future__ import annotations

import numpy as np

from coastwatch.scores.confusion import Confusion, count_decisions
from scaling.peers.exchange import RADAR, Answer, Given, Ints


def quality(kind: str, given: Given, answer: Answer) -> tuple[str, float]:
    """The name of the figure and its value. Args: kind: of task, one of those of `scaling.peers.ours`."""
    if kind == "association":
        return "F1 %", 100.0 * float(decisions(given, answer.pairs).as_dict()["f1"])
    if kind == "spots":
        return "RMS to centre m", spread_m(given, answer.spot)
    return "RMSE m", position_rmse_m(given, answer)


def decisions(given: Given, pairs: Ints) -> Confusion:
    """One decision a radar track and measured cycle: is there an AIS track of the same vessel, and which?"""
    radar = np.flatnonzero(given.source == RADAR)
    exists = np.bincount(given.vessel)[given.vessel[radar]] > 1
    right_pair = given.vessel[pairs[:, 1]] == given.vessel[pairs[:, 2]]
    total = Confusion()
    for cycle in range(given.first, len(given.time_s)):
        now = pairs[:, 0] == cycle
        right, wrong = (np.isin(radar, pairs[now & which, 1]) for which in (right_pair, ~right_pair))
        total = total + count_decisions(exists, right, wrong)
    return total


def position_rmse_m(given: Given, answer: Answer) -> float:
    """Root mean square position error, two-dimensional, of the vessels with two tracks at the measured cycles."""
    both = np.bincount(given.vessel) > 1
    off = (answer.position_m - given.true_position_m[given.first :])[:, both]
    return float(np.sqrt((off**2).sum(axis=2).mean()))


def spread_m(given: Given, spot: Ints) -> float:
    """Root mean square distance of the tracks from the mean of their spot, at the last cycle."""
    last, size = given.position_m[-1], np.bincount(spot)
    mean = np.stack([np.bincount(spot, last[:, k]) for k in range(2)], axis=1) / np.maximum(size, 1)[:, None]
    return float(np.sqrt(((last - mean[spot]) ** 2).sum(axis=1).mean()))
