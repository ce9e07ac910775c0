"""The flags of vessels and what must be remembered for them, as arrays are sorted and sought. What it says is the measure."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coastwatch.batches import (
    AisAlarms,
    Bools,
    Flag,
    Floats,
    Ints,
    Picture,
    Sensors,
    SourceKind,
    Tracks,
)
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred, within_any
from coastwatch.picture import Identity


def find(sorted_ids: Ints, ids: Ints) -> Ints:
    """Where each id stands among sorted ids; -1 where it does not."""
    if len(sorted_ids) == 0:
        return np.full(len(ids), -1, np.int64)
    at = np.minimum(np.searchsorted(sorted_ids, ids), len(sorted_ids) - 1)
    return np.where(sorted_ids[at] == ids, at, -1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class FlagMemory:
    """Since when each vessel is as it is, rows sorted by vessel_id; and the radar and AIS track that were last one vessel."""

    vessel_id: Ints  # (V,)
    no_ais_since_s: dict[int, float]  # of these and of hidden vessels; inf: has AIS or is not where AIS is heard
    dark: set[int]
    no_radar_since_s: Floats  # (V,) inf: has radar or is not where a radar sees
    ais_track: Ints  # (P,) sorted
    radar_track: Ints  # (P,)
    paired_since_s: Floats  # (P,)
    parted_since_s: Floats  # (P,) inf while they are one
    anchor_deg: Floats  # (V, 2) where each vessel was when it last moved
    anchor_since_s: Floats  # (V,)
    newest_id: int  # of all vessels so far
    began_s: float = np.inf
    heard_s: dict[int, float] = field(default_factory=dict)  # newest AIS report of each vessel of the picture

    @staticmethod
    def empty() -> FlagMemory:
        n, f = np.zeros(0, np.int64), np.zeros(0)
        return FlagMemory(n, {}, set(), f, n, n, f, f, np.zeros((0, 2)), f, 0)


def flags_of(
    settings: Identity,
    memory: FlagMemory,
    picture: Picture,
    without_tracks: Ints,
    tracks: Tracks,
    of_track: Ints,
    alarms: AisAlarms,
    time_s: float,
    sensors: Sensors,
    had_ais: Bools,
) -> tuple[FlagMemory, Ints]:
    """The memory after this cycle and the flags of every vessel of the picture (sorted by vessel_id).

    Args: without_tracks: ids of vessels that may return, shown or not.
    """
    kinds = sensors.source_kinds[tracks.source]
    row = find(picture.vessel_id, of_track)
    has_ais, has_radar = (_any(row[kinds == kind], len(picture)) for kind in (SourceKind.AIS, SourceKind.RADAR))
    margin = settings.cover_margin
    heard = within_any(picture.position_deg, sensors.stations.site_deg, margin * sensors.stations.range_m)
    seen = within_any(picture.position_deg, sensors.radars.site_deg, margin * sensors.radars.range_m)
    at = find(memory.vessel_id, picture.vessel_id)
    clock = {k: memory.no_ais_since_s.get(k, np.inf) for k in [*picture.vessel_id.tolist(), *without_tracks.tolist()]}
    for k, listens, sees in zip(picture.vessel_id.tolist(), (heard & ~has_ais).tolist(), has_radar.tolist(), strict=True):
        begins = time_s
        if sees and k > memory.newest_id:  # a new vessel that was long in being shown
            plots = tracks.started_s[(kinds == SourceKind.RADAR) & (of_track == k)]
            begins = min(max(np.min(plots) + settings.dark_unshown_s, time_s - settings.dark_unshown_s), time_s)
        clock[k] = min(clock[k], begins if sees else np.inf) if listens else np.inf
    no_ais = np.array([clock[k] for k in picture.vessel_id.tolist()])
    no_radar = _since(has_ais & ~has_radar & seen, memory.no_radar_since_s, at, time_s)
    pairs = _parted(settings, memory, tracks, kinds, of_track, time_s, seen[row])
    flags = picture.flags.copy()
    anchor_deg, anchor_since_s, stays = _anchored(settings, memory, picture, at, time_s)
    flags |= np.where(stays, int(Flag.STATIONARY), 0)
    ships = picture.position_deg[has_ais & (stays | np.isin(picture.nav_status, (1, 5)))]
    apart_m = [np.linalg.norm(earth_centred(ships) - earth_centred(one), axis=1) for one in picture.position_deg]
    among = np.array([(one <= settings.anchorage_m).sum() >= settings.anchorage_ships for one in apart_m], np.bool_)
    may_be = has_radar | np.isin(picture.vessel_id, list(memory.dark))
    is_ais = kinds == SourceKind.AIS
    newest_s = np.array([np.max(tracks.updated_s[is_ais & (row == k)], initial=-np.inf) for k in range(len(picture))])
    ships_s = newest_s[has_ais & (stays | np.isin(picture.nav_status, (1, 5)))]
    pause_s = min(max(newest_s) - min(ships_s), 180.0) if len(ships_s) else 0.0
    began_s = min(memory.began_s, time_s)
    was_dark = np.isin(picture.vessel_id, list(memory.dark))
    spread = np.array([np.sqrt(np.nansum(np.diag(one)[2:]) / 2) for one in picture.covariance])  # of the speed
    slow = stays | (np.linalg.norm(picture.velocity_m_s, axis=1) < 2 * KNOT_M_S + spread)
    may_be &= (time_s - no_ais >= settings.dark_after_s + pause_s) | ~slow | was_dark
    heard_s = {k: max(now, memory.heard_s.get(k, -np.inf)) for k, now in zip(picture.vessel_id.tolist(), newest_s, strict=True)}
    may_be &= (time_s - np.array([*heard_s.values()]) >= 1.1 * 180.0) | ~slow | was_dark
    rests = slow & (anchor_since_s <= no_ais + settings.dark_unshown_s) & (time_s - began_s < 360.0)
    may_be &= (time_s - no_ais >= settings.dark_after_s + 180.0) | ~rests | was_dark
    silent = may_be & (time_s - no_ais >= settings.dark_after_s) & ~(stays & (picture.mmsi == -1) & ~had_ais & ~among)
    flags |= np.where(silent, int(Flag.DARK), 0)
    flags |= np.where(newest_s - no_radar >= settings.unseen_after_s, int(Flag.AIS_WITHOUT_RADAR), 0)
    contradicted = (time_s - pairs.parted_since_s >= settings.contradicted_after_s) & _apart(settings, pairs, tracks)
    for track in (pairs.ais_track[contradicted], pairs.radar_track[contradicted]):
        flags[row[find_any(tracks.track_id, track)]] |= int(Flag.AIS_CONTRADICTED)
    for alarm, flag in ((alarms.twice, Flag.MMSI_TWICE), (alarms.impossible_speed, Flag.IMPOSSIBLE_SPEED)):
        flags[row[find_any(tracks.track_id, alarms.track_id[alarm])]] |= int(flag)
    flags |= np.array([by_text(*row) for row in zip(picture.mmsi.tolist(), picture.nav_status.tolist(), strict=True)], np.int64)
    after = FlagMemory(
        picture.vessel_id,
        clock,
        set(picture.vessel_id[silent].tolist()),
        no_radar,
        pairs.ais_track,
        pairs.radar_track,
        pairs.paired_since_s,
        pairs.parted_since_s,
        anchor_deg,
        anchor_since_s,
        max([memory.newest_id, *picture.vessel_id.tolist()]),
        began_s,
        heard_s,
    )
    return after, flags


def by_text(mmsi: int, status: int) -> int:
    """The flags of a number as it is written with nine digits, and of a navigational status."""
    digits = f"{mmsi:09d}" if mmsi >= 0 else ""
    device = {"970": Flag.AIS_SART, "972": Flag.MAN_OVERBOARD, "974": Flag.EPIRB}.get(digits[:3], Flag(0))
    if status == 14 and not device:
        device = Flag.AIS_SART
    country = digits[2:5] if digits[:2] == "98" else digits[:3]
    odd = digits and not device & ~Flag.AIS_SART and digits[:3] != "970" and not 201 <= int(country) <= 775
    own = {2: Flag.NOT_UNDER_COMMAND, 6: Flag.AGROUND}.get(status, Flag(0))
    return int(device | own | (Flag.ODD_MMSI if odd else Flag(0)))


def find_any(ids: Ints, wanted: Ints) -> Ints:
    """Rows of the ids that are wanted, in the order of the ids; ids need not be sorted."""
    return np.flatnonzero(np.isin(ids, wanted))


def _any(row: Ints, count: int) -> Bools:
    out = np.zeros(count, np.bool_)
    out[row] = True
    return out


def _since(state: Bools, before_s: Floats, at: Ints, time_s: float) -> Floats:
    """Since when the state holds: as before where it held before, now where it is new, inf where it does not hold."""
    held = np.where(at >= 0, before_s[np.maximum(at, 0)], np.inf) if len(before_s) else np.full(len(state), np.inf)
    return np.where(state, np.minimum(held, time_s), np.inf)


def _parted(
    settings: Identity, memory: FlagMemory, tracks: Tracks, kinds: Ints, of_track: Ints, time_s: float, seen: Bools
) -> FlagMemory:
    """The radar and AIS tracks that are, or lately were, one vessel.

    A pair of the past is dropped when either track ends, the AIS track has another radar partner, the radar track another AIS, AIS has
    left radar cover, the pair was too young to mean anything, or it has been apart too long.
    """
    ais, radar = np.flatnonzero(kinds == SourceKind.AIS), np.flatnonzero(kinds == SourceKind.RADAR)
    order = np.argsort(of_track[radar], kind="stable")
    mate = find(of_track[radar][order], of_track[ais])
    now_ais, now_radar = tracks.track_id[ais[mate >= 0]], tracks.track_id[radar[order][mate[mate >= 0]]]
    before = find(memory.ais_track, now_ais)
    same = (before >= 0) & (memory.radar_track[before] == now_radar) if len(memory.ais_track) else np.zeros(len(now_ais), bool)
    since = np.where(same, memory.paired_since_s[before], time_s) if len(memory.ais_track) else np.full(len(now_ais), time_s)
    old = _still_parted(settings, memory, tracks, now_ais, now_radar, seen, time_s)
    ais_track = np.concatenate([now_ais, memory.ais_track[old]])
    by_ais = np.argsort(ais_track, kind="stable")
    parted = np.concatenate([np.full(len(now_ais), np.inf), np.minimum(memory.parted_since_s[old], time_s)])
    none = np.zeros(0)
    return FlagMemory(
        np.zeros(0, np.int64),
        {},
        set(),
        none,
        ais_track[by_ais],
        np.concatenate([now_radar, memory.radar_track[old]])[by_ais],
        np.concatenate([since, memory.paired_since_s[old]])[by_ais],
        parted[by_ais],
        np.zeros((0, 2)),
        none,
        memory.newest_id,
        memory.began_s,
    )


def _anchored(
    settings: Identity, memory: FlagMemory, picture: Picture, at: Ints, time_s: float
) -> tuple[Floats, Floats, Bools]:
    """Where each vessel was when it last moved, since when, and whether that is so long that it is stationary. One at a time."""
    where, since, stays = picture.position_deg.copy(), np.full(len(picture), time_s), np.zeros(len(picture), np.bool_)
    for k, row in enumerate(at.tolist()):
        radius = max(settings.stationary_m, 3.0 * float(np.sqrt(np.trace(picture.covariance[k, :2, :2]))))
        if row >= 0:
            apart = difference_m(picture.position_deg[k : k + 1], memory.anchor_deg[row : row + 1])
            if np.linalg.norm(apart) <= radius:
                where[k], since[k] = memory.anchor_deg[row], memory.anchor_since_s[row]
        seconds = max(settings.stationary_after_s, radius / (settings.under_way_kn * 1852.0 / 3600.0))
        stays[k] = time_s - since[k] >= seconds
    return where, since, stays


def _still_parted(
    settings: Identity, memory: FlagMemory, tracks: Tracks, now_ais: Ints, now_radar: Ints, seen: Bools, time_s: float
) -> Bools:
    alive = np.isin(memory.ais_track, tracks.track_id[seen]) & np.isin(memory.radar_track, tracks.track_id)
    free = ~np.isin(memory.ais_track, now_ais) & ~np.isin(memory.radar_track, now_radar)
    begun = np.minimum(memory.parted_since_s, time_s)
    meant = begun - memory.paired_since_s >= settings.paired_s
    return np.asarray(alive & free & meant & (time_s - begun <= settings.contradicted_for_s))


def _apart(settings: Identity, pairs: FlagMemory, tracks: Tracks) -> Bools:
    """Whether the two tracks of each pair are farther apart than a poor association would explain."""
    order = np.argsort(tracks.track_id, kind="stable")
    a, r = (order[find(tracks.track_id[order], ids)] for ids in (pairs.ais_track, pairs.radar_track))
    metres = np.linalg.norm(difference_m(tracks.position_deg[a], tracks.position_deg[r]), axis=1)
    return np.asarray(metres >= settings.contradicted_from_m)
