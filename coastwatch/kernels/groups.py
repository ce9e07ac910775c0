"""Rows brought together by a small number that each has: one pass to count, one to place."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def grouped(group, halo_group, halo_row, count):  # type: ignore[no-untyped-def]
    """Rows by group, members ascending, and after them the rows of its halo as -1 - row, as they come.

    Args: group: (N,) of each row, 0 to count - 1; halo_group, halo_row: (H,). Returns: (N + H,) rows, (count + 1,) where groups start.
    """
    start = np.zeros(count + 1, np.int64)
    for r in range(len(group)):
        start[group[r] + 1] += 1
    inside = start[1:].copy()
    for h in range(len(halo_group)):
        start[halo_group[h] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    row, place, beside = np.empty(len(group) + len(halo_group), np.int64), start[:-1].copy(), start[:-1] + inside
    for r in range(len(group)):
        row[place[group[r]]] = r
        place[group[r]] += 1
    for h in range(len(halo_group)):
        row[beside[halo_group[h]]] = -1 - halo_row[h]
        beside[halo_group[h]] += 1
    return row, start


@njit(cache=True, nogil=True)
def parted(row, start, rank, home):  # type: ignore[no-untyped-def]
    """What `grouped` put together: the group of every member into `home`, by its rank.

    Args: rank: (N,) of every row; home: (N,), -1 where a row is no member. Returns: how many members; groups and rows of the halo, (H,).
    """
    halo = 0
    for k in range(len(start) - 1):
        for at in range(start[k], start[k + 1]):
            if row[at] >= 0:
                home[rank[row[at]]] = k
            else:
                halo += 1
    halo_group, halo_row = np.empty(halo, np.int32), np.empty(halo, np.int64)
    halo = 0
    for k in range(len(start) - 1):
        for at in range(start[k], start[k + 1]):
            if row[at] < 0:
                halo_group[halo], halo_row[halo] = k, -1 - row[at]
                halo += 1
    return len(row) - halo, halo_group, halo_row


@njit(cache=True)
def _placed(value, count, order):  # type: ignore[no-untyped-def]
    """The order by value; where values are equal, as it was. Args: value: (A,) 0 to count - 1; order: (A,). Returns: (A,)."""
    place, out = np.zeros(count + 1, np.int32), np.empty(len(order), np.int32)
    for a in range(len(value)):
        place[value[a] + 1] += 1
    for k in range(count):
        place[k + 1] += place[k]
    for a in order:
        out[place[value[a]]] = a
        place[value[a]] += 1
    return out


@njit(cache=True, nogil=True)
def by_both(first, firsts, second, seconds):  # type: ignore[no-untyped-def]
    """The order by first, then second. Args: first: (A,) 0 to firsts - 1; second: (A,) 0 to seconds - 1. Returns: (A,)."""
    return _placed(first, firsts, _placed(second, seconds, np.arange(len(first)).astype(np.int32)))


@njit(cache=True, nogil=True)
def combined(first, firsts, second, seconds):  # type: ignore[no-untyped-def]
    """Numbers of the combinations that there are, ascending by first, then second. Args: as `by_both`. Returns: (A,) numbers; how many."""
    out, count, before = np.empty(len(first), np.int64), 0, -1
    for a in by_both(first, firsts, second, seconds):
        if before < 0 or first[a] != first[before] or second[a] != second[before]:
            count += 1
        out[a], before = count - 1, a
    return out, count


@njit(cache=True, nogil=True)
def alone(first, second, gain, rows):  # type: ignore[no-untyped-def]
    """Whether a pair with a positive gain is the only such one with its first as first, and with its second as second. Returns: (A,)."""
    firsts, seconds = np.zeros(rows, np.uint8), np.zeros(rows, np.uint8)
    for a in range(len(first)):
        if gain[a] > 0.0:
            firsts[first[a]] = min(firsts[first[a]] + 1, 2)
            seconds[second[a]] = min(seconds[second[a]] + 1, 2)
    out = np.empty(len(first), np.bool_)
    for a in range(len(first)):
        out[a] = gain[a] > 0.0 and firsts[first[a]] == 1 and seconds[second[a]] == 1
    return out
