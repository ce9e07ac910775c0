"""Vessels that lost all tracks and come back with new ones: by their MMSI, or by position and velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Picture, Rows
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred
from coastwatch.kernels.filters.gaussian import squared_distance
from coastwatch.kernels.tables.lookup import find
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.known import Known
from coastwatch.picture.rows import moved_on

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity

NEAR_M = 2000.0  # farther than a vessel can have gone astray


def returned(settings: Identity, known: Known, free: Rows, new: Picture, time_s: float) -> tuple[Ints, Rows]:
    """Which new vessels are which of those without tracks. Args: free: (F,) their slots; new: the new vessels.

    Returns: rows of `new` (B,), slots (B,).
    """

    old = known.take(free)
    name = new.mmsi[new.mmsi >= 0]
    may = np.flatnonzero((time_s - old.updated_s <= settings.hold_s) | kernels.tables.match_ids.among(old.mmsi, name))
    may = may[np.argsort(old.vessel_id[may])]
    slots = free[may]
    old = known.take(slots)
    named, called = _by_mmsi(settings, new, old, time_s)
    left = np.delete(np.arange(len(new)), named)
    held = time_s - old.updated_s <= settings.hold_s
    held[called] = False
    met, kept = _by_place(settings, new, left, old, np.flatnonzero(held), time_s)
    return np.append(named, met), slots[np.append(called, kept)]


def _by_mmsi(settings: Identity, new: Picture, old: Picture, time_s: float) -> tuple[Ints, Ints]:
    """Rows of both, by the vessel of that MMSI that was lost last."""

    asked = np.flatnonzero(kernels.tables.match_ids.among(old.mmsi, new.mmsi[new.mmsi >= 0]))
    order = asked[np.lexsort((-old.updated_s[asked], old.mmsi[asked]))]
    first = order[np.flatnonzero(np.diff(old.mmsi[order], prepend=-2))]
    at = find(old.mmsi[first], new.mmsi)
    rows = np.flatnonzero((at >= 0) & (new.mmsi >= 0))
    candidates = first[at[rows]]
    gone_s = time_s - old.updated_s[candidates]
    metres = np.linalg.norm(difference_m(new.position_deg[rows], old.position_deg[candidates]), axis=1)
    fits = (gone_s <= settings.return_s) & (metres <= settings.max_speed_kn * KNOT_M_S * (gone_s + 10.0))
    rows, candidates = rows[fits], candidates[fits]
    _, once = np.unique(candidates, return_index=True)
    return rows[once], candidates[once]


def _by_place(settings: Identity, new: Picture, left: Ints, old: Picture, held: Ints, time_s: float) -> tuple[Ints, Ints]:
    """Rows of both, best one-to-one by squared distance of position and velocity. Args: left, held: rows of each that are asked."""
    from scipy.spatial import cKDTree

    held = _reaching(new.position_deg[left], old, held, time_s)
    if len(left) == 0 or len(held) == 0:
        return left[:0], held[:0]
    moved = moved_on(settings, old.take(held), time_s)
    near = cKDTree(earth_centred(new.position_deg[left])).sparse_distance_matrix(
        cKDTree(earth_centred(moved.position_deg)), NEAR_M, output_type="ndarray"
    )
    i, j = left[near["i"]], near["j"]
    same_name = (new.mmsi[i] < 0) | (moved.mmsi[j] < 0) | (new.mmsi[i] == moved.mmsi[j])
    i, j = i[same_name], j[same_name]
    if len(i) == 0:
        return left[:0], held[:0]
    delta = np.concatenate(
        [difference_m(new.position_deg[i], moved.position_deg[j]), new.velocity_m_s[i] - moved.velocity_m_s[j]], axis=1
    )
    distance2 = squared_distance(delta, new.covariance[i] + moved.covariance[j])
    chosen = np.flatnonzero(kernels.association.assignment.assign(i, j.astype(np.int64), settings.return_gate - distance2))
    return i[chosen], held[j[chosen]]


def _reaching(place_deg: Floats, old: Picture, held: Ints, time_s: float) -> Ints:
    """Those of the held that may be near any of these places: most are far from all. Args: place_deg: (M, 2); held: rows of `old`."""

    out, order = np.empty(len(old), np.bool_), np.argsort(place_deg[:, 0])
    given = old.position_deg, old.velocity_m_s, old.time_s, float(time_s), NEAR_M, place_deg, order, out
    in_blocks(kernels.identity.picture_columns.may_meet, len(old), *given)
    return held[out[held]]
