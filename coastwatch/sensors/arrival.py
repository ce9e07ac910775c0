"""In which order records arrived, when, and which times cannot be believed; which records say the same again."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, Bools, Floats
from coastwatch.sensors.faults import SET_ASIDE

LATE = SET_ASIDE + "late, taken in order of arrival"
BACKWARDS = "time going backwards"
FAR = "time far from the rest"


class Arrival(NamedTuple):
    """For each record: when it arrived, whether its time is believed, and the masks of each kind of fault."""

    received_s: Floats
    believed: Bools
    faults: dict[str, Bools]


def arrive(stamp_s: Floats, lateness_s: float, longest_silence_s: float) -> Arrival:
    """When each record of a stream arrived, from stamps that may be late, early or wrong.

    The order of the file is the order of arrival, so a record arrives when the newest believed stamp before it says. A stamp
    that is older than that by up to the lateness is a late record. Stamps across a silence that no stream keeps are not of this
    stream: the part with most records stays. Where stamps contradict each other by more than the lateness, the longest run
    of stamps in order is believed, so that one wrong clock reading in the future does not condemn all that follows.

    Args: stamp_s: (M,) finite. Returns: arrays (M,).
    """
    mainland = _most_populous(stamp_s, longest_silence_s)
    believed = mainland.copy()
    rows = np.flatnonzero(mainland)
    t = stamp_s[rows]
    if len(t) and (np.maximum.accumulate(t) - t).max() > lateness_s:
        low, high = _corridor(t)
        believed[rows] = (t >= low - lateness_s) & (t <= high + lateness_s)
    received = np.maximum.accumulate(np.where(believed, stamp_s, -np.inf))
    believed &= received - stamp_s <= 2.0 * lateness_s  # late behind a record that was itself early
    late = believed & (stamp_s < received)
    return Arrival(received, believed, {FAR: ~mainland, BACKWARDS: mainland & ~believed, LATE: late})


def _most_populous(stamp_s: Floats, longest_silence_s: float) -> Bools:
    if not len(stamp_s):
        return np.zeros(0, np.bool_)
    order = np.argsort(stamp_s, kind="stable")
    part = np.concatenate([[0], np.cumsum(np.diff(stamp_s[order]) > longest_silence_s)])
    out = np.zeros(len(stamp_s), np.bool_)
    out[order[part == np.bincount(part).argmax()]] = True
    return out


def _corridor(t: Floats) -> tuple[Floats, Floats]:
    """The stamps of the longest run in order, next at or before and next at or after each record."""
    chain = np.zeros(len(t), np.bool_)
    chain[_longest_in_order(t.tolist())] = True
    low = np.maximum.accumulate(np.where(chain, t, -np.inf))
    high = np.minimum.accumulate(np.where(chain, t, np.inf)[::-1])[::-1]
    return low, high


def _longest_in_order(t: Sequence[float]) -> list[int]:
    """Indices of a longest non-decreasing run, by patience: for each length the smallest end found so far."""
    ends: list[float] = []
    at: list[int] = []
    before = [-1] * len(t)
    for i, value in enumerate(t):
        length = bisect_right(ends, value)
        before[i] = at[length - 1] if length else -1
        if length == len(ends):
            ends.append(value)
            at.append(i)
        else:
            ends[length], at[length] = value, i
    out = []
    i = at[-1] if at else -1
    while i >= 0:
        out.append(i)
        i = before[i]
    return out[::-1]


def repeated(keys: Sequence[Array], time_s: Floats, within_s: float) -> Bools:
    """Which records have the same keys as one at most this long before them; of equal times the first in order stays.

    Args: keys: each (M,); time_s: (M,). Returns: (M,).
    """
    out = np.zeros(len(time_s), np.bool_)
    order = np.lexsort((time_s, *keys))
    same = np.ones(max(len(order) - 1, 0), np.bool_)
    for key in keys:
        same &= key[order[1:]] == key[order[:-1]]
    out[order[1:]] = same & (np.diff(time_s[order]) <= within_s)
    return out
