"""Vessels that lost all tracks and come back with new ones: by their MMSI, or by position and velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coastwatch.batches import Ints, Picture, Rows
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred
from coastwatch.kernels.lookup import find
from coastwatch.picture.known import Known
from coastwatch.picture.rows import moved_on

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity

NEAR_M = 2000.0  # farther than a vessel can have gone astray


def returned(settings: Identity, known: Known, free: Rows, new: Picture, time_s: float) -> tuple[Ints, Rows]:
    """Which new vessels are which of those without tracks. Args: free: (F,) their slots; new: the new vessels.

    Returns: rows of `new` (B,), slots (B,).
    """
    from coastwatch.kernels.following import among

    updated_s, mmsi = (np.concatenate(known.past(column))[free] for column in ("updated_s", "mmsi"))
    free = free[(time_s - updated_s <= settings.hold_s) | among(mmsi, new.mmsi[new.mmsi >= 0])]
    old = known.take(free)
    by_id = np.argsort(old.vessel_id)
    free, old, fresh = free[by_id], old.take(by_id), np.arange(len(new))
    rows, slots = [fresh[:0]], [free[:0]]
    for matcher in (_by_mmsi, _by_place):
        if len(free) == 0 or len(fresh) == 0:
            break
        a, b = matcher(settings, new.take(fresh), old, time_s)
        rows.append(fresh[a])
        slots.append(free[b])
        fresh, free, old = np.delete(fresh, a), np.delete(free, b), old.take(np.delete(np.arange(len(old)), b))
    return np.concatenate(rows), np.concatenate(slots)


def _by_mmsi(settings: Identity, new: Picture, old: Picture, time_s: float) -> tuple[Ints, Ints]:
    order = np.lexsort((-old.updated_s, old.mmsi))
    keys, first = np.unique(old.mmsi[order], return_index=True)
    at = find(keys, new.mmsi)
    at = np.where(new.mmsi >= 0, at, -1)
    rows = np.flatnonzero(at >= 0)
    candidates = order[first[at[rows]]]
    gone_s = time_s - old.updated_s[candidates]
    metres = np.linalg.norm(difference_m(new.position_deg[rows], old.position_deg[candidates]), axis=1)
    fits = (gone_s <= settings.return_s) & (metres <= settings.max_speed_kn * KNOT_M_S * (gone_s + 10.0))
    rows, candidates = rows[fits], candidates[fits]
    _, once = np.unique(candidates, return_index=True)
    return rows[once], candidates[once]


def _by_place(settings: Identity, new: Picture, old: Picture, time_s: float) -> tuple[Ints, Ints]:
    from scipy.spatial import cKDTree

    from coastwatch.kernels.assignment import assign

    held = np.flatnonzero(time_s - old.updated_s <= settings.hold_s)
    if len(held) == 0:
        return held, held
    moved = moved_on(settings, old.take(held), time_s)
    near = cKDTree(earth_centred(new.position_deg)).sparse_distance_matrix(
        cKDTree(earth_centred(moved.position_deg)), NEAR_M, output_type="ndarray"
    )
    i, j = near["i"].astype(np.int64), near["j"].astype(np.int64)
    same_name = (new.mmsi[i] < 0) | (moved.mmsi[j] < 0) | (new.mmsi[i] == moved.mmsi[j])
    i, j = i[same_name], j[same_name]
    delta = np.concatenate(
        [difference_m(new.position_deg[i], moved.position_deg[j]), new.velocity_m_s[i] - moved.velocity_m_s[j]], axis=1
    )
    total = new.covariance[i] + moved.covariance[j]
    distance2 = np.einsum("ai,ai->a", delta, np.linalg.solve(total, delta[..., None])[..., 0]) if len(i) else np.zeros(0)
    chosen = np.flatnonzero(assign(i, j, settings.return_gate - distance2))
    return i[chosen], held[j[chosen]]
