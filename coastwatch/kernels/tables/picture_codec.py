"""Rows of a picture and its members as columns of 64-bit words, and back. V vessels, L members sorted by vessel, N rows of a part.

Words of a row: number, time, latitude, longitude, velocity east and north, since, updated, MMSI, flags, origin, count of members, the
upper triangle of the covariance (10), and its lower triangle less the upper one (6): both are the same to a few last bits.
"""

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch

AHEAD = 16  # rows that are asked for while one is copied: a part's rows are neighbours at sea, and lie anywhere in the picture
COUNT = 11  # the column of the count of members
WORDS = 28


@jit
def _fetch_row(v, single, position, velocity, covariance, first):  # type: ignore[no-untyped-def]
    number, time, since, updated, mmsi, flags, origin = single
    fetch(number, v)
    fetch(time, v)
    fetch(since, v)
    fetch(updated, v)
    fetch(mmsi, v)
    fetch(flags, v)
    fetch(origin, v)
    fetch(position, v)
    fetch(velocity, v)
    fetch(covariance, v)
    fetch(first, v)


@jit
def _covariance_words(covariance, v, i, out):  # type: ignore[no-untyped-def]
    upper, lower = COUNT + 1, COUNT + 11
    for r in range(4):
        for c in range(r, 4):
            out[upper, i] = covariance[v, r, c]
            upper += 1
            if c > r:
                out[lower, i] = covariance[v, c, r] - covariance[v, r, c]
                lower += 1


@jit
def _covariance(words, i, out):  # type: ignore[no-untyped-def]
    upper, lower = COUNT + 1, COUNT + 11
    for r in range(4):
        for c in range(r, 4):
            out[r, c] = words[upper, i]
            upper += 1
            if c > r:
                out[c, r] = words[lower, i] + out[r, c]
                lower += 1


@jit
def row_words(rows, single, position, velocity, covariance, first, out):  # type: ignore[no-untyped-def]
    """Words of some rows.

    Args: rows: (N,) which; single: seven (V,) of number, time, since, updated, MMSI, flags, origin; position, velocity: (V, 2);
    covariance: (V, 4, 4), all uint64; first: (V + 1,) where the members of each vessel begin; out: (WORDS, N) uint64, written.
    """
    number, time, since, updated, mmsi, flags, origin = single
    for i in range(len(rows)):
        v = rows[i]
        _fetch_row(rows[min(i + AHEAD, len(rows) - 1)], single, position, velocity, covariance, first)
        out[0, i], out[1, i] = number[v], time[v]
        out[2, i], out[3, i] = position[v, 0], position[v, 1]
        out[4, i], out[5, i] = velocity[v, 0], velocity[v, 1]
        out[6, i], out[7, i] = since[v], updated[v]
        out[8, i], out[9, i], out[10, i] = mmsi[v], flags[v], origin[v]
        out[COUNT, i] = np.uint64(first[v + 1] - first[v])
        _covariance_words(covariance, v, i, out)


@jit
def rows_of(words, to, single, position, velocity, covariance):  # type: ignore[no-untyped-def]
    """Rows from their words, each written to its place. Args: words: (WORDS, N); to: (N,); the others as of `row_words`, written."""
    number, time, since, updated, mmsi, flags, origin = single
    for i in range(len(to)):
        v = to[i]
        number[v], time[v] = words[0, i], words[1, i]
        position[v, 0], position[v, 1] = words[2, i], words[3, i]
        velocity[v, 0], velocity[v, 1] = words[4, i], words[5, i]
        since[v], updated[v] = words[6, i], words[7, i]
        mmsi[v], flags[v], origin[v] = words[8, i], words[9, i], words[10, i]
        _covariance(words, i, covariance[v])


@jit
def member_starts(number, vessel, out):  # type: ignore[no-untyped-def]
    """Where the members of each vessel begin. Args: number: (V,), vessel: (L,), sorted; out: (V + 1,). Returns: how many have a vessel."""
    m, found = 0, 0
    for v in range(len(number)):
        while m < len(vessel) and vessel[m] < number[v]:
            m += 1
        out[v] = m
        while m < len(vessel) and vessel[m] == number[v]:
            m += 1
        found += m - out[v]
    out[len(number)] = m
    return found


@jit
def member_words(rows, first, track, source, place, base_first, out, out_place):  # type: ignore[no-untyped-def]
    """Track and source of the members of some rows, and the member of the base that each is likely to repeat.

    Args: rows, first: as of `row_words`; track, source: (L,) uint64; place: (N,) row of the base, -1 for none; base_first: (B + 1,)
    where the members of each row of the base begin; out: (2, M) uint64, out_place: (M,), written.
    """
    k, last = 0, len(rows) - 1
    for i in range(len(rows)):
        fetch(first, rows[min(i + 2 * AHEAD, last)])
        soon = first[rows[min(i + AHEAD, last)]]
        fetch(track, soon)
        fetch(source, soon)
        p, low, count = place[i], first[rows[i]], first[rows[i] + 1] - first[rows[i]]
        same = p >= 0 and base_first[p + 1] - base_first[p] == count
        for j in range(count):
            out[0, k], out[1, k] = track[low + j], source[low + j]
            out_place[k] = base_first[p] + j if same else -1
            k += 1


@jit
def member_places(count, place, base_first, out):  # type: ignore[no-untyped-def]
    """`out_place` of `member_words` from the counts of members alone. Args: count: (N,) uint64."""
    k = 0
    for i in range(len(count)):
        n = np.int64(count[i])
        p = place[i]
        same = p >= 0 and base_first[p + 1] - base_first[p] == n
        for j in range(n):
            out[k] = base_first[p] + j if same else -1
            k += 1


@jit
def members_of(words, count, to, first, vessel, track, source):  # type: ignore[no-untyped-def]
    """Members from their words, each vessel's to its place.

    Args: words: (2, M); count, to: (N,); first: (V + 1,); vessel, a row, track, source: (L,), written.
    """
    k = 0
    for i in range(len(to)):
        for j in range(np.int64(count[i])):
            at = first[to[i]] + j
            vessel[at], track[at], source[at] = to[i], words[0, k], words[1, k]
            k += 1


@jit
def whereabouts(number, known, slot, out, fresh):  # type: ignore[no-untyped-def]
    """Which row stands in each slot of an earlier cycle; returns how many rows have none.

    Args: number: (V,) sorted; known: (B,) sorted, slot: (B,) of each; out: (B,) row of each slot, -1 where it is gone; fresh: (V,)
    rows that were not known, written.
    """
    k, count = 0, 0
    out[:] = -1
    for v in range(len(number)):
        while k < len(known) and known[k] < number[v]:
            k += 1
        if k < len(known) and known[k] == number[v]:
            out[slot[k]] = v
        else:
            fresh[count] = v
            count += 1
    return count
