"""Which vessels each sensor of bearings may hear, and passes over the pairs of bearing tracks and vessels. Scalar code compiled by numba.

Pairs are sorted by track; those of track i are first[i] to first[i + 1]. An octant is sensor * 8 + sector.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes
from coastwatch.kernels.jit import jit

SECTORS = 8
SECTOR_DEG = 360.0 / SECTORS


@jit
def within_sectors(direction, tolerance, sensor, row, sensors):  # type: ignore[no-untyped-def]
    """The vessels of each octant: those in it, and those no farther outside than their tolerance.

    Args: of H vessels, sorted by row: direction, tolerance: (H,) degrees; sensor: (H,); row: (H,).
    Returns: (G,) rows by octant, sorted in it; (8 sensors + 1,) where each octant begins.
    """
    mask, start = np.zeros(len(row), np.uint8), np.zeros(SECTORS * sensors + 1, np.int64)
    for h in range(len(row)):
        own = math.floor(direction[h] / SECTOR_DEG) % SECTORS
        for k in range(SECTORS):
            off = (-(direction[h] - (k + 0.5) * SECTOR_DEG) + 180.0) % 360.0 - 180.0
            if k == own or abs(off) <= SECTOR_DEG / 2.0 + tolerance[h]:
                mask[h] |= 1 << k
                start[SECTORS * sensor[h] + k + 1] += 1
    for k in range(1, len(start)):
        start[k] += start[k - 1]
    out, at = np.empty(start[-1], np.int64), start[:-1].copy()
    for h in range(len(row)):
        for k in range(SECTORS):
            if mask[h] & (1 << k):
                out[at[SECTORS * sensor[h] + k]] = row[h]
                at[SECTORS * sensor[h] + k] += 1
    return out, start


@jit
def paired(octant, start, row):  # type: ignore[no-untyped-def]
    """Each track with all vessels of its octant. Args: octant: (N,) of each track; start, row: of `within_sectors`.

    Returns: (A,) tracks, (A,) rows of vessels, (A,) octants.
    """
    count = 0
    for o in octant:
        count += start[o + 1] - start[o]
    track, vessel, of = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    count = 0
    for i in range(len(octant)):
        for k in range(start[octant[i]], start[octant[i] + 1]):
            track[count], vessel[count], of[count] = i, row[k], octant[i]
            count += 1
    return track, vessel, of


@jit
def first_pairs(bearing_row, tracks):  # type: ignore[no-untyped-def]
    """Where the pairs of each track begin. Args: bearing_row: (A,) sorted, 0 to tracks - 1. Returns: (tracks + 1,)."""
    first = np.zeros(tracks + 1, np.int64)
    for i in bearing_row:
        first[i + 1] += 1
    for i in range(tracks):
        first[i + 1] += first[i]
    return first


@jit
def by_octant(first, octant, sensors):  # type: ignore[no-untyped-def]
    """The tracks that have pairs, by octant. Args: octant: (A,). Returns: (T,) rows; (8 sensors + 1,) where each octant begins."""
    start = np.zeros(SECTORS * sensors + 2, np.int64)
    for i in range(len(first) - 1):
        if first[i] < first[i + 1]:
            start[octant[first[i]] + 2] += 1
    for k in range(2, len(start)):
        start[k] += start[k - 1]
    row = np.empty(start[-1], np.int64)
    for i in range(len(first) - 1):
        if first[i] < first[i + 1]:
            k = octant[first[i]] + 1
            row[start[k]] = i
            start[k] += 1
    return row, start[:-1].copy()


@jit
def heard_by(track, start, first, vessel_row, vessels):  # type: ignore[no-untyped-def]
    """Each pair of a sensor and a vessel in its octants once.

    Args: track, start: of `by_octant`; first: (N + 1,); vessel_row: (A,), 0 to vessels - 1.
    Returns: (P,) rows of vessels, sorted within a sensor; (sensors + 1,) where those of each sensor begin.
    """
    sensors, count = len(start) // SECTORS, 0
    begin, last = np.zeros(sensors + 1, np.int64), np.full(vessels, -1, np.int32)
    out = np.empty(len(vessel_row), np.int64)
    for s in range(sensors):
        for t in range(start[SECTORS * s], start[SECTORS * (s + 1)]):
            for p in range(first[track[t]], first[track[t] + 1]):
                if last[vessel_row[p]] != s:
                    last[vessel_row[p]], out[count] = s, vessel_row[p]
                    count += 1
        out[begin[s] : count].sort()
        begin[s + 1] = count
    return out[:count].copy(), begin


@jit
def inside(low, high, begin, row, position, site, reach, arc_from, arc_width, out):  # type: ignore[no-untyped-def]
    """Whether each vessel is within reach of its sensor, low to high, and in its arc, in the tangent plane at the sensor.

    Args: begin, row: of `heard_by`; position: (V, 2) degrees; site: (S, 2), NaN: unknown; reach: (S,) m; arc_from, arc_width: (S,) rad.
    out: (P,) written.
    """
    for s in range(low, high):
        x, y, z, sp, cp, sl, cl = ecef_and_axes(site[s, 0], site[s, 1])
        for p in range(begin[s], begin[s + 1]):
            px, py, pz, _, _, _, _ = ecef_and_axes(position[row[p], 0], position[row[p], 1])
            dx, dy, dz = px - x, py - y, pz - z
            east, north = cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy)
            out[p] = math.hypot(east, north) <= reach[s]
            if out[p]:
                out[p] = (math.atan2(east, north) - arc_from[s]) % (2.0 * math.pi) <= arc_width[s]


@jit
def standing(low, high, begin, row, sensor, vessel, out):  # type: ignore[no-untyped-def]
    """Which pair of `heard_by` is that of each sensor and vessel, low to high, which must be among them.

    Args: sensor, vessel: (A,). out: (A,) written.
    """
    for a in range(low, high):
        first, last = begin[sensor[a]], begin[sensor[a] + 1] - 1
        while first < last:
            middle = (first + last) // 2
            if row[middle] < vessel[a]:
                first = middle + 1
            else:
                last = middle
        out[a] = first


@jit
def medians(group, value, groups):  # type: ignore[no-untyped-def]
    """How many values each group has, and their median, NaN for none. Args: (A,) 0 to groups - 1, (A,). Returns: (groups,), (groups,)."""
    start = np.zeros(groups + 2, np.int64)
    for g in group:
        start[g + 2] += 1
    for g in range(2, groups + 2):
        start[g] += start[g - 1]
    values, count, median = np.empty(len(value)), np.zeros(groups, np.int64), np.full(groups, np.nan)
    for a in range(len(value)):
        values[start[group[a] + 1]] = value[a]
        start[group[a] + 1] += 1
    for g in range(groups):
        mine = values[start[g] : start[g + 1]]
        count[g] = n = len(mine)
        if n > 0:
            mine.sort()
            median[g] = 0.5 * (mine[(n - 1) // 2] + mine[n // 2])
    return count, median


@jit
def pairs_of(track, first, value):  # type: ignore[no-untyped-def]
    """The value of each pair of some tracks, one track after the other.

    Args: track: (R,); first: (N + 1,); value: (A,). Returns: (R + 1,) where those of each track begin; (L,) values.
    """
    start = np.zeros(len(track) + 1, np.int64)
    for r in range(len(track)):
        start[r + 1] = start[r] + first[track[r] + 1] - first[track[r]]
    out = np.empty(start[-1], np.int64)
    for r in range(len(track)):
        shift = first[track[r]] - start[r]
        for k in range(start[r], start[r + 1]):
            out[k] = value[k + shift]
    return start, out


@jit
def above(track, first, start, gain, threshold):  # type: ignore[no-untyped-def]
    """Pairs with a greater gain than the threshold. Args: of `pairs_of`; gain: (L,). Returns: which of L they are, which of A."""
    which, pair, count = np.empty(len(gain), np.int64), np.empty(len(gain), np.int64), 0
    for r in range(len(track)):
        shift = first[track[r]] - start[r]
        for k in range(start[r], start[r + 1]):
            if gain[k] > threshold:
                which[count], pair[count] = k, k + shift
                count += 1
    return which[:count].copy(), pair[:count].copy()


@jit
def merged(ids, slot, last_s, new, time_s):  # type: ignore[no-untyped-def]
    """Ids with slots, and more of them at a later time; ids without a slot get the lowest that are free.

    Args: ids, slot, last_s: (V,), sorted by id; new: (M,) sorted. Returns: ids, slot, last_s of all; (M,) slots of the new.
    """
    most, v, count = -1, 0, 0
    for k in range(len(slot)):
        most = max(most, slot[k])
    room = len(ids) + len(new)
    free, lowest = np.ones(room + most + 1, np.bool_), 0
    for k in range(len(slot)):
        free[slot[k]] = False
    every, slots, last, given = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room), np.empty(len(new), np.int64)
    for m in range(len(new) + 1):
        while v < len(ids) and (m == len(new) or ids[v] < new[m]):
            every[count], slots[count], last[count] = ids[v], slot[v], last_s[v]
            v, count = v + 1, count + 1
        if m == len(new):
            break
        if v < len(ids) and ids[v] == new[m]:
            given[m], v = slot[v], v + 1
        else:
            while not free[lowest]:
                lowest += 1
            given[m], free[lowest] = lowest, False
        every[count], slots[count], last[count] = new[m], given[m], time_s
        count += 1
    return every[:count].copy(), slots[:count].copy(), last[:count].copy(), given
