"""Which vessels came close to which. P pieces of straight, steady motion; several a vessel, one after the other.

Time is cut into slots. In each slot every piece is put into a grid by where it is in the middle of its part of the slot; pieces of
neighbouring cells are then compared exactly, in continuous time. A table of pieces, (P, 8) float64: from and to, s; latitude, degrees,
and longitude, degrees east of a meridian to the west of all; their rates, degrees a second; metres a degree north and east there.
"""

import math

import numpy as np

from coastwatch.kernels.jit import jit

LEAST_NORTH = 110_574.0
"""Metres a degree of latitude at the equator: nowhere less. In the grid no two places are farther apart than at sea."""

FROM, TO, LATITUDE, LONGITUDE, NORTH_RATE, EAST_RATE, NORTH, EAST = range(8)


@jit
def _slots(of, from_time, slot):  # type: ignore[no-untyped-def]
    """First and last slot of a piece."""
    return int((of[FROM] - from_time) / slot), int((of[TO] - from_time) / slot)


@jit
def slot_entries(pieces, from_time, slot):  # type: ignore[no-untyped-def]
    """The pieces of each slot: (first entry of each slot and one more, piece of each entry)."""
    slots = 0
    for p in range(len(pieces)):
        slots = max(slots, _slots(pieces[p], from_time, slot)[1] + 1)
    first = np.zeros(slots + 1, np.int64)
    for p in range(len(pieces)):
        low, high = _slots(pieces[p], from_time, slot)
        first[low + 1 : high + 2] += 1
    for k in range(slots):
        first[k + 1] += first[k]
    piece, at = np.empty(first[slots], np.int64), first[:-1].copy()
    for p in range(len(pieces)):
        low, high = _slots(pieces[p], from_time, slot)
        for k in range(low, high + 1):
            piece[at[k]] = p
            at[k] += 1
    return first, piece


@jit
def closest(a, b, low, high):  # type: ignore[no-untyped-def]
    """Metres and time of the closest approach of two pieces between two times."""
    north, east = a[NORTH], a[EAST]
    y = (b[LATITUDE] + b[NORTH_RATE] * (low - b[FROM]) - a[LATITUDE] - a[NORTH_RATE] * (low - a[FROM])) * north
    x = (b[LONGITUDE] + b[EAST_RATE] * (low - b[FROM]) - a[LONGITUDE] - a[EAST_RATE] * (low - a[FROM])) * east
    v, u = (b[NORTH_RATE] - a[NORTH_RATE]) * north, (b[EAST_RATE] - a[EAST_RATE]) * east
    square = u * u + v * v
    passed = min(max(-(x * u + y * v) / square, 0.0), high - low) if square > 0.0 else 0.0
    return math.hypot(x + u * passed, y + v * passed), low + passed


@jit
def _spread(pieces, chosen, low, high, least_east, out):  # type: ignore[no-untyped-def]
    """Where pieces are in the middle of their parts of a slot, metres; returns the farthest that one is from there at either end."""
    farthest = 0.0
    for i in range(len(chosen)):
        of = pieces[chosen[i]]
        since, until = max(low, of[FROM]), min(high, of[TO])
        half, middle = 0.5 * (until - since), 0.5 * (until + since) - of[FROM]
        out[i, 0] = (of[LATITUDE] + of[NORTH_RATE] * middle) * LEAST_NORTH
        out[i, 1] = (of[LONGITUDE] + of[EAST_RATE] * middle) * least_east
        farthest = max(farthest, half * math.hypot(of[NORTH_RATE] * of[NORTH], of[EAST_RATE] * of[EAST]))
    return farthest


@jit
def _chain(cell, size):  # type: ignore[no-untyped-def]
    """Which of 2^k chains a cell's entries are in."""
    return (cell[0] * 73856093 ^ cell[1] * 19349663) & (size - 1)


@jit
def _compare(pieces, vessel, chosen, i, j, low, high, within, found, out, out_piece):  # type: ignore[no-untyped-def]
    """Adds the pair of two entries where it comes close enough; returns how many were found so far."""
    a, b = chosen[i], chosen[j]
    since, until = max(low, pieces[a, FROM], pieces[b, FROM]), min(high, pieces[a, TO], pieces[b, TO])
    if vessel[a] == vessel[b] or since > until:
        return found
    metres, time = closest(pieces[a], pieces[b], since, until)
    if metres > within:
        return found
    if found < len(out):
        out[found, 0], out[found, 1] = metres, time
        out_piece[found, 0], out_piece[found, 1] = a, b
    return found + 1


@jit
def _slot(pieces, vessel, moves, chosen, low, high, within, least_east, found, out, out_piece):  # type: ignore[no-untyped-def]
    """The pairs of one slot: each entry is compared with those before it in its own and the eight neighbouring cells."""
    count = len(chosen)
    place, cell, after = np.empty((count, 2)), np.empty((count, 2), np.int64), np.empty(count, np.int64)
    width = within + 2.0 * _spread(pieces, chosen, low, high, least_east, place)
    size = 2
    while size < 2 * count:
        size *= 2
    heads = np.full((2, size), -1, np.int64)  # of chains of what lies still and of what moves
    beside = np.empty(2, np.int64)
    for i in range(count):
        mine = 1 if moves[chosen[i]] else 0
        cell[i, 0], cell[i, 1] = math.floor(place[i, 0] / width), math.floor(place[i, 1] / width)
        for kind in range(1 - mine, 2):
            for turn in range(9):
                beside[0], beside[1] = cell[i, 0] + turn // 3 - 1, cell[i, 1] + turn % 3 - 1
                j = heads[kind, _chain(beside, size)]
                while j >= 0:
                    if cell[j, 0] == beside[0] and cell[j, 1] == beside[1]:
                        found = _compare(pieces, vessel, chosen, i, j, low, high, within, found, out, out_piece)
                    j = after[j]
        mine_chain = _chain(cell[i], size)
        after[i] = heads[mine, mine_chain]
        heads[mine, mine_chain] = i
    return found


@jit
def encounters(pieces, vessel, moves, first, piece, from_time, slot, within, least_east, out, out_piece):  # type: ignore[no-untyped-def]
    """Pairs of pieces that come within a distance of each other, in each slot; returns how many, of which so many as there is room for
    are written.

    Args: vessel: (P,); moves: (P,) bool: two that do not are no pair; first, piece: from `slot_entries`; from_time, slot: s; within: m;
    least_east: m a degree of longitude at the latitude farthest from the equator; out: (Q, 2) m, s; out_piece: (Q, 2).
    """
    found = 0
    for k in range(len(first) - 1):
        chosen = piece[first[k] : first[k + 1]]
        low, high = from_time + k * slot, from_time + (k + 1) * slot
        found = _slot(pieces, vessel, moves, chosen, low, high, within, least_east, found, out, out_piece)
    return found
