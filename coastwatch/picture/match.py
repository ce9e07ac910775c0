"""Which vessel of the last cycle each group of tracks continues: by votes of its tracks, else by MMSI, else by position.

A vessel is a row of `KnownVessels`; a group is a number of `Associations.vessel`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Bools, Floats, Ints, Picture, Rows, Sensors, SourceKind, Struct, Tracks, column
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred, offset_deg
from coastwatch.kernels.filters.gaussian import squared_distance
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.inputs import PictureInput
from coastwatch.picture.settings import IdentitySettings
from coastwatch.picture.vessels import Groups, KnownColumns, KnownVessels, predict, rows_of_groups

AIS_WEIGHT = 1.2  # of the vote of an AIS track; a radar track has 1
UNDER_WAY_M_S = 1.0  # from this speed on an AIS track may be succeeded by that of another MMSI
SENIORITY_GAIN, SENIORITY_S = 0.5, 60.0  # most that a vessel gains by its age, and the age for half of it
NEAR_M = 2000.0  # farther off than a vessel without tracks can be
TURN_S, TURN_GAP_S, TURN_SLACK_S = 60.0, 20.0, 6.0
"""Of a vessel that has turned away from its track: for how long that counts; between the last plot of the one track and the first of
the other; time added to the way between them."""

TURN_SIGMAS, SHARPEST_M_S2 = 3.0, 1.5
SPEED_CHANGE, SPEED_SLACK_M_S = 0.3, 2.0  # of its speeds before and after
MMSI_SLACK_S = 10.0  # added to the time of a return by MMSI, for the error of both positions


@dataclass(frozen=True, eq=False)
class KnownTracks(Struct):
    """The tracks of the last cycle, and the vessels that they were in."""

    track_id: Ints = column(np.int64, "L")
    vessel: Ints = column(np.int64, "L")  # the vessel it was in
    first_vessel: Ints = column(np.int64, "L")  # the first vessel it ever was in


@dataclass(frozen=True, eq=False)
class IdentityMatch:
    """Which vessel each group continues."""

    groups: Groups
    track_now: Rows  # (L,) row of each track of the last cycle, -1 where it has ended
    first_vessel: Rows  # (N,) the first vessel that a track ever was in, -1 for a new track
    remembered: Array  # (K,) whether tracks of this cycle were in each vessel, now or first: `kernels.identity.match.recall`
    vessel_of_group: Ints  # (V,) -1: a new vessel
    group_of_vessel: Ints  # (K,) -1: a vessel without tracks


def match_identities(
    settings: IdentitySettings,
    known: KnownVessels,
    columns: KnownColumns,
    before: KnownTracks,
    given: PictureInput,
) -> IdentityMatch:
    """Match the groups of this cycle one-to-one with the vessels of the last cycle.

    A track votes for the vessel it was in, and with a share of its vote for the first it ever was in. A group without votes may be
    a vessel that has lost all its tracks. So may one of a vessel without an MMSI that began since, when AIS joins it: radar has seen
    the ship again first.
    """
    tracks, time_s, groups = given.tracks, given.time_s, given.associations.by_vessel
    row_before, track_now = kernels.tables.match_ids.match_ids(before.track_id, tracks.track_id)
    previous, first_vessel, remembered = kernels.identity.match.recall(
        row_before, before.vessel, before.first_vessel, len(columns.vessel_id)
    )
    weight = np.where(given.sensors.source_kinds == SourceKind.AIS, AIS_WEIGHT, 1.0)[tracks.source]
    heard = tracks.source, tracks.started_s, np.where(_may_be_renumbered(tracks, given.sensors), tracks.updated_s, np.inf)
    vessel_of_group = _settle_votes(groups, previous, first_vessel, weight, heard, columns, time_s)

    is_free = remembered[: len(known.shown) + len(known.hidden)] != kernels.identity.match.AS_PREVIOUS
    is_free[vessel_of_group[(vessel_of_group >= 0) & (vessel_of_group < len(is_free))]] = False
    free, new = np.flatnonzero(is_free), np.flatnonzero(vessel_of_group < 0)
    if len(free) > 0 and len(new) > 0:
        new_rows = rows_of_groups(new, np.full(len(new), -1), groups, tracks, given.fused, columns)
        rows, vessels = _match_returns(settings, known, columns, free, new_rows, time_s)
        vessel_of_group[new[rows]] = vessels

    is_free[vessel_of_group[(vessel_of_group >= 0) & (vessel_of_group < len(is_free))]] = False
    joined = _joined_by_ais(tracks.mmsi, row_before, given.associations.vessel, vessel_of_group, columns)
    named = np.flatnonzero(is_free & (columns.mmsi[: len(is_free)] >= 0)) if len(joined) else joined
    if len(named) > 0:
        since_s = columns.since_s[vessel_of_group[joined]]
        rows_now = rows_of_groups(joined, np.full(len(joined), -1), groups, tracks, given.fused, columns)
        rows, old = _match_mmsi(settings, rows_now, known.take(named), time_s)
        is_later = since_s[rows] >= columns.updated_s[named[old]]
        vessel_of_group[joined[rows[is_later]]] = named[old[is_later]]

    is_free[vessel_of_group[(vessel_of_group >= 0) & (vessel_of_group < len(is_free))]] = False
    goes_on = remembered[: len(is_free)] == kernels.identity.match.AS_PREVIOUS
    _restore_after_turns(known, columns, is_free, goes_on, vessel_of_group, time_s)

    group_of_vessel = np.full(len(columns.vessel_id), -1, np.int64)
    matched = np.flatnonzero(vessel_of_group >= 0)
    group_of_vessel[vessel_of_group[matched]] = matched
    return IdentityMatch(groups, track_now, first_vessel, remembered, vessel_of_group, group_of_vessel)


def _may_be_renumbered(tracks: Tracks, sensors: Sensors) -> Bools:
    """Tracks that another one of their source may go on with: of track sources, and AIS under way. (N,)

    Radar tracks of a region, and AIS at rest, that begin and end beside each other may be of two ships at one berth.
    """
    kinds, speed_m_s = sensors.source_kinds[tracks.source], np.hypot(tracks.velocity_m_s[:, 0], tracks.velocity_m_s[:, 1])
    is_received = (kinds == SourceKind.RADAR) & (tracks.source >= len(sensors.region_names))
    may_be: Bools = is_received | ((kinds == SourceKind.AIS) & (speed_m_s > UNDER_WAY_M_S))
    return may_be


def _settle_votes(
    groups: Groups,
    previous: Rows,
    first_vessel: Rows,
    weight: Floats,
    heard: tuple[Ints, Floats, Floats],
    columns: KnownColumns,
    time_s: float,
) -> Ints:
    """The vessel of each group by the votes of its tracks, one-to-one, -1 where none. (V,)

    A track that its source follows under another number by now would keep the id of its vessel, and take it along when it ends. So its
    vote goes to the group of that number. Args: heard: source, start and newest report of each track, as of `hand_on`.
    """
    start, _ = groups
    age_s = np.where(np.isfinite(columns.since_s), time_s - columns.since_s, 0.0)
    seniority = SENIORITY_GAIN * age_s / (age_s + SENIORITY_S)
    vessel_of_group = np.full(len(start) - 1, -1, np.int64)
    votes = in_blocks(
        kernels.identity.match.count_votes, len(vessel_of_group), groups, previous, first_vessel, weight, seniority
    )
    group, vessel, gain = (np.concatenate(part) for part in zip(*votes, strict=True))
    contested = kernels.identity.match.settle_uncontested(group, vessel, gain, columns.vessel_id, vessel_of_group)
    group, vessel, gain = group[contested], vessel[contested], gain[contested]
    kept, gain = kernels.identity.match.hand_on(group, vessel, gain, groups, previous, seniority, heard)
    group, vessel, gain = group[kept], vessel[kept], gain[kept]
    chosen = kernels.association.assignment.assign(group, columns.vessel_id[vessel], gain)
    vessel_of_group[group[chosen]] = vessel[chosen]
    return vessel_of_group


def _joined_by_ais(mmsi: Ints, row_before: Rows, group: Ints, vessel_of_group: Ints, columns: KnownColumns) -> Ints:
    """The groups that a new AIS track joins, and that continue a vessel without an MMSI. Args: mmsi, row_before, group: (N,) of tracks."""
    joined = np.unique(group[(row_before < 0) & (mmsi >= 0)])
    vessel = vessel_of_group[joined]
    joined, vessel = joined[vessel >= 0], vessel[vessel >= 0]
    return joined[(columns.mmsi[vessel] < 0) & np.isfinite(columns.since_s[vessel])]


def _match_returns(
    settings: IdentitySettings, known: KnownVessels, columns: KnownColumns, free: Ints, new: Picture, time_s: float
) -> tuple[Ints, Ints]:
    """Vessels without tracks that return as new groups, by MMSI first. Args: free: (F,) vessels; new: rows of the groups.

    Returns: rows of `new` (B,), vessels (B,).
    """
    is_held = time_s - columns.updated_s[free] <= settings.hold_s
    named = np.isin(columns.mmsi[free], new.mmsi[new.mmsi >= 0])
    free = free[is_held | named]
    free = free[np.argsort(columns.vessel_id[free])]
    old = known.take(free)
    new_by_mmsi, old_by_mmsi = _match_mmsi(settings, new, old, time_s)
    is_held = time_s - old.updated_s <= settings.hold_s
    is_held[old_by_mmsi] = False
    rest = np.delete(np.arange(len(new)), new_by_mmsi)
    new_by_position, old_by_position = _match_positions(settings, new, rest, old, np.flatnonzero(is_held), time_s)
    return np.append(new_by_mmsi, new_by_position), free[np.append(old_by_mmsi, old_by_position)]


def _restore_after_turns(
    known: KnownVessels, columns: KnownColumns, is_free: Bools, goes_on: Bools, vessel_of_group: Ints, time_s: float
) -> None:
    """Give the groups of later vessels the ids of vessels that lost their track in a sharp turn, in place.

    A filter that goes on straight loses its vessel, and a second track begins beside it. The later vessel has no MMSI, began about when
    the other one was seen last, at about the same speed, where that one may have turned to. No other pair has one of the two.
    Args: is_free: (K,) shown and hidden vessels without tracks; goes_on: (K,) those with a track of the last cycle; vessel_of_group:
    (V,) written.
    """
    from scipy.spatial import cKDTree

    old = np.flatnonzero(is_free)
    old = old[time_s - columns.updated_s[old] <= TURN_S]
    if len(old) == 0:
        return
    later = vessel_of_group[(vessel_of_group >= 0) & (vessel_of_group < len(known.shown))]
    shown, later = known.shown, later[goes_on[later]]
    later = later[(shown.mmsi[later] < 0) & (time_s - shown.since_s[later] <= TURN_S)]
    if len(later) == 0:
        return
    old = old[np.argsort(columns.vessel_id[old])]
    one, two = known.take(old), shown.take(later)
    seen_deg = offset_deg(one.position_deg, -one.velocity_m_s * (one.time_s - one.updated_s)[:, None])
    begun_deg = offset_deg(two.position_deg, -two.velocity_m_s * (two.time_s - two.since_s)[:, None])
    trees = cKDTree(earth_centred(seen_deg)), cKDTree(earth_centred(begun_deg))
    near = trees[0].sparse_distance_matrix(trees[1], NEAR_M, output_type="ndarray")
    i, j, away_m = near["i"].astype(np.int64), near["j"].astype(np.int64), near["v"]
    gap_s, passed_s = two.since_s[j] - one.updated_s[i], time_s - one.updated_s[i]
    speeds = np.stack([np.hypot(*one.velocity_m_s[i].T), np.hypot(*two.velocity_m_s[j].T)])
    spread_m = np.sqrt(np.trace(one.covariance[i, :2, :2] + two.covariance[j, :2, :2], axis1=1, axis2=2))
    turned = np.hypot(*(one.velocity_m_s[i] - two.velocity_m_s[j]).T) <= SHARPEST_M_S2 * passed_s
    fits = turned & (np.abs(gap_s) <= TURN_GAP_S) & (one.since_s[i] < two.since_s[j])
    fits &= away_m <= speeds.max(axis=0) * (np.abs(gap_s) + TURN_SLACK_S) + TURN_SIGMAS * spread_m
    fits &= speeds.max(axis=0) - speeds.min(axis=0) <= SPEED_CHANGE * speeds.max(axis=0) + SPEED_SLACK_M_S
    i, j = i[fits], j[fits]
    alone = (np.bincount(i, minlength=len(old))[i] == 1) & (np.bincount(j, minlength=len(later))[j] == 1)
    group_of = np.full(len(is_free), -1, np.int64)
    known_rows = (vessel_of_group >= 0) & (vessel_of_group < len(is_free))
    group_of[vessel_of_group[known_rows]] = np.flatnonzero(known_rows)
    vessel_of_group[group_of[later[j[alone]]]] = old[i[alone]]


def _match_mmsi(settings: IdentitySettings, new: Picture, old: Picture, time_s: float) -> tuple[Ints, Ints]:
    """Rows of new and old vessels with the same MMSI, near enough for a ship; of several old ones the last that was updated.

    Of several new ones, as of a ship and a clone of its MMSI, the nearest.
    """
    order = np.lexsort((-old.updated_s, old.mmsi))
    mmsi, first = np.unique(old.mmsi[order], return_index=True)
    rows = np.flatnonzero((new.mmsi >= 0) & np.isin(new.mmsi, mmsi))
    candidates = order[first[np.searchsorted(mmsi, new.mmsi[rows])]]
    silent_s = time_s - old.updated_s[candidates]
    distance_m = np.linalg.norm(difference_m(new.position_deg[rows], old.position_deg[candidates]), axis=1)
    reach_m = settings.max_speed_kn * KNOT_M_S * (silent_s + MMSI_SLACK_S)
    fits = (silent_s <= settings.return_s) & (distance_m <= reach_m)
    by_distance = np.flatnonzero(fits)[np.argsort(distance_m[fits], kind="stable")]
    rows, candidates = rows[by_distance], candidates[by_distance]
    _, once = np.unique(candidates, return_index=True)
    return rows[once], candidates[once]


def _match_positions(
    settings: IdentitySettings, new: Picture, rest: Ints, old: Picture, candidates: Ints, time_s: float
) -> tuple[Ints, Ints]:
    """Rows of new and old vessels that are near in position and velocity, one-to-one. Args: rest, candidates: rows that may match."""
    from scipy.spatial import cKDTree

    none = np.zeros(0, np.int64)
    if len(rest) == 0 or len(candidates) == 0:
        return none, none
    moved = predict(old.take(candidates), time_s, settings.drift_m_s15)
    trees = cKDTree(earth_centred(new.position_deg[rest])), cKDTree(earth_centred(moved.position_deg))
    near = trees[0].sparse_distance_matrix(trees[1], NEAR_M, output_type="ndarray")
    i, j = rest[near["i"]], near["j"].astype(np.int64)
    same_name = (new.mmsi[i] < 0) | (moved.mmsi[j] < 0) | (new.mmsi[i] == moved.mmsi[j])
    i, j = i[same_name], j[same_name]
    position_m = difference_m(new.position_deg[i], moved.position_deg[j])
    velocity_m_s = new.velocity_m_s[i] - moved.velocity_m_s[j]
    difference = np.concatenate([position_m, velocity_m_s], axis=1)
    distance2 = squared_distance(difference, new.covariance[i] + moved.covariance[j])
    chosen = kernels.association.assignment.assign(i, j, settings.return_gate - distance2)
    return i[chosen], candidates[j[chosen]]
