"""Rows brought together by a small number that each has: one pass to count, one to place."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def parted(row, start, rank, home):  # type: ignore[no-untyped-def]
    """The group of every member into `home`, by its rank, and who is in whose halo.

    Args: row: (L,) of all groups, members as they are, halo as -1 - row; start: (K + 1,) of each group; rank: (N,) of every row;
        home: (N,), -1 where a row is no member.
    Returns: how many members; groups and rows of the halo, (H,).
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
