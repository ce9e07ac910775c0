"""Pairs of tracks of different sources within a distance of each other, anywhere on Earth; in a crowd, of the nearest alone."""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.arrays import Ints, Records
from coastwatch.kernels.association.crowds import WIDE, Crowds
from coastwatch.kernels.association.places import TURN, find_runs, reach_of
from coastwatch.kernels.jit import jit

PAIR = np.dtype([("first", np.int32), ("second", np.int32), ("density", np.float64)])
"""Two tracks, the first of the lower source, and the density of other tracks around the first, a square metre."""


@jit
def _in_halo(row, spot, halo):  # type: ignore[no-untyped-def]
    """Whether a row is in the halo of a spot. Args: halo: (start (N + 1,), spots whose halo each row is in)."""
    start, spots = halo
    found = False
    for k in range(start[row], start[row + 1]):
        found |= spots[k] == spot
    return found


@jit
def _pairs_of_crowded(m, place, halo, crowds, out, count):  # type: ignore[no-untyped-def]
    """As `pairs_in_gate`, of place m, which is in a crowded cell: with at most `most` places within its distance in the cells around."""
    first, cell, before, looked, within = place[m], crowds.cell[m], count, 0, 0
    near2 = crowds.near_m[cell] * crowds.near_m[cell]
    for k in range(crowds.run.shape[1]):
        for i in range(crowds.run[cell, k, 0], crowds.run[cell, k, 1]):
            if looked == WIDE * crowds.most or within == crowds.most:
                break
            looked += 1
            j = crowds.place[i]
            second = place[j]
            x, y, z = second.x_m - first.x_m, second.y_m - first.y_m, second.z_m - first.z_m
            near = x * x + y * y + z * z <= near2
            within += near
            near &= second.source > first.source
            if second.spot != first.spot and near:
                near = _in_halo(second.row, first.spot, halo)
            at = min(count, len(out) - 1)
            out[at].first, out[at].second = m, j
            count += near
    for p in range(before, min(count, len(out))):
        out[p].density = max(count - before - 1, 1) / (math.pi * near2)
    return count


@jit
def pairs_in_gate(low, high, member, place, halo, crowds, gate_m, out):  # type: ignore[no-untyped-def]
    """Pairs of a member low to high of a spot, and a track of a later source in the same spot or its halo.

    Args:
        member: rows of `place`, ascending; place: (N,) PLACE; halo: as `_in_halo`; crowds: Crowds; gate_m: greatest distance.
        out: PAIR, written; at least one longer than there are pairs, or its last ones are wrong.
    Returns: how many pairs there are.
    """
    key, run, gate2 = place["key"], np.zeros((6, 2), np.int64), gate_m * gate_m
    count, band, reach = 0, -1, 0
    for m in range(low, high):
        if len(crowds.cell) and crowds.cell[member[m]] >= 0:
            count = _pairs_of_crowded(member[m], place, halo, crowds, out, count)
            continue
        first = place[member[m]]
        if first.key // TURN != band:
            band = first.key // TURN
            reach = reach_of(band, gate_m)
            for k in range(3):
                run[k, 0] = run[k, 1] = np.searchsorted(key, (band + k - 1) * TURN)
        find_runs(first.key, reach, key, run)
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


def candidate_pairs(
    low: int, high: int, member: Ints, place: Records, halo: tuple[Ints, Ints], crowds: Crowds, gate_m: float
) -> Records:
    """All pairs of `pairs_in_gate`, (A,) PAIR."""
    out = np.empty(16 * (high - low) + 64, PAIR)
    count = pairs_in_gate(low, high, member, place, halo, crowds, gate_m, out)
    if count >= len(out):
        out = np.empty(count + 1, PAIR)
        pairs_in_gate(low, high, member, place, halo, crowds, gate_m, out)
    return out[:count]
