"""Flags of vessels that an operator should look at: who decides that a vessel is dark, and the other flags.

- DARK: radar but no AIS for `dark_after_s`, inside the range of an AIS station; of what is stationary only if it once had AIS, or
  lies among ships at anchor: near `anchorage_ships` or more that send AIS. A slow radar shows vessels late: what is beyond
  `dark_unshown_s` from the first plot until it is shown counts too, at most as much. What is stationary, or slow within the noise of
  its speed, has more time: the longest pause of any ship at anchor, and the interval of slow vessels since its last report and the
  return of AIS. The time goes on, and the flag stays, while radar loses it.
- AIS_WITHOUT_RADAR: no radar, and AIS reports still `unseen_after_s` later, where a radar detects most vessels (`AisDetection`).
  A vessel that no report has placed there since may have left: a report of minutes ago does not contradict the radar.
- AIS_CONTRADICTED: an AIS and a radar track were one vessel, have split, and are `contradicted_from_m` apart, where a radar
  detects most vessels.
- STATIONARY: it has stayed within `stationary_m`, or within its noise, for longer than a vessel under way could.
- MMSI_TWICE, IMPOSSIBLE_SPEED: alarms of the AIS tracks.

The first three count time with sensors that are heard. Where only silent ones reach, their clocks stand at the last report, and go on
when a sensor is heard again. Nobody begins to be dark in the seconds in which AIS is not yet known to be silent.

`ais_flags` has those that follow from an MMSI and a navigational status alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import AisAlarms, AisDetection, Bools, Flag, Floats, Ints, NavStatus, Picture, Tracks
from coastwatch.batches.ais_codes import AIS_SART, EPIRB, MAN_OVERBOARD, is_vessel
from coastwatch.batches.hearing import SensorCover, sensor_covers
from coastwatch.batches.struct import Struct, column, part
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred
from coastwatch.picture.former_names import AisNow, AisPast, had_ais
from coastwatch.picture.inputs import PictureInput
from coastwatch.picture.match import IdentityMatch
from coastwatch.picture.order import VesselOrder
from coastwatch.picture.settings import IdentitySettings

STATIONARY_SIGMAS = 3.0  # of the position that a displacement must exceed

SLOW_M_S = 2.0 * KNOT_M_S  # slower vessels may send each 180 s (ITU-R M.1371)
LONGEST_PAUSE_S = 180.0  # of these: a ship that is silent for longer has perhaps left, and may be far away
AIS_RETURNS_S, UNDER_WAY_S = 180.0, 30.0
"""The longest intervals of AIS reports, of slow vessels and under way (ITU-R M.1371): after AIS is heard again, time begins with them."""
DUE_AGAIN = 1.1  # of that interval since the last report of a slow vessel: senders vary it, and a report waits for its cycle


@dataclass(frozen=True, eq=False)
class TrackPairs(Struct):
    """AIS tracks with the first radar track of their vessel, now or until lately. Tracks are rows of a cycle; no AIS track twice."""

    ais: Ints = column(np.int64, "P")
    radar: Ints = column(np.int64, "P")
    paired_since_s: Floats = column(np.float64, "P")
    split_since_s: Floats = column(np.float64, "P")  # inf while they are one vessel


@dataclass(frozen=True, eq=False)
class FlagMemory(Struct):
    """What the flags need of the last cycle."""

    # Of rows of the picture, then of hidden vessels: since then without AIS; inf: none counted
    no_ais_since_s: Floats = column(np.float64, "V")
    no_radar_since_s: Floats = column(np.float64, "R")  # AIS without radar where a radar should see it; inf if not so
    anchor_deg: Floats = column(np.float64, "R", 2)  # where each row was when it last moved
    anchor_since_s: Floats = column(np.float64, "R")
    ais_heard_s: Floats = column(np.float64, "R")  # newest AIS report of each row; -inf: none since it is shown
    pairs: TrackPairs = part(TrackPairs)
    began_s: float = np.inf  # time of the first cycle


def flag(
    settings: IdentitySettings,
    memory: FlagMemory,
    match: IdentityMatch,
    order: VesselOrder,
    picture: Picture,
    past: AisPast,
    now: AisNow,
    given: PictureInput,
) -> tuple[FlagMemory, Ints]:
    """The flags of each row by cover, motion and AIS tracks; `ais_flags` and `name_flags` have the others.

    Args: past: after this cycle. Returns: memory, (R,).
    """
    tracks, alarms, time_s, sensors, row_of_track = given.tracks, given.alarms, given.time_s, given.sensors, now.row_of_track
    ais_cover, radar_cover = sensor_covers(sensors, settings.cover_margin, given.hearing)
    radars, ais = np.flatnonzero(tracks.source < sensors.ais_source), np.flatnonzero(tracks.source == sensors.ais_source)
    first_radar = np.full(len(picture), -1, np.int64)
    first_radar[row_of_track[radars[::-1]]] = radars[::-1]  # the last one written is the first of its vessel
    ever_heard_s, before = now.heard_s.copy(), order.vessel_of_row
    shown_before = np.flatnonzero((before >= 0) & (before < len(memory.ais_heard_s)))
    ever_heard_s[shown_before] = np.maximum(now.heard_s[shown_before], memory.ais_heard_s[before[shown_before]])

    should_see = np.ones(len(picture), np.bool_)
    if given.detection is not None:
        should_see = _should_be_seen(settings, given.detection, tracks.track_id[ais], row_of_track[ais], len(picture))
    no_ais, no_radar = now.has_radar & ~now.has_ais, now.has_ais & ~now.has_radar
    goes_on = ~now.has_ais & (no_ais | np.isfinite(_held_s(memory.no_ais_since_s, before)))
    anchor_deg, anchor_since_s, stationary = _stationary(settings, memory, order.vessel_of_row, picture, time_s)
    sigma_m_s = np.sqrt(np.nan_to_num(picture.covariance[:, 2, 2] + picture.covariance[:, 3, 3]) / 2.0)
    slow = stationary | (np.hypot(*picture.velocity_m_s.T) < SLOW_M_S + sigma_m_s)
    returns_s = np.where(slow, AIS_RETURNS_S, UNDER_WAY_S)
    no_ais_since_s = _since(ais_cover, picture, goes_on, goes_on, memory.no_ais_since_s, before, time_s, returns_s)
    was_shown = np.zeros(len(picture), np.bool_)
    was_shown[row_of_track[match.first_vessel >= 0]] = True  # in another vessel, as one that has split from its AIS
    new = np.flatnonzero((before < 0) & ~was_shown & (no_ais_since_s == time_s))
    if len(new):
        usual_s = _first_plot_s(tracks, radars, row_of_track, len(picture), time_s)[new] + settings.dark_unshown_s
        no_ais_since_s[new] = np.clip(usual_s, time_s - settings.dark_unshown_s, time_s)
    no_radar_since_s = _since(
        radar_cover, picture, no_radar & should_see, no_radar, memory.no_radar_since_s, before, time_s, np.zeros(len(picture))
    )
    pairs = _track_pairs(settings, memory.pairs, match, ais, first_radar[row_of_track[ais]], len(tracks), time_s)
    pairs = _in_cover(pairs, ais_cover, radar_cover, picture, row_of_track, should_see, time_s)

    flags = picture.flags.copy()
    flags[stationary] |= int(Flag.STATIONARY)
    dark = np.flatnonzero((time_s - no_ais_since_s >= settings.dark_after_s) & (now.has_radar | order.was_dark))
    never_sent = stationary[dark] & (picture.mmsi[dark] < 0) & ~had_ais(settings, past, picture.vessel_id[dark])
    at_anchor = now.has_ais & (stationary | np.isin(picture.nav_status, (NavStatus.AT_ANCHOR, NavStatus.MOORED)))
    anchored_s = now.heard_s[at_anchor]  # ships at anchor send each 180 s, or rarely; the longest pause, of AIS that is heard
    pause_s = min(float(now.heard_s.max() - anchored_s.min()), LONGEST_PAUSE_S) if len(anchored_s) else 0.0
    began_s = min(memory.began_s, time_s)
    place_deg, since_s, heard_s = picture.position_deg[dark], no_ais_since_s[dark], ever_heard_s[dark]
    rests = anchor_since_s[dark] <= since_s + settings.dark_unshown_s
    rests &= time_s < began_s + 2.0 * AIS_RETURNS_S  # not each ship at anchor has had its turn: what has not moved may be one
    longer_s = np.where(rests, AIS_RETURNS_S, pause_s)
    waits = _may_send(settings, ais_cover, place_deg, slow[dark], since_s, heard_s, longer_s, time_s) & ~order.was_dark[dark]
    among_ships = _in_anchorage(settings, picture.position_deg[dark[never_sent]], picture.position_deg[at_anchor])
    never_sent[never_sent] = ~among_ships
    flags[dark[~never_sent & ~waits]] |= int(Flag.DARK)
    flags[now.heard_s - no_radar_since_s >= settings.unseen_after_s] |= int(Flag.AIS_WITHOUT_RADAR)
    contradicted = _contradicted(settings, pairs, tracks, time_s)
    for track in (pairs.ais[contradicted], pairs.radar[contradicted]):
        flags[row_of_track[track]] |= int(Flag.AIS_CONTRADICTED)
    for alarm, what in ((alarms.twice, Flag.MMSI_TWICE), (alarms.impossible_speed, Flag.IMPOSSIBLE_SPEED)):
        odd = kernels.tables.match_ids.index_of(tracks.track_id, alarms.track_id[alarm])
        flags[row_of_track[odd[odd >= 0]]] |= int(what)
    no_ais_since_s = np.append(no_ais_since_s, _held_s(memory.no_ais_since_s, order.hidden))
    return FlagMemory(no_ais_since_s, no_radar_since_s, anchor_deg, anchor_since_s, ever_heard_s, pairs, began_s), flags


def _may_send(
    settings: IdentitySettings,
    cover: SensorCover,
    position_deg: Floats,
    slow: Bools,
    since_s: Floats,
    heard_s: Floats,
    longer_s: Floats,
    time_s: float,
) -> Bools:
    """Which vessels without AIS may be between two reports. (D,)

    Args: since_s: (D,) since when each is without AIS; heard_s: (D,) its last report; longer_s: (D,) waits each slow one.
    """
    until_s, after_s = cover.until_s(position_deg, time_s), np.full(len(slow), AIS_RETURNS_S + settings.dark_after_s)
    slow_waits = until_s - heard_s < DUE_AGAIN * AIS_RETURNS_S
    slow_waits |= cover.begins_s(position_deg, slow, time_s, after_s) > time_s
    waits = until_s - since_s < settings.dark_after_s + np.where(slow, longer_s, 0.0)
    return np.asarray(waits | (slow & slow_waits))


def _first_plot_s(tracks: Tracks, radars: Ints, row_of_track: Ints, rows: int, time_s: float) -> Floats:
    """When the first radar track of each row of the picture began; now where there is none. (R,) Args: radars: rows of tracks."""
    started_s = np.full(rows, float(time_s))
    np.fmin.at(started_s, row_of_track[radars], tracks.started_s[radars])
    return started_s


def _held_s(before_s: Floats, vessel: Ints) -> Floats:
    """The times of vessels of the last cycle; inf of others. (R,) Args: before_s: (S,) of its first vessels; vessel: (R,)."""
    out = np.full(len(vessel), np.inf)
    was_there = (vessel >= 0) & (vessel < len(before_s))
    out[was_there] = before_s[vessel[was_there]]
    return out


def _should_be_seen(settings: IdentitySettings, detection: AisDetection, track_id: Ints, row: Ints, rows: int) -> Bools:
    """Which rows of the picture have an AIS track that some radar should see. (R,) Args: track_id, row: (B,) of AIS tracks."""
    should_see, at = np.zeros(rows, np.bool_), kernels.tables.match_ids.index_of(detection.track_id, track_id)
    has_row = at >= 0
    should_see[row[has_row]] = detection.probability[at[has_row]] >= settings.should_see
    return should_see


def _since(
    cover: SensorCover,
    picture: Picture,
    holds: Bools,
    may_hold: Bools,
    before_s: Floats,
    vessel_of_row: Ints,
    time_s: float,
    returns_s: Floats,
) -> Floats:
    """Since when a condition holds in cover: as at the last cycle, or now if it is new; inf where it does not hold. (R,)

    Where only silent sensors reach, the time that it has held stands. After they are heard again, none begins to hold there before
    `returns_s` are over: until then its time is below 0.
    Args: holds: (R,) if a sensor is heard there; may_hold: (R,) if one is silent there; before_s: (S,) of the shown vessels of the
    last cycle; vessel_of_row, returns_s: (R,).
    """
    held_s = _held_s(before_s, vessel_of_row)
    runs = cover.within(picture.position_deg, holds)
    begins = runs & ~np.isfinite(held_s)
    begins_s = cover.begins_s(picture.position_deg, begins, time_s, returns_s)
    since_s = np.where(runs, np.where(begins, begins_s, held_s), np.inf)
    from_s = cover.stands_from_s(picture.position_deg, may_hold & ~runs)
    stands = np.isfinite(from_s)
    elapsed_s = from_s[stands] - held_s[stands]
    since_s[stands] = np.where(elapsed_s > 0.0, time_s - elapsed_s, np.inf)
    return since_s


def _stationary(
    settings: IdentitySettings, memory: FlagMemory, vessel_of_row: Ints, picture: Picture, time_s: float
) -> tuple[Floats, Floats, Bools]:
    """Where each row of the picture was when it last moved (R, 2), since when it has been there (R,), whether it is stationary (R,).

    It has moved when it is farther from there than `stationary_m` and than the noise of its position.
    """
    anchor_deg, since_s = picture.position_deg.copy(), np.full(len(picture), float(time_s))
    rows = np.flatnonzero((vessel_of_row >= 0) & (vessel_of_row < len(memory.anchor_since_s)))
    before = vessel_of_row[rows]
    variance = picture.covariance[:, 0, 0] + picture.covariance[:, 1, 1]
    radius_m = np.fmax(settings.stationary_m, STATIONARY_SIGMAS * np.sqrt(variance))
    offset_m = difference_m(picture.position_deg.take(rows, axis=0), memory.anchor_deg.take(before, axis=0))
    near = np.hypot(offset_m[:, 0], offset_m[:, 1]) <= radius_m[rows]
    rows, before = rows[near], before[near]
    anchor_deg[rows], since_s[rows] = memory.anchor_deg.take(before, axis=0), memory.anchor_since_s[before]
    needed_s = np.maximum(settings.stationary_after_s, radius_m / (settings.under_way_kn * KNOT_M_S))
    return anchor_deg, since_s, time_s - since_s >= needed_s


def _in_anchorage(settings: IdentitySettings, position_deg: Floats, at_anchor_deg: Floats) -> Bools:
    """Which positions (N, 2) have `anchorage_ships` of the ships at anchor (S, 2) within `anchorage_m`. (N,)"""
    from scipy.spatial import cKDTree

    if not len(position_deg) or not len(at_anchor_deg):
        return np.zeros(len(position_deg), np.bool_)
    ships = cKDTree(earth_centred(at_anchor_deg))
    near = ships.query_ball_point(earth_centred(position_deg), settings.anchorage_m, return_length=True)
    return np.asarray(near >= settings.anchorage_ships)


def _track_pairs(
    settings: IdentitySettings, before: TrackPairs, match: IdentityMatch, ais: Ints, radar: Ints, tracks: int, time_s: float
) -> TrackPairs:
    """The pairs of this cycle, and those of the past that have split.

    A pair that has split counts until either track ends, either has another partner, or `contradicted_for_s` is over; never if it
    was one vessel for less than `paired_s`.
    Args: ais: (B,) AIS tracks; radar: (B,) the first radar track of the vessel of each, -1 if none; tracks: how many there are.
    """
    ais, radar = ais[radar >= 0], radar[radar >= 0]
    ais_now, radar_now = match.track_now[before.ais], match.track_now[before.radar]
    pair_before = np.full(tracks, -1, np.int64)
    pair_before[ais_now[ais_now >= 0]] = np.flatnonzero(ais_now >= 0)
    paired_since_s = np.full(len(ais), float(time_s))
    old = np.flatnonzero(pair_before[ais] >= 0)
    pair = pair_before[ais[old]]
    same = radar_now[pair] == radar[old]
    paired_since_s[old[same]] = before.paired_since_s[pair[same]]

    has_partner = np.zeros(tracks, np.bool_)
    has_partner[ais] = has_partner[radar] = True
    split = np.flatnonzero((ais_now >= 0) & (radar_now >= 0))
    split = split[~has_partner[ais_now[split]] & ~has_partner[radar_now[split]]]
    split_since_s = np.minimum(before.split_since_s, time_s)
    long_enough = split_since_s[split] - before.paired_since_s[split] >= settings.paired_s
    split = split[long_enough & (time_s - split_since_s[split] <= settings.contradicted_for_s)]
    return TrackPairs(
        np.append(ais, ais_now[split]),
        np.append(radar, radar_now[split]),
        np.append(paired_since_s, before.paired_since_s[split]),
        np.append(np.full(len(ais), np.inf), split_since_s[split]),
    )


def _in_cover(
    pairs: TrackPairs,
    ais_cover: SensorCover,
    radar_cover: SensorCover,
    picture: Picture,
    row_of_track: Ints,
    should_see: Bools,
    time_s: float,
) -> TrackPairs:
    """The pairs without those that have split and whose AIS track is where radars do not see most vessels.

    Where a radar or AIS is silent, the time since the split stands.
    Args: should_see: (R,) rows of the picture that some radar should see.
    """
    split = np.flatnonzero(np.isfinite(pairs.split_since_s))
    if not len(split):
        return pairs
    row = row_of_track[pairs.ais[split]]
    position_deg, every = picture.position_deg[row], np.ones(len(row), np.bool_)
    seen = radar_cover.within(position_deg, should_see[row])
    no_radar_s = radar_cover.stands_from_s(position_deg, ~seen)
    no_ais_s = ais_cover.stands_from_s(position_deg, ~ais_cover.within(position_deg, every))
    from_s = np.minimum(no_radar_s, no_ais_s)
    since_s = pairs.split_since_s.copy()
    stands = np.isfinite(from_s)
    since_s[split[stands]] = time_s - np.maximum(from_s[stands] - since_s[split[stands]], 0.0)
    counts = np.ones(len(pairs.ais), np.bool_)
    counts[split] = seen | np.isfinite(no_radar_s)
    kept = replace(pairs, split_since_s=since_s)
    return TrackPairs(*(getattr(kept, name)[counts] for name in vars(kept)))


def _contradicted(settings: IdentitySettings, pairs: TrackPairs, tracks: Tracks, time_s: float) -> Ints:
    """Pairs that have been split for long enough and are farther offset_m than a poor association would explain."""
    late = np.flatnonzero(time_s - pairs.split_since_s >= settings.contradicted_after_s)
    offset_m = difference_m(tracks.position_deg[pairs.ais[late]], tracks.position_deg[pairs.radar[late]])
    is_far = np.linalg.norm(offset_m, axis=1) >= settings.contradicted_from_m
    return np.asarray(late[is_far])


def nav_statuses(before: Ints, tracks: Tracks, row_of_track: Ints, alarms: AisAlarms) -> Ints:
    """The navigational status of each vessel: of its newest AIS report, or as it was before where it has no AIS now. (R,)

    Args: before: (R,) -1: none was sent; row_of_track: (N,) of the picture; alarms: with the status of each AIS track.
    """
    ais = np.flatnonzero(tracks.mmsi >= 0)
    at = kernels.tables.match_ids.index_of(alarms.track_id, tracks.track_id[ais])
    status, has_status = before.copy(), at >= 0
    status[row_of_track[ais[has_status]]] = alarms.nav_status[at[has_status]]
    return status


def ais_flags(mmsi: Ints, nav_status: Ints) -> Ints:
    """The flags that follow from an MMSI and a navigational status. Args: (R,) -1: none. Returns: (R,)"""
    device = mmsi // 1_000_000
    holds_by_flag = {
        Flag.ODD_MMSI: (mmsi >= 0) & ~is_vessel(mmsi),
        Flag.AIS_SART: (device == AIS_SART)
        | ((nav_status == NavStatus.AIS_SART_ACTIVE) & (device != MAN_OVERBOARD) & (device != EPIRB)),
        Flag.MAN_OVERBOARD: device == MAN_OVERBOARD,
        Flag.EPIRB: device == EPIRB,
        Flag.NOT_UNDER_COMMAND: nav_status == NavStatus.NOT_UNDER_COMMAND,
        Flag.AGROUND: nav_status == NavStatus.AGROUND,
    }
    flags = np.zeros(len(mmsi), np.int64)
    for flag, holds in holds_by_flag.items():
        flags[holds] |= int(flag)
    return flags
