"""Pairs of neighbouring tracks that may be one vessel: gate and screening in one pass, nothing written for the rest."""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.association.history import fetch
from coastwatch.kernels.association.prune_pairs import screened
from coastwatch.kernels.geometry.bands import LONGITUDE_BITS, TURN
from coastwatch.kernels.geometry.ellipsoid import SEMI_MAJOR
from coastwatch.kernels.jit import jit

AHEAD = 16  # tracks that are asked for while one is worked on
ODD = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio


@jit
def _from(key, wanted):  # type: ignore[no-untyped-def]
    """The first place whose key is not less."""
    low, high = 0, len(key)
    while low < high:
        middle = (low + high) // 2
        if key[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def _reach(band, height, gate):  # type: ignore[no-untyped-def]
    """How far in longitude, in keys, a point within the gate of one in this band may lie; TURN: anywhere.

    A chord is no shorter than 2 r sin(turn / 2), r the lesser distance from the axis.
    """
    edge = max(abs((band - 1) * height - 90.0), abs((band + 2) * height - 90.0))
    half = gate / (2.0 * SEMI_MAJOR * math.cos(math.radians(edge))) if edge < 90.0 else 1.0
    if half >= 1.0:
        return TURN
    keys = int(math.ceil(math.asin(half) / math.pi * TURN)) + 1  # noqa: RUF046
    return keys if 2 * keys + 1 < TURN else TURN


@jit
def _near(low, high, i, point, reach2, found, count):  # type: ignore[no-untyped-def]
    """Add the points low to high that are of a later source than i and within the gate to those found. Returns: how many there are."""
    x, y, z, source = point[i, 0], point[i, 1], point[i, 2], point[i, 3]
    for at in range(low, high):
        dx, dy, dz = x - point[at, 0], y - point[at, 1], z - point[at, 2]
        found[count] = at
        count += (point[at, 3] > source) & (dx * dx + dy * dy + dz * dz <= reach2)  # neither can be foreseen: no branch
    return count


@jit
def _runs(i, key, reach, run):  # type: ignore[no-untyped-def]
    """Where those stand that may be within the gate of i: in its band and the two beside it, and there perhaps across the antimeridian.

    Args: run: (9, 2) starts and ends, those of the first three rows not after what is looked for; changed.
    Returns: how many of the rows count, 3 or 9; points in them.
    """
    band, here, count = key[i] >> LONGITUDE_BITS, key[i] & (TURN - 1), 0
    rows = 3 if here >= reach and here + reach < TURN else 9
    for k in range(3, rows):
        run[k, 0] = run[k, 1] = 0
    for k in range(3):
        base = (band + k - 1) << LONGITUDE_BITS
        low, high = (0, TURN - 1) if reach == TURN else (here - reach, here + reach)
        while run[k, 0] < len(key) and key[run[k, 0]] < base + max(low, 0):
            run[k, 0] += 1
        run[k, 1] = max(run[k, 0], run[k, 1])
        while run[k, 1] < len(key) and key[run[k, 1]] <= base + min(high, TURN - 1):
            run[k, 1] += 1
        if low < 0:
            run[3 + k, 0], run[3 + k, 1] = _from(key, base + low + TURN), _from(key, base + TURN)
        if high >= TURN:
            run[6 + k, 0], run[6 + k, 1] = _from(key, base), _from(key, base + high - TURN + 1)
    for k in range(rows):
        count += run[k, 1] - run[k, 0]
    return rows, count


@jit
def _hole(table, word):  # type: ignore[no-untyped-def]
    """Where a word stands in a table, or would stand: the place of it or of a hole."""
    place = np.int64((np.uint64(word) * ODD) >> np.uint64(32)) & (len(table) - 1)
    while table[place] >= 0 and table[place] != word:
        place = (place + 1) & (len(table) - 1)
    return place


@jit
def _word(home, row):  # type: ignore[no-untyped-def]
    return np.int64(home) << 32 | np.int64(row)


@jit
def fill_halo(home, row, table):  # type: ignore[no-untyped-def]
    """Enter the spots and the rows in their halos. Args: home, row: (H,); table: (a power of 2, more than H,) of -1."""
    for k in range(len(home)):
        word = _word(home[k], row[k])
        table[_hole(table, word)] = word


@jit
def _owned(i, home, track, row, halo, found, count):  # type: ignore[no-untyped-def]
    """Leave those of the points found that are in the spot of i or in its halo. Returns: how many."""
    left = 0
    for k in range(count):
        j = found[k]
        if home[j] != home[i]:
            word = _word(home[i], row[track[j]])
            if halo[_hole(halo, word)] != word:
                continue
        found[left] = j
        left += 1
    return left


@jit
def _grown(array):  # type: ignore[no-untyped-def]
    out = np.empty(2 * len(array), array.dtype)
    for k in range(len(array)):
        out[k] = array[k]
    return out


@jit
def candidates(low, high, key, point, home, track, row, halo, height, last, length, record, outline, rule, cut):  # type: ignore[no-untyped-def]
    """Pairs of which the first is one of the points low to high and a member, and that are not hopeless.

    Args:
        key: (L,) of `bands`, sorted; point: (L, 4) Earth-centred, and the source; home: (L,) number of the spot that each is a member of,
        -1 for none; track: (L,) rank of each; row: (N,) of every rank, as the tracks came.
        halo: of `fill_halo`; height: `bands.height_deg` of the gate; last: the highest source;
        length, record, outline: of the tracks, by rank; cut: of `screening.cuts`.
    Returns: (A,), (A,) tracks by rank, the first of the lower source; (A,) density around the first, a square metre; how many
    pairs were within the gate.
    """
    first, second = np.empty(high - low + 64, np.int64), np.empty(high - low + 64, np.int64)
    density, found, run = np.empty(high - low + 64), np.empty(256, np.int64), np.zeros((9, 2), np.int64)
    out, tested, band, reach, asked = 0, 0, -1, 0, 0
    for i in range(low, high):
        fetch(record.ctypes.data + 128 * track[min(i + AHEAD, len(track) - 1)] + 64)  # type: ignore[call-arg]
        if home[i] < 0 or point[i, 3] == last:
            continue
        if key[i] >> LONGITUDE_BITS != band:
            band = key[i] >> LONGITUDE_BITS
            reach = _reach(band, height, rule.gate)
            for k in range(3):
                run[k, 0] = run[k, 1] = _from(key, ((band + k - 1) << LONGITUDE_BITS) + max((key[i] & (TURN - 1)) - reach, 0))
        count = 0
        rows, most = _runs(i, key, reach, run)
        for near in range(max(asked, run[2, 0]), min(run[2, 1] + AHEAD, len(track))):
            fetch(outline.ctypes.data + 128 * track[near])
            fetch(outline.ctypes.data + 128 * track[near] + 64)
        asked = run[2, 1] + AHEAD
        if most >= len(found):
            found = np.empty(2 * most, np.int64)
        for k in range(rows):
            count = _near(run[k, 0], run[k, 1], i, point, rule.gate * rule.gate, found, count)
        count = _owned(i, home, track, row, halo, found, count)
        tested += count
        while out + count > len(first):
            first, second, density = _grown(first), _grown(second), _grown(density)
        around = max(count - 1, 1) / (math.pi * (rule.gate * rule.gate))
        a = track[i]
        left = screened(a, track, found, count, around, length, record, outline, rule, cut)
        for k in range(left):
            first[out], second[out], density[out] = a, track[found[k]], around
            out += 1
    return first[:out], second[:out], density[:out], tested
