"""Points of the Earth in an order in which neighbours stand together: bands of latitude, and longitude inside a band.

A key is band * 2^LONGITUDE_BITS + longitude in 2^-LONGITUDE_BITS of a turn. All points within a distance of one are then in three
short runs of keys, whatever the latitude and on both sides of the antimeridian; `runs` of `gating` finds them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks

BAND_BITS, LONGITUDE_BITS, ROW_BITS = 15, 20, 28
BANDS, TURN, ROWS = 1 << BAND_BITS, 1 << LONGITUDE_BITS, 1 << ROW_BITS
DIGIT_BITS = 12
DIGITS = 1 << DIGIT_BITS
PART = 1 << 16  # rows that are counted and moved at once by one thread
MERIDIAN_M = 6335439.0  # the least radius of curvature of a meridian, at the equator

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.int32]


def height_deg(reach_m: float) -> float:
    """Of a band: points no farther apart than reach_m (a chord) are in one band or in adjacent ones."""
    arc = 2.0 * math.asin(min(0.5 * reach_m / MERIDIAN_M, 1.0))
    return float(min(max(math.degrees(arc) * 1.001, 180.0 / BANDS), 180.0))


@jit
def _keys(low, high, position, height, out):  # type: ignore[no-untyped-def]
    for r in range(low, high):
        band = min(max(int((position[r, 0] + 90.0) / height), 0), BANDS - 1)
        longitude = int(math.floor((position[r, 1] + 180.0) / 360.0 * TURN)) & (TURN - 1)  # noqa: RUF046
        out[r] = ((band << LONGITUDE_BITS) | longitude) << ROW_BITS | r


@jit
def _count(low, high, word, shift, count):  # type: ignore[no-untyped-def]
    """Words of each part by digit. Args: low, high: parts; count: (parts, DIGITS), written."""
    for part in range(low, high):
        for r in range(part * PART, min((part + 1) * PART, len(word))):
            count[part, (word[r] >> shift) & (DIGITS - 1)] += 1


@jit
def _first_places(count):  # type: ignore[no-untyped-def]
    """Counts into the place of the first word of each part and digit."""
    total = 0
    for digit in range(DIGITS):
        for part in range(len(count)):
            here = count[part, digit]
            count[part, digit] = total
            total += here


@jit
def _move(low, high, word, shift, place, out):  # type: ignore[no-untyped-def]
    for part in range(low, high):
        mine = place[part]
        for r in range(part * PART, min((part + 1) * PART, len(word))):
            digit = (word[r] >> shift) & (DIGITS - 1)
            out[mine[digit]] = word[r]
            mine[digit] += 1


@jit
def _parted(low, high, word, key, row, rank):  # type: ignore[no-untyped-def]
    for i in range(low, high):
        key[i] = word[i] >> ROW_BITS
        row[i] = word[i] & (ROWS - 1)
        rank[row[i]] = i


def in_order(position_deg: Floats, reach_m: float, room: Callable[..., Any]) -> tuple[Ints, Rows, Rows]:
    """The keys of points for neighbours within reach_m, sorted, their rows, and the rank of every row; equal keys by row.

    A radix sort: linear, and the same whatever the order and the threads.
    Args: position_deg: (N, 2), N under 2^28; room: who makes what is returned, as np.empty. Returns: (N,), (N,), (N,).
    """
    count = len(position_deg)
    if count >= ROWS:
        raise ValueError(f"points: got {count}, needed fewer than {ROWS}")
    word, other = np.empty(count, np.int64), np.empty(count, np.int64)
    in_blocks(_keys, count, position_deg, height_deg(reach_m), word)
    parts = -(-count // PART)
    for shift in range(ROW_BITS, ROW_BITS + BAND_BITS + LONGITUDE_BITS, DIGIT_BITS):
        place = np.zeros((parts, DIGITS), np.int64)
        in_blocks(_count, parts, word, shift, place, least=1)
        _first_places(place)
        in_blocks(_move, parts, word, shift, place, other, least=1)
        word, other = other, word
    key, row, rank = room(count, np.int64), room(count, np.int32), room(count, np.int32)
    in_blocks(_parted, count, word, key, row, rank)
    return key, row, rank
