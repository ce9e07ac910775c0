"""What the database keeps of a picture beside its numbers: speed and course, ellipse, half of a covariance, set of sources, owners."""

import math

import numpy as np

from coastwatch.kernels.jit import jit

KNOT = 1852.0 / 3600.0
DEGREE = math.pi / 180.0
SPREAD = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio (Fibonacci hashing)


@jit
def _turn(degrees, whole):  # type: ignore[no-untyped-def]
    """A direction within a turn of 0 into [0, whole), or NaN: to the bit the remainder, which is a call."""
    up = degrees + whole if degrees < 0.0 else degrees + 0.0
    return 0.0 if up >= whole else up


@jit
def motion_rows(low, high, velocity, covariance, moving, upper, known):  # type: ignore[no-untyped-def]
    """Fills rows low to high.

    Args: velocity: (V, 2) east, north in m/s; covariance: (V, 4, 4).
    moving: (V, 5) knots, degrees true in [0, 360) (NaN for what stands still), 1-sigma half axes in metres, direction of the longer
    one in degrees clockwise from north, [0, 180). upper: (V, 10) upper triangle of the covariance row by row. known: (V,)
    whether no part of that is NaN.
    """
    for v in range(low, high):
        east, north = velocity[v, 0], velocity[v, 1]
        speed = math.hypot(east, north)
        course = math.nan
        if speed > 0.0:
            course = _turn(math.atan2(east, north) / DEGREE, 360.0)
        moving[v, 0], moving[v, 1] = speed / KNOT, course
        xx, xy, yy = covariance[v, 0, 0], covariance[v, 0, 1], covariance[v, 1, 1]
        mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        direction = 0.5 * math.atan2(2.0 * xy, yy - xx) / DEGREE
        moving[v, 2] = math.sqrt(mean + half) if mean + half > 0.0 else mean + half - (mean + half)
        moving[v, 3] = math.sqrt(mean - half) if mean - half > 0.0 else mean - half - (mean - half)
        moving[v, 4] = _turn(direction, 180.0)
        k, total = 0, 0.0
        for i in range(4):
            for j in range(i, 4):
                upper[v, k] = covariance[v, i, j]
                total += covariance[v, i, j]
                k += 1
        known[v] = not math.isnan(total)


@jit
def _set_slot(table, parent, last, here, source):  # type: ignore[no-untyped-def]
    """Where the set that is another one and a source is in a table of sets, or the free place where it would be."""
    at = np.int64(((np.uint64(here) << np.uint64(32)) ^ np.uint64(source)) * SPREAD >> np.uint64(40)) & (len(table) - 1)
    while table[at] > 0 and (parent[table[at]] != here or last[table[at]] != source):
        at = (at + 1) & (len(table) - 1)
    return at


@jit
def source_sets(vessel_id, members, code, parent, last):  # type: ignore[no-untyped-def]
    """Numbers the sets of sources that vessels have; gives how many there are, -1 where they are more than there is room for.

    Args: vessel_id: (V,) sorted; members: (L, 3) vessel, source, track, sorted. code: (V,) number of the vessel's set, 0 is the empty one.
    parent, last: (S,) each set is that of its parent and one more source, of a higher number than those. S is a power of two.
    """
    table = np.zeros(2 * len(parent), np.int64)
    count, row = 1, 0
    for v in range(len(vessel_id)):
        here = 0
        while row < len(members) and members[row, 0] < vessel_id[v]:
            row += 1
        while row < len(members) and members[row, 0] == vessel_id[v]:
            source = members[row, 1]
            row += 1
            if here > 0 and last[here] == source:
                continue
            at = _set_slot(table, parent, last, here, source)
            if table[at] == 0:
                if count == len(parent):
                    return -1
                table[at], parent[count], last[count] = count, here, source
                count += 1
            here = table[at]
        code[v] = here
    return count


@jit
def _slot(table, shift, members, source, track):  # type: ignore[no-untyped-def]
    """Where a track's row of `members` is in a table, or the free place where it would be."""
    at = np.int64(((np.uint64(track) ^ (np.uint64(source) << np.uint64(40))) * SPREAD) >> shift)
    while table[at] >= 0 and (members[table[at], 2] != track or members[table[at], 1] != source):
        at = (at + 1) & (len(table) - 1)
    return at


@jit
def vessel_of(members, source, track, out):  # type: ignore[no-untyped-def]
    """Fills (A,) with the vessel that has each track, -1 where none has. Args: members: (L, 3) vessel, source, track."""
    bits = 1
    while (1 << bits) < 2 * len(members):
        bits += 1
    table, shift = np.full(1 << bits, -1, np.int32), np.uint64(64 - bits)
    for row in range(len(members)):
        table[_slot(table, shift, members, members[row, 1], members[row, 2])] = row
    for a in range(len(out)):
        row = table[_slot(table, shift, members, source[a], track[a])]
        out[a] = members[row, 0] if row >= 0 else -1
