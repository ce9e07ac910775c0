"""Pairs of tracks of different sources within a distance of each other, anywhere on Earth: a grid of latitude bands.

Tracks are sorted by a key, band * TURN + longitude in 1 / TURN of a turn. All neighbours of a track then stand in three short runs:
in its band, the band before and the band after. Near the antimeridian there are three more. `scipy.spatial.cKDTree` finds the same
pairs of 100,000 tracks in 99 ms, this in 14 (processor time, scaling/decisions/association_cycle.py).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.geometry.ellipsoid import SEMI_MAJOR, ecef_of_rows
from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Records = NDArray[np.void]

BANDS, TURN_BITS, ROW_BITS = 1 << 15, 20, 28
TURN, ROWS = 1 << TURN_BITS, 1 << ROW_BITS
MERIDIAN_M = 6335439.0  # the least radius of curvature of a meridian, at the equator

PLACE = np.dtype(
    [
        ("key", np.int64),
        ("x_m", np.float64),  # Earth-centred
        ("y_m", np.float64),
        ("z_m", np.float64),
        ("row", np.int32),  # of the track
        ("source", np.int32),
        ("spot", np.int32),  # that the track is a member of
    ]
)

PAIR = np.dtype([("first", np.int32), ("second", np.int32), ("density", np.float64)])
"""Two tracks, the first of the lower source, and the density of other tracks around the first, a square metre."""


@jit
def band_height_deg(gate_m):  # type: ignore[no-untyped-def]
    """Points not farther apart than the gate (a chord) are in one band of this height or in adjacent ones."""
    arc = 2.0 * math.asin(min(0.5 * gate_m / MERIDIAN_M, 1.0))
    return min(max(math.degrees(arc) * 1.001, 180.0 / BANDS), 180.0)


def sorted_places(position_deg: Floats, source: Ints, spot: Ints, gate_m: float) -> Records:
    """The places of tracks, sorted by key, of equal keys by row. Args: position_deg: (N, 2), N < ROWS; source, spot: (N,)."""
    count = len(position_deg)
    if count >= ROWS:
        raise ValueError(f"position_deg: got {count} rows, needed fewer than {ROWS}")
    band = np.clip((position_deg[:, 0] + 90.0) * (1.0 / band_height_deg(gate_m)), 0, BANDS - 1).astype(np.int64)
    longitude = np.floor((position_deg[:, 1] + 180.0) * (TURN / 360.0)).astype(np.int64) & (TURN - 1)
    word = np.sort(((band << TURN_BITS) | longitude) << ROW_BITS | np.arange(count))  # faster than an argsort, and as stable
    out, row = np.empty(count, PLACE), word & (ROWS - 1)
    out["key"], out["row"], out["source"], out["spot"] = word >> ROW_BITS, row, source[row], spot[row]
    out["x_m"], out["y_m"], out["z_m"] = ecef_of_rows(position_deg, row).T
    return out


@jit
def _reach(band, gate_m):  # type: ignore[no-untyped-def]
    """How far in longitude, in keys, a place within the gate of one in this band may lie, at most half a turn.

    A chord is no shorter than 2 r sin(turn / 2), r the lesser distance from the axis.
    """
    height = band_height_deg(gate_m)
    edge = max(abs((band - 1) * height - 90.0), abs((band + 2) * height - 90.0))
    half = gate_m / (2.0 * SEMI_MAJOR * math.cos(math.radians(edge))) if edge < 90.0 else 1.0
    return min(int(math.asin(half) / math.pi * TURN) + 3, TURN // 2) if half < 1.0 else TURN // 2


@jit
def _find_runs(here, reach, key, run):  # type: ignore[no-untyped-def]
    """The runs of places, (6, 2) starts and ends, that may be within the gate of the key `here`.

    Args: key: (N,) sorted; run: written; the starts and ends of the first three go on from those of the key before in this band.
    """
    longitude = here % TURN
    for k in range(3):
        base = here - longitude + (k - 1) * TURN
        low, high = longitude - reach, longitude + reach
        while run[k, 0] < len(key) and key[run[k, 0]] < base + max(low, 0):
            run[k, 0] += 1
        run[k, 1] = max(run[k, 0], run[k, 1])
        while run[k, 1] < len(key) and key[run[k, 1]] < base + min(high, TURN):
            run[k, 1] += 1
        run[3 + k, 0] = run[3 + k, 1] = 0
        if low < 0:
            run[3 + k, 0], run[3 + k, 1] = np.searchsorted(key, base + low + TURN), np.searchsorted(key, base + TURN)
        elif high > TURN:
            run[3 + k, 0], run[3 + k, 1] = np.searchsorted(key, base), np.searchsorted(key, base + high - TURN)


@jit
def _in_halo(row, spot, halo):  # type: ignore[no-untyped-def]
    """Whether a row is in the halo of a spot. Args: halo: (start (N + 1,), spots whose halo each row is in)."""
    start, spots = halo
    found = False
    for k in range(start[row], start[row + 1]):
        found |= spots[k] == spot
    return found


@jit
def pairs_in_gate(low, high, member, place, halo, gate_m, out):  # type: ignore[no-untyped-def]
    """Pairs of a member low to high of a spot, and a track of a later source in the same spot or its halo.

    Args:
        member: rows of `place`, ascending; place: (N,) PLACE; halo: as `_in_halo`; gate_m: greatest distance.
        out: PAIR, written; at least one longer than there are pairs, or its last ones are wrong.
    Returns: how many pairs there are.
    """
    key, run, gate2 = place["key"], np.zeros((6, 2), np.int64), gate_m * gate_m
    count, band, reach = 0, -1, 0
    for m in range(low, high):
        first = place[member[m]]
        if first.key // TURN != band:
            band = first.key // TURN
            reach = _reach(band, gate_m)
            for k in range(3):
                run[k, 0] = run[k, 1] = np.searchsorted(key, (band + k - 1) * TURN)
        _find_runs(first.key, reach, key, run)
        before = count
        for k in range(6):
            for j in range(run[k, 0], run[k, 1]):
                second = place[j]
                x, y, z = second.x_m - first.x_m, second.y_m - first.y_m, second.z_m - first.z_m
                near = (second.source > first.source) & (x * x + y * y + z * z <= gate2)  # no branch: it cannot be foreseen
                if second.spot != first.spot and near:
                    near = _in_halo(second.row, first.spot, halo)
                at = min(count, len(out) - 1)
                out[at].first, out[at].second = member[m], j
                count += near
        for p in range(before, min(count, len(out))):
            out[p].density = max(count - before - 1, 1) / (math.pi * gate2)
    return count


def candidate_pairs(low: int, high: int, member: Ints, place: Records, halo: tuple[Ints, Ints], gate_m: float) -> Records:
    """All pairs of `pairs_in_gate`, (A,) PAIR."""
    out = np.empty(16 * (high - low) + 64, PAIR)
    count = pairs_in_gate(low, high, member, place, halo, gate_m, out)
    if count >= len(out):
        out = np.empty(count + 1, PAIR)
        pairs_in_gate(low, high, member, place, halo, gate_m, out)
    return out[:count]
