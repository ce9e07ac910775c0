"""Reception times of records whose time stamps may be wrong, and which records are repetitions."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, Bools, Floats
from coastwatch.formats.intake.faults import SET_ASIDE

LATE = SET_ASIDE + "late, taken in order of arrival"
BACKWARDS = "time going backwards"
FAR = "time far from the rest"
TIME_MISSING = "time missing"

SORTED = "not in order of time: sorted by it (input.intake.order)"
LEAST_OUT_OF_ORDER = 0.05  # share of records going back in time, from which on the order of a file is not that of arrival
LEAST_STRETCH = 3.0  # of them in a row, on average; wrong readings of a clock come singly


class ReceptionTimes(NamedTuple):
    """Of each record: its time of reception, whether its stamp is accepted, and a mask per kind of fault."""

    received_s: Floats
    accepted: Bools
    faults: dict[str, Bools]


def reception_times(stamp_s: Floats, lateness_s: float, longest_silence_s: float) -> ReceptionTimes:
    """Reception times of the records of a stream, from stamps that may be late, early or wrong.

    The order of the file is the order of arrival: a record arrives at the newest accepted stamp up to it. A stamp that is older
    than that by up to `lateness_s` is a late record. If silences longer than `longest_silence_s` divide the stamps, the part with
    most records is kept. If stamps contradict each other by more than `lateness_s`, the longest ordered run is accepted: one
    wrong clock reading in the future does not reject all records after it.

    Args: stamp_s: (M,) finite. Returns: arrays (M,).
    """
    main_part = _largest_part(stamp_s, longest_silence_s)
    accepted = main_part.copy()
    rows = np.flatnonzero(main_part)
    t = stamp_s[rows]
    if len(t) and (np.maximum.accumulate(t) - t).max() > lateness_s:
        chain = np.zeros(len(t), np.bool_)
        chain[_longest_in_order(t.tolist())] = True
        low = np.maximum.accumulate(np.where(chain, t, -np.inf))  # the nearest of the longest run, before and after
        high = np.minimum.accumulate(np.where(chain, t, np.inf)[::-1])[::-1]
        accepted[rows] = (t >= low - lateness_s) & (t <= high + lateness_s)
    received = np.maximum.accumulate(np.where(accepted, stamp_s, -np.inf))
    accepted &= received - stamp_s <= 2.0 * lateness_s  # late after a record that was itself early
    late = accepted & (stamp_s < received)
    return ReceptionTimes(received, accepted, {FAR: ~main_part, BACKWARDS: main_part & ~accepted, LATE: late})


def is_out_of_order(stamp_s: Floats, lateness_s: float, longest_silence_s: float) -> bool:
    """Whether the order of records is plainly not that of arrival: sorted by vessel, newest first. Args: stamp_s: (M,) finite."""
    backwards = reception_times(stamp_s, lateness_s, longest_silence_s).faults[BACKWARDS]
    stretches = int(np.diff(backwards, prepend=False).sum() + 1) // 2
    count = int(backwards.sum())
    return count > LEAST_OUT_OF_ORDER * len(stamp_s) and count >= LEAST_STRETCH * stretches


def backwards_note(count: int) -> tuple[str, ...]:
    """What to say of a file with so many records that were refused because they go back in time."""
    many = f"{count:,} go back in time and are not used: --set input.intake.order=time sorts the file first"
    return (many,) if count else ()


def _largest_part(stamp_s: Floats, longest_silence_s: float) -> Bools:
    if not len(stamp_s):
        return np.zeros(0, np.bool_)
    order = np.argsort(stamp_s, kind="stable")
    part = np.concatenate([[0], np.cumsum(np.diff(stamp_s[order]) > longest_silence_s)])
    is_largest = np.zeros(len(stamp_s), np.bool_)
    is_largest[order[part == np.bincount(part).argmax()]] = True
    return is_largest


def _longest_in_order(t: Sequence[float]) -> list[int]:
    """Indices of a longest non-decreasing subsequence (patience sorting)."""
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
    indices = []
    i = at[-1] if at else -1
    while i >= 0:
        indices.append(i)
        i = before[i]
    return indices[::-1]


def repeated(keys: Sequence[Array], time_s: Floats, within_s: float) -> Bools:
    """Which records have the same keys as one at most `within_s` before them. Of equal times the first in order is kept.

    Args: keys: each (M,); time_s: (M,). Returns: (M,).
    """
    is_repeated = np.zeros(len(time_s), np.bool_)
    order = np.lexsort((time_s, *keys))
    same = np.ones(max(len(order) - 1, 0), np.bool_)
    for key in keys:
        same &= key[order[1:]] == key[order[:-1]]
    is_repeated[order[1:]] = same & (np.diff(time_s[order]) <= within_s)
    return is_repeated
