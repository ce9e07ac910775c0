"""Rows brought together by a small number that each has: one pass to count, one to place."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit

NOWHERE, NEAR = -1, -2  # the group of a row that is in none, and of one that is only in halos


@jit
def parted(row, start, rank):  # type: ignore[no-untyped-def]
    """The group of every member, and who is in whose halo.

    Args: row: (L,) of all groups, members as they are, halo as -1 - row; start: (K + 1,) of each group; rank: (N,) of every row.
    Returns: how many members; the lowest rank that there is; (R,) group of that and those after it up to the highest: NOWHERE, or NEAR of
    one in halos alone; groups and rows of the halo, (H,).
    """
    low, high, halo = len(rank), -1, 0
    for at in range(len(row)):
        here = rank[row[at] if row[at] >= 0 else -1 - row[at]]
        low, high, halo = min(low, here), max(high, here), halo + (row[at] < 0)
    home = np.full(max(high - low + 1, 0), NOWHERE, np.int32)
    halo_group, halo_row = np.empty(halo, np.int32), np.empty(halo, np.int64)
    halo = 0
    for k in range(len(start) - 1):
        for at in range(start[k], start[k + 1]):
            if row[at] >= 0:
                home[rank[row[at]] - low] = k
                continue
            halo_group[halo], halo_row[halo] = k, -1 - row[at]
            halo += 1
            place = rank[-1 - row[at]] - low
            if home[place] == NOWHERE:
                home[place] = NEAR
    return len(row) - halo, low, home, halo_group, halo_row


@jit
def gathered(low, home, most, key, point):  # type: ignore[no-untyped-def]
    """Those that are somewhere, in order of rank. Args: low, home: of `parted`; most: that there may be; key: (N,); point: (N, 4), by rank.

    Returns: keys, points, groups and ranks of L of them, (L,) but for points (L, 4); the greatest last number of a point, at least 0.
    """
    keys, points = np.empty(most, np.int64), np.empty((most, 4))
    homes, track = np.empty(most, np.int32), np.empty(most, np.int32)
    count, top = 0, 0.0
    for place in range(len(home)):
        if home[place] != NOWHERE:
            keys[count], homes[count], track[count] = key[low + place], home[place], low + place
            for k in range(4):
                points[count, k] = point[low + place, k]
            top = max(top, points[count, 3])
            count += 1
    return keys[:count], points[:count], homes[:count], track[:count], top


@jit
def greatest(point, column):  # type: ignore[no-untyped-def]
    """Of a column, at least 0."""
    most = 0.0
    for n in range(len(point)):
        most = max(most, point[n, column])
    return most


@jit
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


@jit
def by_both(first, firsts, second, seconds):  # type: ignore[no-untyped-def]
    """The order by first, then second. Args: first: (A,) 0 to firsts - 1; second: (A,) 0 to seconds - 1. Returns: (A,)."""
    return _placed(first, firsts, _placed(second, seconds, np.arange(len(first)).astype(np.int32)))


@jit
def combined(first, firsts, second, seconds):  # type: ignore[no-untyped-def]
    """Numbers of the combinations that there are, ascending by first, then second. Args: as `by_both`. Returns: (A,) numbers; how many."""
    out, count, before = np.empty(len(first), np.int64), 0, -1
    for a in by_both(first, firsts, second, seconds):
        if before < 0 or first[a] != first[before] or second[a] != second[before]:
            count += 1
        out[a], before = count - 1, a
    return out, count


@jit
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
