"""The picture as arrays are sorted and sought, whole: how `Identity` was before its passes were linear. What it says is the measure.

Slow above some 10,000 tracks. `step` takes the settings of `Identity`; `start` is the memory before the first cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from flags_by_sorting import FlagMemory, find, flags_of
from names_by_vessels import Names, Past
from scipy.spatial import cKDTree

from coastwatch.batches import (
    AisAlarms,
    Associations,
    Flag,
    Floats,
    FusedTracks,
    Ints,
    Members,
    Picture,
    Sensors,
    SourceKind,
    Tracks,
)
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred, offset_deg
from coastwatch.kernels.association.assignment import assign
from coastwatch.picture import Identity


@dataclass(frozen=True, eq=False)
class PictureMemory:
    """What must outlive a cycle."""

    picture: Picture  # the newest row of every vessel that may come back, sorted by vessel_id
    track_id: Ints  # (L,) every track of the last cycle, sorted
    track_vessel: Ints  # (L,) the vessel it was in
    track_home: Ints  # (L,) the first vessel it ever was in
    next_id: int
    flags: FlagMemory
    past: dict[int, Past]


def start() -> PictureMemory:
    """The memory before the first cycle."""
    none = np.zeros(0, np.int64)
    return PictureMemory(Picture.empty(), none, none, none, 1, FlagMemory.empty(), {})


def step(
    settings: Identity,
    memory: PictureMemory,
    tracks: Tracks,
    associations: Associations,
    fused: FusedTracks,
    alarms: AisAlarms,
    time_s: float,
    sensors: Sensors,
) -> tuple[PictureMemory, Picture, Members]:
    """The picture of this cycle, sorted by vessel_id, and the tracks in it.

    Args: tracks: (N); associations: of its rows; fused: (V) one row for each vessel number; alarms: of AIS tracks.
    """
    last = memory.picture
    vessel_id, home = inherit(
        memory.track_id, memory.track_vessel, memory.track_home, last, tracks, associations, time_s, sensors
    )
    present = _row_of_tracks(tracks, associations, fused, alarms)
    vessel_id = return_of_the_lost(settings, vessel_id, memory, present, tracks, time_s)
    vessel_id = return_under_radar(settings, vessel_id, memory, present, tracks, associations.vessel, time_s)
    vessel_id = return_from_turns(vessel_id, memory, tracks, time_s)
    fresh = vessel_id < 0
    vessel_id = np.where(fresh, memory.next_id + np.cumsum(fresh) - 1, vessel_id)
    present = _with_past(replace(present, vessel_id=vessel_id), last)
    present = present.take(np.argsort(present.vessel_id, kind="stable"))
    of_track = vessel_id[associations.vessel]
    lost = coasted(settings, last, memory, present, tracks, of_track, time_s)
    known = Picture.join([present, lost])
    names = Names(memory.past, known, tracks, of_track, sensors, time_s)
    unnamed = known.vessel_id[names.lose(known)]
    present, lost = _without_names(present, unnamed), _without_names(lost, unnamed)
    limit_s = np.full(len(lost), settings.coast_s)
    limit_s[np.isin(lost.vessel_id, list(memory.flags.dark))] = max(settings.coast_s, settings.dark_coast_s)
    shown = Picture.join([present, lost.take(time_s - lost.updated_s <= limit_s)])
    shown = shown.take(np.argsort(shown.vessel_id, kind="stable"))
    had = np.array([k in names.past and names.past[k].was_paired(settings) for k in shown.vessel_id.tolist()], np.bool_)
    flag_memory, flags = flags_of(settings, memory.flags, shown, lost.vessel_id, tracks, of_track, alarms, time_s, sensors, had)
    shown = replace(shown, flags=flags | names.flags(settings, shown, time_s))
    members = _members(tracks, of_track)
    kept = Picture.join([present, lost])
    order = np.argsort(tracks.track_id, kind="stable")
    after = PictureMemory(
        kept.take(np.argsort(kept.vessel_id, kind="stable")),
        tracks.track_id[order],
        of_track[order],
        np.where((home < 0) | (of_track >= memory.next_id), of_track, home)[order],
        memory.next_id + int(fresh.sum()),
        flag_memory,
        names.past,
    )
    return after, shown, members


def _row_of_tracks(tracks: Tracks, associations: Associations, fused: FusedTracks, alarms: AisAlarms) -> Picture:
    """One row a vessel with what its tracks say of it; the id is still open."""
    count, vessel = len(fused), associations.vessel
    since, updated = np.full(count, np.inf), np.full(count, -np.inf)
    mmsi, origin = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    np.minimum.at(since, vessel, tracks.started_s)
    np.maximum.at(updated, vessel, tracks.updated_s)
    named = tracks.mmsi >= 0
    np.maximum.at(origin, vessel[~named], tracks.origin[~named])
    mmsi[vessel[named]] = tracks.mmsi[named]
    origin[vessel[named]] = tracks.origin[named]
    said = dict(zip(alarms.track_id.tolist(), alarms.nav_status.tolist(), strict=True))
    status = np.full(count, -1, np.int64)
    status[vessel[named]] = [said[track] for track in tracks.track_id[named].tolist()]
    return Picture(
        np.full(count, -1, np.int64),
        fused.time_s,
        fused.position_deg,
        fused.velocity_m_s,
        fused.covariance,
        since,
        updated,
        mmsi,
        np.full(count, int(Flag(0)), np.int64),
        origin,
        status,
    )


def _with_past(present: Picture, last: Picture) -> Picture:
    """The rows with since and MMSI as known before, where the vessel was known before."""
    if len(last) == 0:
        return present
    at = np.minimum(np.searchsorted(last.vessel_id, present.vessel_id), len(last) - 1)
    known = last.vessel_id[at] == present.vessel_id
    return replace(
        present,
        since_s=np.where(known, np.minimum(last.since_s[at], present.since_s), present.since_s),
        mmsi=np.where(known & (present.mmsi < 0), last.mmsi[at], present.mmsi),
        nav_status=np.where(known & (present.mmsi < 0), last.nav_status[at], present.nav_status),
    )


def _without_names(vessels: Picture, unnamed: Ints) -> Picture:
    """The vessels without the MMSI and status of some."""
    lost = np.isin(vessels.vessel_id, unnamed)
    return replace(vessels, mmsi=np.where(lost, -1, vessels.mmsi), nav_status=np.where(lost, -1, vessels.nav_status))


def _members(tracks: Tracks, of_track: Ints) -> Members:
    order = np.lexsort((tracks.track_id, tracks.source, of_track))
    return Members(of_track[order], tracks.track_id[order], tracks.source[order])


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
    key, gain = _handed_on(key, votes, gain, np.where(known, track_vessel[at], -1), tracks, associations.vessel, sensors)
    chosen = assign(key[:, 0], key[:, 1], gain)
    vessel_id[key[chosen, 0]] = key[chosen, 1]
    return vessel_id, home


def _handed_on(
    key: Ints, votes: Floats, gain: Floats, was_in: Ints, tracks: Tracks, group: Ints, sensors: Sensors
) -> tuple[Ints, Floats]:
    """Pairs of group and vessel, and their gains: the votes of groups that are no longer heard go to those with their successors.

    Args: key: (A, 2), votes, gain: (A,) with and without age; was_in: (N,) the vessel of each track, -1 if new; group: (N,) its group.
    """
    rows = [np.flatnonzero(group == g) for g in range(int(group.max()) + 1)]
    after, left = gain.copy(), np.ones(len(key), np.bool_)
    of_track_source = (tracks.source >= len(sensors.region_names)) & (tracks.source < sensors.ais_source)
    may_be = of_track_source | ((tracks.source == sensors.ais_source) & (np.hypot(*tracks.velocity_m_s.T) > 1.0))
    for a, (old, vessel) in enumerate(key.tolist()):
        best = -1
        for b in np.flatnonzero(key[:, 1] == vessel).tolist():
            new = rows[key[b, 0]]
            succeeded = all(
                may_be[n] and np.any((tracks.source[new] == tracks.source[n]) & (tracks.started_s[new] > tracks.updated_s[n]))
                for n in rows[old]
            )
            if b != a and succeeded and vessel in was_in[new] and (best < 0 or gain[b] > gain[best]):
                best = b
        if best >= 0:
            left[a] = False
            after[best] += votes[a]
    return key[left], after[left]


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


def return_under_radar(
    settings: Identity, vessel_id: Ints, memory: PictureMemory, present: Picture, tracks: Tracks, group: Ints, time_s: float
) -> Ints:
    """Ids with those of lost vessels given to groups of later vessels without a name, which a new AIS track of their MMSI joins."""
    last, out = memory.picture, vessel_id.copy()
    alive = memory.track_vessel[np.isin(memory.track_id, tracks.track_id)]
    free = np.flatnonzero(~np.isin(last.vessel_id, vessel_id) & ~np.isin(last.vessel_id, alive) & (last.mmsi >= 0))
    new_ais = set(group[~np.isin(tracks.track_id, memory.track_id) & (tracks.mmsi >= 0)].tolist())
    unnamed = {int(k): float(s) for k, s, m in zip(last.vessel_id, last.since_s, last.mmsi, strict=True) if m < 0}
    joined = np.array([g for g in sorted(new_ais) if int(vessel_id[g]) in unnamed], np.int64)
    if len(free) == 0 or len(joined) == 0:
        return out
    new, old = _by_mmsi(settings, present.take(joined), last.take(free), time_s)
    for g, k in zip(joined[new].tolist(), free[old].tolist(), strict=True):
        if unnamed[int(vessel_id[g])] >= last.updated_s[k]:
            out[g] = last.vessel_id[k]
    return out


def return_from_turns(vessel_id: Ints, memory: PictureMemory, tracks: Tracks, time_s: float) -> Ints:
    """Ids with those of vessels that lost their track in a turn given to the later vessel beside it, where no other could be it."""
    last, out = memory.picture, vessel_id.copy()
    alive = memory.track_vessel[np.isin(memory.track_id, tracks.track_id)]
    free = ~np.isin(last.vessel_id, vessel_id) & ~np.isin(last.vessel_id, alive)
    row = {int(k): n for n, k in enumerate(last.vessel_id)}
    pairs = []
    for i in np.flatnonzero(free & (time_s - last.updated_s <= 60.0)):
        for j in (row[k] for k in set(vessel_id.tolist()) & set(row)):
            later = last.mmsi[j] < 0 and time_s - last.since_s[j] <= 60.0 and last.since_s[j] > last.since_s[i]
            if not later or last.vessel_id[j] not in alive:
                continue
            gap_s, passed_s = abs(last.since_s[j] - last.updated_s[i]), time_s - last.updated_s[i]
            places = [
                offset_deg(last.position_deg[[k]], -last.velocity_m_s[[k]] * (last.time_s[k] - then_s))
                for k, then_s in ((i, last.updated_s[i]), (j, last.since_s[j]))
            ]
            away_m = float(np.linalg.norm(earth_centred(places[0]) - earth_centred(places[1])))
            speeds = [float(np.linalg.norm(last.velocity_m_s[k])) for k in (i, j)]
            spread_m = math.sqrt(sum(np.trace(last.covariance[k, :2, :2]) for k in (i, j)))
            turned = float(np.linalg.norm(last.velocity_m_s[i] - last.velocity_m_s[j])) <= 1.5 * passed_s
            near = away_m <= max(speeds) * (gap_s + 6.0) + 3.0 * spread_m and away_m <= 2000.0
            if turned and near and gap_s <= 20.0 and max(speeds) - min(speeds) <= 0.3 * max(speeds) + 2.0:
                pairs.append((i, j))
    for i, j in pairs:
        if sum(a == i for a, _ in pairs) == 1 == sum(b == j for _, b in pairs):
            out[vessel_id == last.vessel_id[j]] = last.vessel_id[i]
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
