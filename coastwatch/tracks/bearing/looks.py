"""Which bearings of a cycle are used, in which order tracks take them, and which may be of which track.

A look is the bearings of one sensor at one time, or of one turn of a sensor that gives each bearing its own time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, BearingReports, Bools, Floats, Ints
from coastwatch.batches.limits import CONTACTS
from coastwatch.geodesy import wrap_rad

MOST_OWN, MOST_NUMBERED = 2000, 300
"""Bearings without a contact number of one sensor, and bearings of one numbered contact, that are used in `SHARE_S` of a cycle."""

MOST_LOOKS = 100
"""Looks of one sensor that are used in `SHARE_S` of a cycle. Of more an even choice of whole looks is used."""

SHARE_S, MOST_SHARES = 3.0, 10.0
"""Time that the counts are for. A cycle whose bearings span longer takes more in proportion, at most so many times as many."""

WIDER = 1e-6  # than a gate, for rounding
MOST_GATED = 64  # bearings of a look that one track is compared with: the nearest


def looks_of(reports: BearingReports, half_rad: Floats, longest_s: Floats) -> Ints:
    """The number of the look of each report without a contact number, -1 of others. (M,) Args: as of `kernels.bearings.looks`."""
    rows = np.flatnonzero(reports.contact < 0)
    rows = rows[np.lexsort((reports.time_s[rows], reports.sensor[rows]))]
    out = np.full(len(reports), -1, np.int64)
    bearing = wrap_rad(np.radians(reports.bearing_deg[rows]))
    if len(rows):
        out[rows] = kernels.bearings.looks.looks_of(reports.sensor[rows], reports.time_s[rows], bearing, half_rad, longest_s)
    return out


def few(reports: BearingReports, look: Ints) -> Bools:
    """Which reports to use, evenly chosen. (M,) Args: reports: sorted by time; look: (M,) of `looks_of`.

    Of a numbered contact at most `MOST_NUMBERED`. Of other bearings of a sensor at most `MOST_LOOKS` whole looks with about `MOST_OWN`
    bearings in all. The counts are for `SHARE_S`.
    """
    whose = np.where(reports.contact >= 0, reports.sensor * CONTACTS + reports.contact, -1 - reports.sensor)
    sender, of = np.unique(whose, return_inverse=True)
    own, count = sender < 0, np.bincount(of, minlength=len(sender))
    if not (count > np.where(own, min(MOST_OWN, MOST_LOOKS), MOST_NUMBERED)).any():
        return np.ones(len(reports), np.bool_)
    begin_s, end_s = np.full(len(sender), np.inf), np.full(len(sender), -np.inf)
    np.minimum.at(begin_s, of, reports.time_s)
    np.maximum.at(end_s, of, reports.time_s)
    shares = np.clip((end_s - begin_s) / SHARE_S, 1.0, MOST_SHARES)
    most = (np.where(own, MOST_OWN, MOST_NUMBERED) * shares).astype(np.int64)
    rows = np.flatnonzero(own[of])
    key, at = _distinct(of[rows], look[rows])
    looks = np.bincount(key, minlength=len(sender))
    most_looks = np.minimum((MOST_LOOKS * shares).astype(np.int64), np.maximum(most * looks // count, 1))
    out = np.ones(len(reports), np.bool_)
    out[rows] = _evenly(key, most_looks[key])[at]
    out[out] = _evenly(of[out], most[of[out]])  # where one look has too many, or looks differ
    return out


def _distinct(key: Ints, item: Array) -> tuple[Ints, Ints]:
    """The key of each distinct pair of key and item, by key, then item, and which of these each row is. (L,), (M,)"""
    order = np.lexsort((item, key))
    key, item = key[order], item[order]
    new = np.append(True, (key[1:] != key[:-1]) | (item[1:] != item[:-1]))[: len(key)]
    at = np.empty(len(key), np.int64)
    at[order] = np.cumsum(new) - 1
    return key[new], at


def _evenly(key: Ints, most: Ints) -> Bools:
    """Which rows to use: of each key at most so many, evenly chosen in their order. Args: (M,), (M,) the same for all rows of a key."""
    if np.unique(key, return_counts=True)[1].max(initial=0) <= most.min(initial=len(key)):
        return np.ones(len(key), np.bool_)
    order = np.argsort(key, kind="stable")
    first = np.searchsorted(key[order], key[order])
    count = np.searchsorted(key[order], key[order], side="right") - first
    rank, limit = np.arange(len(key)) - first, np.minimum(most[order], count)
    out = np.empty(len(key), np.bool_)
    out[order] = (rank + 1) * limit // count > rank * limit // count
    return out


def near_in_bearing(bearing_rad: Floats, half_rad: Floats, sensor: Ints, reports: BearingReports) -> tuple[Ints, Ints]:
    """Pairs of a track and a bearing of its sensor that is no farther off; of more than `MOST_GATED` the nearest. Sorted.

    Args: bearing_rad, half_rad, sensor: (T,) of each track; reports: (M,). Returns: (A,), (A,).
    """
    count, turn = len(reports), 2.0 * np.pi
    said = np.tile(wrap_rad(np.radians(reports.bearing_deg)), 3) + np.repeat([-turn, 0.0, turn], count)
    base = 4.0 * turn  # between one sensor and the next: bearings are within three turns
    key = np.tile(reports.sensor, 3) * base + said
    order = np.argsort(key, kind="stable")
    key, middle = key[order], sensor * base + wrap_rad(bearing_rad)
    half = np.minimum(half_rad * (1.0 + WIDER) + WIDER, np.pi)
    low, high = np.searchsorted(key, middle - half), np.searchsorted(key, middle + half)
    many = np.flatnonzero(high - low > MOST_GATED)
    nearest = kernels.bearings.candidates.first_of_nearest(middle[many], key, low[many], (high - low)[many], MOST_GATED)
    low[many], high[many] = nearest, nearest + MOST_GATED
    track = np.repeat(np.arange(len(low)), high - low)
    report = order[kernels.tables.groups.ranges(low, high - low)] % max(count, 1)
    track, report = np.divmod(np.unique(track * count + report), max(count, 1))
    return track, report


def rounds(key: Ints, item: Array) -> Iterator[Ints]:
    """Rows of the first item of every key, then of the second, and so on. An item is the rows of a key that are alike in it."""
    distinct, of = _distinct(key, item)
    rank = (np.arange(len(distinct)) - np.searchsorted(distinct, distinct))[of]
    order = np.argsort(rank, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(rank[order])) + 1) if len(order) else ()
