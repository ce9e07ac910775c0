"""The history within an error bound: when a vessel gets a point, and its position between two points. Pure functions of arrays.

A point holds a vessel's position, speed and course at one cycle. Until its next point the vessel is dead-reckoned from there, at the
constant rates of latitude and longitude of that speed and course. A vessel gets a new point

- when its position in the picture is more than `history_error_m` from the dead-reckoned position,
- when `history_max_s` have passed since its last point, or its MMSI, flags or navigational status change,
- when it enters the picture,
- when it leaves: a closing point with its last position, in the first cycle without it.

So the history has exactly the vessels of every cycle, and no position is further off than the bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Picture
from coastwatch.geodesy import KNOT_M_S, difference_m, scale_m_deg, wrap_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.rows import Column, NullableId, motion, take

ROUNDING_M = 1e-6
"""Subtracted from the bound, for the rounding of speed, course, sine and cosine."""

HASH, HASH_RANGE = 2654435761, 1 << 32
"""Knuth's multiplicative hash: spreads the second points of vessels that came together over `history_max_s`."""


class Points(NamedTuple):
    """The newest point of each vessel of the newest cycle, sorted by vessel. P points."""

    vessel_id: Ints
    cycle: Ints
    mmsi: Ints  # -1: none
    flags: Ints
    first: Bools  # the first point of its stay: of the time that it is in the picture without a gap
    time_s: Floats
    position_deg: Floats  # (P, 2)
    motion: Floats  # (P, 5) speed in knots, course in degrees, half axes of the ellipse in metres, orientation in degrees
    updated_s: Floats
    rate_deg_s: Floats  # (P, 2) north, east
    nav_status: Ints  # -1: none was sent

    def take(self, rows: Ints | Bools) -> Points:
        """Some of them."""
        return Points._make(column[rows] for column in self)


class Bound(NamedTuple):
    """The settings of the rule."""

    error_m: float
    max_s: float


class Added(NamedTuple):
    """What a cycle adds to table `history`, and to table `identity`."""

    columns: list[Column]  # from `vessel_id` on, in key order
    points: int
    first_cycle: int  # every vessel of this cycle has its newest point in this cycle or a later one
    begun: Ints  # (n, 2) MMSI and vessel, where a vessel has an MMSI that it had not in the cycle before; in order
    ended: Ints  # (n, 2) MMSI and vessel, where it has one no longer


def no_points() -> Points:
    """Before the first cycle."""
    none, number = np.zeros(0), np.zeros(0, np.int64)
    pairs = np.zeros((0, 2))
    return Points(number, number, number, number, none > 0.0, none, pairs, np.zeros((0, 5)), none, pairs, number)


def extend(before: Points, bound: Bound, number: int, time_s: float, before_s: float, picture: Picture) -> tuple[Points, Added]:
    """The newest points after a cycle, and the rows that it adds.

    Args: number, time_s: of this cycle; before_s: time of the cycle before; picture: (V) sorted by vessel.
    """
    row = find(before.vessel_id, picture.vessel_id)
    written = _needs_point(before, row, bound, picture, time_s)
    stayed = np.zeros(len(before.vessel_id), np.bool_)
    stayed[row[row >= 0]] = True
    at = np.flatnonzero(written)
    position, moved = picture.position_deg[at], motion(picture.velocity_m_s[at], picture.covariance[at])
    fresh = Points(
        picture.vessel_id[at],
        np.full(len(at), number),
        picture.mmsi[at],
        picture.flags[at],
        row[at] < 0,
        np.full(len(at), time_s),
        position,
        moved,
        picture.updated_s[at],
        rate_deg_s(position, moved[:, 0], moved[:, 1]),
        picture.nav_status[at],
    )
    source = np.where(
        written, len(before.vessel_id) + np.cumsum(written) - 1, row
    )  # the fresh point of each vessel, or its last one
    after = Points._make(np.concatenate(pair)[source] for pair in zip(before, fresh, strict=True))
    first = int(after.cycle.min(initial=number))
    return after, _rows(before, fresh, row[at], before.take(~stayed), before_s, first)


def _needs_point(before: Points, row: Ints, bound: Bound, picture: Picture, time_s: float) -> Bools:
    """(V,) which vessels of a picture get a point. Args: row: (V,) of each vessel's point, -1: it has none."""
    needed = np.ones(len(row), np.bool_)
    rows = np.flatnonzero(row >= 0)
    p = before.take(row[rows])
    passed_s = time_s - p.time_s
    expected = p.position_deg + p.rate_deg_s * passed_s[:, None]
    off_m = np.hypot(*difference_m(picture.position_deg[rows], expected).T)
    wait_share = np.where(p.first, (p.vessel_id * HASH % HASH_RANGE) / HASH_RANGE, 1.0)
    same = (p.mmsi == picture.mmsi[rows]) & (p.flags == picture.flags[rows]) & (p.nav_status == picture.nav_status[rows])
    needed[rows] = ~(same & (off_m <= bound.error_m - ROUNDING_M)) | (passed_s >= bound.max_s * wait_share)
    return needed


def _rows(before: Points, fresh: Points, row: Ints, left: Points, before_s: float, first: int) -> Added:
    """The rows of fresh and closing points, by vessel. Args: row: (F,) of the point before each fresh one, -1: none."""
    last_deg = dead_reckon(left.position_deg, left.motion[:, 0], left.motion[:, 1], before_s - left.time_s)
    position = np.concatenate([fresh.position_deg, last_deg])
    moved = np.concatenate([fresh.motion, left.motion])
    vessel, _, mmsi, flags, *_ = columns_of_both = [np.concatenate(pair) for pair in zip(fresh, left, strict=True)]
    previous = np.where(row < 0, -1, np.append(before.cycle, -1)[row])
    columns: list[Column] = [
        vessel,
        *position.T,
        *moved.T,
        columns_of_both[Points._fields.index("updated_s")],
        NullableId(mmsi),
        flags,
        NullableId(np.concatenate([previous, left.cycle])),
        np.repeat([False, True], [len(fresh.vessel_id), len(left.vessel_id)]),
        NullableId(columns_of_both[Points._fields.index("nav_status")]),
    ]
    order = np.argsort(vessel, kind="stable")
    was = np.append(before.mmsi, -1)[row]
    changed = fresh.mmsi != was
    begun = np.stack([fresh.mmsi, fresh.vessel_id], 1)[changed & (fresh.mmsi >= 0)]
    ended = np.concatenate([np.stack([was, fresh.vessel_id], 1)[changed], np.stack([left.mmsi, left.vessel_id], 1)])
    ended = ended[ended[:, 0] >= 0]
    return Added([take(column, order) for column in columns], len(order), first, begun[np.lexsort(begun.T[::-1])], ended)


def rate_deg_s(position_deg: Floats, sog_kn: Floats, cog_deg: Floats) -> Floats:
    """Degrees of latitude and longitude a second; 0 where speed or course is unknown. Args: (P, 2), (P,), (P,). Returns: (P, 2)."""
    moves = (sog_kn > 0.0) & ~np.isnan(cog_deg)
    speed, course = np.where(moves, sog_kn, 0.0) * KNOT_M_S, np.radians(np.where(moves, cog_deg, 0.0))
    north, east = scale_m_deg(position_deg[:, 0])
    return np.stack([speed * np.cos(course) / north, speed * np.sin(course) / east], 1)


def dead_reckon(position_deg: Floats, sog_kn: Floats, cog_deg: Floats, seconds: Floats) -> Floats:
    """Positions some time after points. Args: (P, 2), (P,), (P,), (P,); NaN: stands still. Returns: (P, 2)."""
    moved_deg: Floats = position_deg + rate_deg_s(position_deg, sog_kn, cog_deg) * seconds[:, None]
    moved_deg[:, 1] = np.where(np.abs(moved_deg[:, 1]) <= 180.0, moved_deg[:, 1], wrap_deg(moved_deg[:, 1]))
    return moved_deg


def newest_rows(vessel_id: Ints, cycle: Ints, closing: Bools) -> Ints:
    """Rows of the newest point of each vessel, but of vessels that have left, by vessel. Args: (P,) points in any order."""
    order = np.lexsort((cycle, vessel_id))
    last = np.append(np.diff(vessel_id[order]) != 0, True)[: len(order)]
    rows: Ints = order[last]
    return rows[~closing[rows]]
