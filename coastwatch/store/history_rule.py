"""The history under a bounded error: when a vessel gets a point, and where it was between two of them.

A point says where a vessel was, how fast and on what course. Until its next point it is taken to have gone on like that. A new point
is written as soon as the picture would otherwise be more than a set distance from there, a set time has passed, its MMSI or its flags
have changed, or it has come. A vessel that has left gets a closing point in the first cycle without it. The promise (tested): at every
cycle every vessel of the picture is found, no other is, and none is further from its place than the distance.

Pure: what is kept between cycles is the newest point of each vessel, and that can be read back from the points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, Bools, Floats, Ints, Picture
from coastwatch.geodesy import KNOT_M_S, scale_m_deg, wrap_deg
from coastwatch.store.cells import Column, Named, part
from coastwatch.store.columns import Motion, motion

ROUNDING_M = 1e-6
"""Taken off the distance, for the rounding of speed and course and of another's sine and cosine."""


class Points(NamedTuple):
    """The newest point of each vessel of the newest cycle, sorted by vessel: the columns of kernels.dead_reckoning."""

    whole: Ints  # (P, 5)
    real: Floats  # (P, 11)


class Bound(NamedTuple):
    """What the rule holds to."""

    error_m: float
    max_s: float


class Added(NamedTuple):
    """What a cycle adds to table `history`."""

    columns: list[Column]  # from `vessel_id` on, in key order
    points: int
    first_cycle: int  # in which, or after which, every vessel of this cycle has its newest point
    named: Ints  # (n, 2) MMSI and vessel, where a vessel has an MMSI that it had not in the cycle before; in order
    unnamed: Ints  # (n, 2) the same of those that were, and are no longer


def none() -> Points:
    """Before the first cycle."""
    return Points(np.zeros((0, 5), np.int64), np.zeros((0, 11)))


def step(
    before: Points, bound: Bound, number: int, time_s: float, before_s: float, picture: Picture, moved: Motion | None = None
) -> tuple[Points, Added]:
    """The newest points after a cycle, and the rows that it adds.

    Args: time_s: of the cycle; before_s: of the one before; picture: (V) sorted by vessel; moved: of its vessels, where it has been
    computed.
    """
    from coastwatch.kernels.geometry.dead_reckoning import carry_on, decide

    count = len(picture)
    former, write, gone = np.empty(count, np.int64), np.empty(count, np.bool_), np.empty(len(before.whole), np.bool_)
    seen = picture.vessel_id, picture.position_deg, picture.mmsi, picture.flags
    decide(*before, *seen, time_s, bound.error_m - ROUNDING_M, bound.max_s, former, write, gone)
    fresh = _fresh(picture, moved, write, former, number, time_s)
    after = Points(np.empty((count, 5), np.int64), np.empty((count, 11)))
    carry_on(*before, former, write, *fresh, *after)
    first = int(after.whole[:, 1].min(initial=number))
    return after, _rows(before, fresh, former[write], gone, before_s, first)


def points(whole: Ints, real: Floats) -> Points:
    """Points that were read back. Args: whole: (P, 5); real: (P, 9) without the rates."""
    from coastwatch.kernels.geometry.dead_reckoning import set_rates

    made = np.concatenate([real, np.zeros((len(real), 2))], 1)
    set_rates(made)
    return Points(whole, made)


def _fresh(picture: Picture, moved: Motion | None, write: Bools, former: Ints, number: int, time_s: float) -> Points:
    """The points of this cycle, sorted by vessel."""
    here = np.flatnonzero(write)
    of_cycle = np.full(len(here), number)
    columns = picture.vessel_id[here], of_cycle, picture.mmsi[here], picture.flags[here], (former[here] < 0).astype(np.int64)
    made = motion(picture.velocity_m_s[here], picture.covariance[here]).moving if moved is None else moved.moving[here]
    place = np.full((len(here), 1), time_s), picture.position_deg[here], made, picture.updated_s[here, None]
    return points(np.stack(columns, 1), np.concatenate(place, 1))


def _rows(before: Points, fresh: Points, former: Ints, gone: Bools, before_s: float, first: int) -> Added:
    """The rows of fresh points and of the closing ones, together in the order of vessels."""
    left = Points(before.whole[gone], before.real[gone].copy())
    ended = reckoned(left.real[:, 1:3], left.real[:, 3], left.real[:, 4], before_s - left.real[:, 0])
    left.real[:, 1:3] = ended
    whole, real = np.concatenate([fresh.whole, left.whole]), np.concatenate([fresh.real, left.real])
    old_cycle = before.whole[:, 1]
    last_cycle = np.where(former < 0, -1, np.append(old_cycle, -1)[former])
    columns: list[Column] = [
        whole[:, 0],
        *real[:, 1:9].T,
        Named(whole[:, 2]),
        whole[:, 3],
        Named(np.concatenate([last_cycle, old_cycle[gone]])),
        np.repeat([False, True], [len(fresh.whole), len(left.whole)]),
    ]
    order = np.argsort(whole[:, 0], kind="stable")
    return Added([part(column, order) for column in columns], len(order), first, *_identities(before, fresh, former, left))


def _identities(before: Points, fresh: Points, former: Ints, left: Points) -> tuple[Ints, Ints]:
    """MMSI and vessel of what begins and of what ends. Args: former: row of the point before each fresh one, -1: none."""
    vessel, mmsi = fresh.whole[:, 0], fresh.whole[:, 2]
    was = np.append(before.whole[:, 2], -1)[former]
    begins = np.stack([mmsi, vessel], 1)[(mmsi >= 0) & (mmsi != was)]
    ends = np.concatenate([np.stack([was, vessel], 1)[mmsi != was], left.whole[:, [2, 0]]])
    return begins[np.lexsort(begins.T[::-1])], ends[ends[:, 0] >= 0]


def reckoned(position_deg: Floats, sog_kn: Floats, cog_deg: Floats, seconds: Floats) -> Floats:
    """Where vessels are some time after their points. Args: (P, 2), (P,), (P,), (P,); NaN: stands still. Returns: (P, 2)."""
    north, east = scale_m_deg(position_deg[:, 0])
    moves = (sog_kn > 0.0) & ~np.isnan(cog_deg)
    metres = np.where(moves, sog_kn, 0.0) * KNOT_M_S * seconds
    course = np.radians(np.where(moves, cog_deg, 0.0))
    latitude, longitude = (
        position_deg[:, 0] + metres * np.cos(course) / north,
        position_deg[:, 1] + metres * np.sin(course) / east,
    )
    return np.stack([latitude, np.where(np.abs(longitude) <= 180.0, longitude, wrap_deg(longitude))], axis=1)


def newest(vessel_id: Ints, cycle: Ints, closing: Bools) -> Array:
    """Of the points up to a cycle the rows that make its picture: the newest of each vessel but of those that have left.

    Returns: rows in the order of vessels.
    """
    order = np.lexsort((cycle, vessel_id))
    last = np.append(np.diff(vessel_id[order]) != 0, True)[: len(order)]
    rows: Array = order[last]
    there: Array = rows[~closing[rows]]
    return there
