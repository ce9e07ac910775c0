"""AIS and radar tracks of one large ship of unknown size: the antenna stays a constant distance before or behind the echo.

Plots without extent say nothing of the length of a ship, and until it sends its size nobody knows where its antenna is. Two ships would be
two echoes, so only what is alone is joined: AIS that no radar sees where it says it is, and the one echo near it, which no AIS explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.associations.antennas_on_echoes import FAR_M, OnEchoes
from coastwatch.associations.pairing import associations_of
from coastwatch.batches import Associations, Batch, Bools, Floats, HullOffsets, Ints, SourceKind, Tracks, column
from coastwatch.geodesy import KNOT_M_S, difference_m, scale_m_deg
from coastwatch.kernels.tables.lookup import find, row_of

REACH_M = 230.0  # of an antenna from the middle of the longest ships
CLEAR_M = 300.0  # about both, in which there is no other AIS track, and no other track of this radar's region
CELL_M = 200.0  # of cells whose corners are nearer to each other than `CLEAR_M`
BANDS = 1 << 20  # more than there are cells around the earth
AFTER_S, KEPT_S = 90.0, 30.0  # for which a pair must last before it is joined; for which it may fail
LOOK_S = 15.0  # after which pairs are looked for again
STEADY_M = 75.0  # by which the distance may change: what departs is no antenna
ALIKE_SIGMAS = 3.0  # by which they may differ across the course and in velocity
UNDER_WAY_M_S = 2.0 * KNOT_M_S  # a slower ship has no course
ALIKE_M_S = 0.3  # by which velocities of one ship differ at least
SIZE_SIGMAS = 2.0  # of `HullOffsets`: antenna of a ship of known size


@dataclass(frozen=True, eq=False)
class BesideEchoes(Batch):
    """Pairs of an AIS track beside a radar track, both alone, sorted by the AIS track. A new radar track may follow the old one."""

    ais: Ints = column(np.int64, "A")  # track id
    echo: Ints = column(np.int64, "A")
    since_s: Floats = column(np.float64, "A")
    last_s: Floats = column(np.float64, "A")  # when they were so last
    apart_m: Floats = column(np.float64, "A")  # at first


def join_beside(
    before: BesideEchoes,
    tracks: Tracks,
    associations: Associations,
    kinds: Ints,
    hulls: HullOffsets,
    time_s: float,
    period_s: float,
) -> tuple[BesideEchoes, Associations, OnEchoes]:
    """The memory after a cycle, the associations with pairs that have lasted, and these pairs for fusion.

    Args: associations: of these tracks; kinds: (K,) SourceKind of each source; hulls: of ships whose size is known; period_s: of cycles.
    """
    is_ais, is_radar = kinds[tracks.source] == SourceKind.AIS, kinds[tracks.source] == SourceKind.RADAR
    count = int(associations.vessel.max(initial=-1)) + 1
    by_ais, by_radar = (np.bincount(associations.vessel[of], minlength=count) > 0 for of in (is_ais, is_radar))
    after = before
    if time_s // LOOK_S != (time_s - period_s) // LOOK_S:
        sole = _sole(tracks, is_ais) | _sole(tracks, is_radar)
        lone_ais = np.flatnonzero(sole & is_ais & ~by_radar[associations.vessel])
        lone_echo = np.flatnonzero(sole & is_radar & ~by_ais[associations.vessel] & np.isnan(tracks.echo_length_m))
        after = _looked(before, tracks, lone_ais, lone_echo, is_ais, hulls, time_s)
    old = after.take(time_s - after.since_s >= AFTER_S)
    first, second = row_of(tracks.track_id, np.concatenate([old.ais, old.echo])).reshape(2, -1)
    there = (first >= 0) & (second >= 0)
    first, second = first[there], second[there]
    free = ~by_radar[associations.vessel[first]] & ~by_ais[associations.vessel[second]]
    first, second = first[free], second[free]
    if not len(first):
        return after, associations, OnEchoes(first, second, np.zeros((0, 2)))
    off_m = difference_m(tracks.position_deg[first], tracks.position_deg[second])
    return after, _with_pairs(tracks, associations, first, second), OnEchoes(first, second, off_m)


def _looked(
    before: BesideEchoes, tracks: Tracks, ais: Ints, echo: Ints, is_ais: Bools, hulls: HullOffsets, time_s: float
) -> BesideEchoes:
    """The pairs that are so now, and those that were lately. Args: ais, echo: tracks that are in no vessel with the other kind."""
    ais, echo, apart_m = _near(tracks, ais, echo, hulls)
    k = find(before.ais, tracks.track_id[ais])
    same = k >= 0
    same[same] = np.abs(apart_m[same] - before.apart_m[k[same]]) <= STEADY_M
    fits = np.flatnonzero(_fits(tracks, ais, echo) & (same | (apart_m >= FAR_M)))
    fits = fits[_alone(tracks, is_ais, ais[fits], echo[fits])]
    fits = fits[np.lexsort((apart_m[fits], tracks.track_id[ais[fits]]))]  # of two regions the nearer echo
    fits = fits[np.append(True, np.diff(ais[fits]) != 0)[: len(fits)]]
    apart_m, k, same = apart_m[fits], k[fits], same[fits]
    since_s, first_m = np.full(len(fits), time_s), apart_m.copy()
    since_s[same], first_m[same] = before.since_s[k[same]], before.apart_m[k[same]]
    ids, of = tracks.track_id[ais[fits]], tracks.track_id[echo[fits]]
    kept = (time_s - before.last_s <= KEPT_S) & ~np.isin(before.ais, ids) & ~np.isin(before.echo, of)
    after = BesideEchoes.join([before.take(kept), BesideEchoes(ids, of, since_s, np.full(len(fits), time_s), first_m)])
    return after.take(np.argsort(after.ais))


def _sole(tracks: Tracks, some: Bools) -> Bools:
    """Which of these tracks are the only one of their source in their cell. A crowd has none, so no work grows faster than its size."""
    rows = np.flatnonzero(some)
    band_deg = CELL_M / scale_m_deg(np.zeros(1))[0]
    band = np.floor(tracks.position_deg[rows, 0] / band_deg)
    cell = np.floor(tracks.position_deg[rows, 1] * scale_m_deg(band * band_deg)[1] / CELL_M)
    key = (tracks.source[rows] * BANDS + band.astype(np.int64)) * BANDS + cell.astype(np.int64)
    _, of_row, count = np.unique(key, return_inverse=True, return_counts=True)
    sole = np.zeros(len(tracks), np.bool_)
    sole[rows] = count[of_row] == 1
    return sole


def _near(tracks: Tracks, ais: Ints, echo: Ints, hulls: HullOffsets) -> tuple[Ints, Ints, Floats]:
    """Pairs of these tracks within reach of each other. (P,), (P,), distance (P,) m"""
    site, row, off_m = _around(tracks, echo, ais, REACH_M)
    ais, echo, apart_m = row, echo[site], np.hypot(*off_m.T)
    known = find(hulls.mmsi, tracks.mmsi[ais])
    reach_m = np.where(known >= 0, FAR_M + SIZE_SIGMAS * np.append(hulls.sigma_m, 0.0)[known], REACH_M)
    some = apart_m <= reach_m
    return ais[some], echo[some], apart_m[some]


def _alone(tracks: Tracks, is_ais: Bools, ais: Ints, echo: Ints) -> Bools:
    """Which pairs have no other AIS near the echo, and no other echo of its region near the AIS. (P,)"""
    of_echo, _, _ = _around(tracks, echo, np.flatnonzero(is_ais), CLEAR_M)
    of_ais, other, _ = _around(tracks, ais, np.flatnonzero(np.isin(tracks.source, tracks.source[echo])), CLEAR_M)
    of_ais = of_ais[tracks.source[other] == tracks.source[echo[of_ais]]]
    alone: Bools = (np.bincount(of_echo, minlength=len(ais)) == 1) & (np.bincount(of_ais, minlength=len(ais)) == 1)
    return alone


def _around(tracks: Tracks, rows: Ints, others: Ints, reach_m: float) -> tuple[Ints, Ints, Floats]:
    """Pairs of one of `rows`, by its number there, and a track of `others` within reach; the way to it. (P,), (P,), (P, 2) m"""
    site_deg, ranges_m = tracks.position_deg[rows], np.full(len(rows), reach_m)
    near, site, off_m = kernels.geometry.sensor_coverage.pairs_in_range(
        site_deg, ranges_m, tracks.position_deg[others], np.zeros(len(others))
    )
    return site, others[near], off_m


def _fits(tracks: Tracks, ais: Ints, echo: Ints) -> Bools:
    """Which pairs are of equal velocity and, under way, one before the other. (A,)"""
    off_m = difference_m(tracks.position_deg[ais], tracks.position_deg[echo])
    velocity = tracks.velocity_m_s[ais]
    apart_m_s = velocity - tracks.velocity_m_s[echo]
    covariance = tracks.take(ais).known_covariance(ALIKE_M_S) + tracks.take(echo).known_covariance(ALIKE_M_S)
    position = covariance[:, :2, :2] + tracks.report_covariance[echo]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    ahead = velocity / np.maximum(speed, 1e-9)[:, None]
    starboard = np.column_stack([ahead[:, 1], -ahead[:, 0]])
    across_m = (off_m * starboard).sum(axis=1)
    across_sigma_m = np.sqrt(np.einsum("ni,nij,nj->n", starboard, position, starboard))
    in_line = (speed < UNDER_WAY_M_S) | (np.abs(across_m) <= FAR_M + ALIKE_SIGMAS * across_sigma_m)
    alike = np.hypot(*apart_m_s.T) <= ALIKE_M_S + ALIKE_SIGMAS * np.sqrt(np.trace(covariance[:, 2:, 2:], axis1=1, axis2=2))
    out: Bools = in_line & alike
    return out


def _with_pairs(tracks: Tracks, associations: Associations, ais: Ints, echo: Ints) -> Associations:
    """The associations with these pairs too. Their statistic says nothing."""
    is_distance = associations.statistic_is_distance
    first, second = np.append(associations.first, np.minimum(ais, echo)), np.append(associations.second, np.maximum(ais, echo))
    statistic = np.append(associations.statistic, np.zeros(len(ais)))
    gain = np.append(np.full(len(associations.first), 1.0), np.full(len(ais), 0.5))
    order = np.lexsort((second, first))
    first, second, statistic, gain = first[order], second[order], statistic[order], gain[order]
    return associations_of(tracks, first, second, statistic, gain, is_distance=is_distance, counts=associations)
