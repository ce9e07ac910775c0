"""The vessels of the picture and those that left it lately: what alarms need of their past."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.alarms.lasting import AlarmSettings
from coastwatch.batches import (
    Batch,
    Bools,
    Flag,
    Floats,
    Ints,
    Members,
    NavStatus,
    Picture,
    Sensors,
    SourceKind,
    column,
    optional_column,
)
from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg
from coastwatch.kernels.tables.lookup import find

AIS, RADAR = 1, 2
"""Bits of `Watched.sources`."""

FASTEST_M_S = 120.0 * KNOT_M_S
"""A vessel that seems to have been faster is elsewhere because its track was corrected."""

SIGMAS = 3.0
MIDDLE_SLACK = 1.1  # radii from where a ship came to rest to the middle of its circle, at most


@dataclass(frozen=True, eq=False)
class Watched(Batch):
    """Vessels by id. U rows. While a vessel has no track, its row stays as it was when it had one last."""

    vessel_id: Ints = column(np.int64, "U")  # ascending
    seen_s: Floats = column(np.float64, "U")  # last time with a track; later by the time for which its sensors were silent
    since_s: Floats = column(np.float64, "U")  # first one; later by the same
    placed_s: Floats = column(np.float64, "U")  # last time with a track: when it was at `position_deg`
    position_deg: Floats = column(np.float64, "U", 2)
    velocity_m_s: Floats = column(np.float64, "U", 2)
    mmsi: Ints = column(np.int64, "U")
    sources: Ints = column(np.int64, "U")  # sum of AIS and RADAR
    track_source: Ints = column(np.int64, "U")  # number of the track source that alone tracked it; -1: another sensor did too
    here: Bools = column(np.bool_, "U")  # it is in the picture
    tracked: Bools = column(np.bool_, "U")  # it has a track
    came_s: Floats = column(np.float64, "U")  # since when it has been watched without being forgotten
    way_from_deg: Floats = column(np.float64, "U", 2)  # where the way begins that is looked at for crossings
    anchorage_deg: Floats = column(np.float64, "U", 2)  # middle of the swing circle
    at_rest_s: Floats = column(np.float64, "U")  # since when it has lain at the anchorage; NaN: it does not
    outside_s: Floats = column(np.float64, "U")  # since when it has been out of the swing circle; NaN: it is inside
    rest_deg: Floats = optional_column("U", 2)  # where it came to rest, on its swing circle or inside

    @property
    def speed_m_s(self) -> Floats:
        """(U,)"""
        return np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])


@dataclass(frozen=True, eq=False)
class Seen:
    """The watched vessels of a cycle, and which of them have a track."""

    watched: Watched
    rows: Ints  # (R,) of the vessels with a track, ascending
    picture: Picture  # R rows, the same vessels
    frozen: Ints  # (F,) ids of watched vessels without a track
    moved: Bools  # (R,) far enough since `way_from_deg`, and not farther than a vessel can
    way_from_deg: Floats  # (R, 2)
    before_deg: Floats  # (R, 2) where each was seen last; NaN: never, or so long ago that nothing is known
    dragging: Bools  # (R,)
    lain_s: Floats  # (R,) at rest at the anchorage
    away_m: Floats  # (R,) from the anchorage

    @property
    def sigma_m_s(self) -> Floats:
        """(R,) standard deviation of each speed; 0 where it is not known."""
        return np.asarray(_sigma_m_s(self.picture) / np.sqrt(2.0))


def watch_vessels(
    settings: AlarmSettings,
    before: Watched,
    picture: Picture,
    members: Members,
    members_before: Members,
    sensors: Sensors,
    time_s: float,
) -> Seen:
    """The watched vessels after a cycle. Args: picture, members: of the cycle; members_before: of the cycle before."""
    tracked = (picture.flags & Flag.COASTING) == 0
    now = picture.take(tracked)
    at = find(before.vessel_id, now.vessel_id)
    was_watched = np.flatnonzero(at >= 0)
    at = at[was_watched]
    fresh = _rows_of(now, members, sensors, time_s)
    columns = {name: getattr(fresh, name) for name in vars(fresh)}
    for name in ("came_s", "way_from_deg", "anchorage_deg", "at_rest_s", "outside_s", "rest_deg"):
        columns[name][was_watched] = getattr(before, name).take(at, axis=0)
    waited_s = np.zeros(len(now))
    waited_s[was_watched] = time_s - before.placed_s[at]
    columns["came_s"][waited_s > settings.forget_s] = time_s
    columns["way_from_deg"][waited_s > settings.forget_s] = now.position_deg[waited_s > settings.forget_s]
    before_deg = np.full((len(now), 2), np.nan)
    before_deg[was_watched] = before.position_deg.take(at, axis=0)

    way_from_deg = columns["way_from_deg"].copy()
    way_m = np.hypot(*difference_m(now.position_deg, way_from_deg).T)
    period_s = np.maximum(waited_s, 1.0)
    jumped = way_m > settings.line_margin_m + FASTEST_M_S * period_s + SIGMAS * _sigma_m(now)
    at_rest = fresh.speed_m_s <= SIGMAS * _sigma_m_s(now)  # perhaps: then its position is where noise puts it
    moved = (way_m >= settings.line_margin_m + np.where(at_rest, SIGMAS * _sigma_m(now), 0.0)) & ~jumped
    columns["way_from_deg"][moved | jumped] = now.position_deg[moved | jumped]
    row = Watched(**columns)
    row, dragging, lain_s, away_m = _anchored(settings, row, now, waited_s, time_s)

    watched = _with_absent(settings, before, row, picture, members, members_before, time_s)
    rows = find(watched.vessel_id, now.vessel_id)
    without = np.ones(len(watched.vessel_id), np.bool_)
    without[rows] = False
    frozen = watched.vessel_id[without & (time_s - watched.placed_s <= settings.forget_s)]
    return Seen(watched, rows, now, frozen, moved, way_from_deg, before_deg, dragging, lain_s, away_m)


def _rows_of(now: Picture, members: Members, sensors: Sensors, time_s: float) -> Watched:
    """The rows of vessels with a track, as if all were new."""
    n, kinds = len(now), sensors.source_kinds
    sources = np.zeros(n, np.int64)
    row = find(now.vessel_id, members.vessel_id)
    for kind, bit in ((SourceKind.AIS, AIS), (SourceKind.RADAR, RADAR)):
        of_kind = row[(kinds[members.source] == int(kind)) & (row >= 0)]
        sources[of_kind] |= bit
    is_shown, first_source = row >= 0, len(sensors.region_names)
    track_source, others = np.full(n, -1, np.int64), np.zeros(n, np.bool_)
    is_given = (members.source >= first_source) & (members.source < sensors.ais_source)
    np.maximum.at(track_source, row[is_shown & is_given], members.source[is_shown & is_given] - first_source)
    others[row[is_shown & ~is_given]] = True
    track_source[others] = -1
    time, unknown = np.full(n, float(time_s)), np.full(n, np.nan)
    place = now.position_deg
    first = (
        now.vessel_id,
        time,
        now.since_s,
        time.copy(),
        place,
        now.velocity_m_s,
        now.mmsi,
        sources,
        track_source,
        np.ones(n, np.bool_),
        np.ones(n, np.bool_),
    )
    return Watched(*first, time.copy(), place.copy(), np.full((n, 2), np.nan), unknown, unknown.copy(), np.full((n, 2), np.nan))


def _with_absent(
    settings: AlarmSettings,
    before: Watched,
    row: Watched,
    picture: Picture,
    members: Members,
    members_before: Members,
    time_s: float,
) -> Watched:
    """The rows of all vessels: those with a track, and of the others those that are not forgotten.

    A vessel that left the picture while it had a track is dropped if one of its tracks goes on: that one is in another vessel now. A
    vessel whose tracks have ended is kept. One with AIS alone leaves so: its track is predicted for longer than a vessel without one.
    Args: row: of the vessels with a track; the others as in `look`.
    """
    gone = before.take(find(row.vessel_id, before.vessel_id) < 0)
    here = find(picture.vessel_id, gone.vessel_id) >= 0
    keep_s = max(settings.forget_s, settings.lost_for_s if settings.lost_after_s else 0.0)
    merged = ~here & gone.tracked
    of_merged = np.flatnonzero(find(gone.vessel_id[merged], members_before.vessel_id) >= 0)
    goes_on = kernels.tables.match_ids.index_of(members.track_id, members_before.track_id[of_merged]) >= 0
    merged &= np.isin(gone.vessel_id, members_before.vessel_id[of_merged[goes_on]])
    kept = ~merged & (time_s - gone.seen_s <= keep_s)
    gone = replace(gone, here=here, tracked=np.zeros(len(here), np.bool_)).take(kept)
    every = Watched.join([row, gone])
    return every.take(np.argsort(every.vessel_id, kind="stable"))


def _anchored(
    settings: AlarmSettings, row: Watched, now: Picture, waited_s: Floats, time_s: float
) -> tuple[Watched, Bools, Floats, Floats]:
    """The rows with their anchorages, which of them drag, how long each has lain there, and how far from it each is. (R,)

    A vessel comes to rest when it is stationary, or at anchor and slow. It drags where it is out of its swing circle and slow, if its
    status says "at anchor" or it has lain there for long. It has got under way, and has no anchorage, once it is fast, or out of the
    circle for another reason. One that lies outside for `settle_s` has a new anchorage there. As a ship comes to rest on the rim of
    its circle, the middle moves after it, no more than it must, while it is no farther than a radius from where the ship came to rest.
    Args: row, now: R vessels with a track; waited_s: (R,) since each had one before.
    """
    slow = row.speed_m_s <= settings.drag_kn * KNOT_M_S
    at_anchor = now.nav_status == NavStatus.AT_ANCHOR
    rests = ((now.flags & Flag.STATIONARY) != 0) | (at_anchor & slow)
    anchorage, at_rest_s, outside_s = row.anchorage_deg.copy(), row.at_rest_s.copy(), row.outside_s.copy()
    new = np.isnan(at_rest_s) & rests
    anchorage[new], at_rest_s[new] = now.position_deg[new], time_s
    lain_s = time_s - at_rest_s
    away_m, lies = np.full(len(now), np.nan), np.flatnonzero(~np.isnan(at_rest_s))
    away_m[lies] = np.hypot(*difference_m(now.position_deg[lies], anchorage[lies]).T)
    radius_m = settings.swing_m + SIGMAS * _sigma_m(now)
    outside = away_m > radius_m
    settling = ~outside & (lain_s > 0.0) & (lain_s < settings.settle_s)
    weight = waited_s[settling] / (lain_s[settling] + waited_s[settling])
    step_m = difference_m(now.position_deg[settling], anchorage[settling])
    anchorage[settling] = offset_deg(anchorage[settling], weight[:, None] * step_m)
    rest_deg = np.where((settling | np.isnan(row.rest_deg[:, 0]))[:, None], anchorage, row.rest_deg)
    swung = np.flatnonzero(outside & (lain_s >= settings.settle_s))
    share = (1.0 - radius_m[swung] / away_m[swung])[:, None]
    middle = offset_deg(anchorage[swung], share * difference_m(now.position_deg[swung], anchorage[swung]))
    near = np.hypot(*difference_m(middle, rest_deg[swung]).T) <= MIDDLE_SLACK * settings.swing_m
    anchorage[swung[near]], outside[swung[near]] = middle[near], False
    outside_s[outside & np.isnan(outside_s)] = time_s
    outside_s[~outside] = np.nan
    dragging = outside & slow & (at_anchor | (outside_s - at_rest_s >= settings.rest_s)) & (settings.swing_m > 0.0)
    stopped = dragging & ((now.flags & Flag.STATIONARY) != 0) & (time_s - outside_s >= settings.settle_s)
    left = ~np.isnan(at_rest_s) & (~slow | (outside & ~dragging) | stopped)
    anchorage[left], at_rest_s[left], outside_s[left], rest_deg[left] = np.nan, np.nan, np.nan, np.nan
    row = replace(row, anchorage_deg=anchorage, at_rest_s=at_rest_s, outside_s=outside_s, rest_deg=rest_deg)
    return row, dragging & ~left, lain_s, away_m


def _sigma_m(now: Picture) -> Floats:
    """Standard deviation of each position; 0 where it is not known. (R,)"""
    return np.nan_to_num(np.sqrt(now.covariance[:, 0, 0] + now.covariance[:, 1, 1]))


def _sigma_m_s(now: Picture) -> Floats:
    """Standard deviation of each velocity; 0 where it is not known. (R,)"""
    return np.nan_to_num(np.sqrt(now.covariance[:, 2, 2] + now.covariance[:, 3, 3]))
