"""Who is who from one cycle to the next: votes of tracks, returns of the lost, prediction of those without tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coastwatch.batches import Associations, Flag, Floats, Ints, Picture, Sensors, SourceKind, Tracks
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred, offset_deg
from coastwatch.kernels.lookup import find

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity, PictureMemory


def inherit(
    track_id: Ints,
    track_vessel: Ints,
    track_home: Ints,
    last: Picture,
    tracks: Tracks,
    associations: Associations,
    time_s: float,
    sensors: Sensors,
) -> tuple[Ints, Ints]:
    """The id that the tracks of each vessel number vote for, -1 where none; and the home of each track, -1 for a new track.

    A track votes for the vessel it was in, and with a fraction of a vote for the first it ever was in, so that a pair that was
    joined in error parts into the vessels it was made of.
    """
    from coastwatch.kernels.assignment import assign

    count = int(associations.vessel.max(initial=-1)) + 1
    at = find(track_id, tracks.track_id)
    known = at >= 0
    vessel_id, home = np.full(count, -1, np.int64), np.full(len(tracks), -1, np.int64)
    if not known.any():
        return vessel_id, home
    home[known] = track_home[at[known]]
    group, previous = associations.vessel[known], track_vessel[at[known]]
    weight = np.where(sensors.source_kinds[tracks.source[known]] == SourceKind.AIS, 1.2, 1.0)
    group = np.concatenate([group, group])
    voted = np.concatenate([previous, home[known]])
    weight = np.concatenate([weight, 0.1 * weight])
    key, inverse = np.unique(np.stack([group, voted], axis=1), axis=0, return_inverse=True)
    votes = np.bincount(inverse.ravel(), weight)
    row = find(last.vessel_id, key[:, 1])
    age = np.where(row >= 0, time_s - last.since_s[np.maximum(row, 0)], 0.0) if len(last) else np.zeros(len(key))
    gain = votes + 0.5 * age / (age + 60.0)
    chosen = assign(key[:, 0], key[:, 1], gain)
    vessel_id[key[chosen, 0]] = key[chosen, 1]
    return vessel_id, home


def return_of_the_lost(
    settings: Identity, vessel_id: Ints, memory: PictureMemory, present: Picture, tracks: Tracks, time_s: float
) -> Ints:
    """Ids with those of vessels without tracks given to new vessels that are them by MMSI, or by position and velocity."""
    last = memory.picture
    alive = memory.track_vessel[np.isin(memory.track_id, tracks.track_id)]
    free = np.flatnonzero(~np.isin(last.vessel_id, vessel_id) & ~np.isin(last.vessel_id, alive))
    fresh = np.flatnonzero(vessel_id < 0)
    if len(free) == 0 or len(fresh) == 0:
        return vessel_id
    out = vessel_id.copy()
    for matcher in (_by_mmsi, _by_place):
        new, old = matcher(settings, present.take(fresh), last.take(free), time_s)
        out[fresh[new]] = last.vessel_id[free[old]]
        fresh, free = np.delete(fresh, new), np.delete(free, old)
        if len(free) == 0 or len(fresh) == 0:
            break
    return out


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
    moved = predicted(settings, old.take(held), time_s)
    near = cKDTree(earth_centred(new.position_deg)).sparse_distance_matrix(
        cKDTree(earth_centred(moved.position_deg)), 2000.0, output_type="ndarray"
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


def predicted(settings: Identity, vessels: Picture, time_s: float) -> Picture:
    """The vessels moved on to a time in straight motion, with the growth of their uncertainty."""
    dt = time_s - vessels.time_s
    position = offset_deg(vessels.position_deg, vessels.velocity_m_s * dt[:, None])
    return replace(
        vessels, time_s=np.full(len(vessels), float(time_s)), position_deg=position, covariance=_grown(settings, vessels, dt)
    )


def _grown(settings: Identity, vessels: Picture, dt: Floats) -> Floats:
    move = np.tile(np.eye(4), (len(vessels), 1, 1))
    move[:, 0, 2] = move[:, 1, 3] = dt
    q = np.zeros((len(vessels), 4, 4))
    power = settings.drift_m_s15**2
    for axis in (0, 1):
        q[:, axis, axis] = power * dt**3 / 3.0
        q[:, axis, axis + 2] = q[:, axis + 2, axis] = power * dt**2 / 2.0
        q[:, axis + 2, axis + 2] = power * dt
    return np.asarray(np.einsum("vij,vjk,vlk->vil", move, vessels.covariance, move) + q)


def coasted(
    settings: Identity, last: Picture, memory: PictureMemory, present: Picture, tracks: Tracks, of_track: Ints, time_s: float
) -> Picture:
    """Vessels of the past without tracks that may still come back, predicted; those whose tracks went into others are gone."""
    absent = ~np.isin(last.vessel_id, present.vessel_id)
    alive = np.isin(memory.track_id, tracks.track_id)
    merged = np.isin(last.vessel_id, memory.track_vessel[alive])
    lost = last.take(absent & ~merged)
    gone_s = time_s - lost.updated_s
    lost = lost.take((gone_s <= settings.hold_s) | ((lost.mmsi >= 0) & (gone_s <= settings.return_s)))
    moved = predicted(settings, lost, time_s)
    return replace(moved, flags=np.full(len(moved), int(Flag.COASTING), np.int64))
