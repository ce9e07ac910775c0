"""Pairs of vessels that will pass too close, soon: of all pairs, found by where each vessel is in the middle of a span of time.

Let two vessels come within D of each other during a span. In its middle they are then no farther apart than D plus half the span
times the sum of their speeds. So pairs within that distance are candidates, whose closest approach is then computed. Few fast
vessels are in a class of their own, so that they do not widen the search for all others. The time to look ahead is cut in spans,
and each cycle searches one of them. Pairs that were found are followed in every cycle.

Where vessels crowd the cost is bounded by counts. A vessel with more than `MOST_NEAR` within that distance is compared with the nearest
alone, and of the pairs of each vessel the most urgent are followed. Elsewhere no pair is left out.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001 (straight motion).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.alarms.lasting import AlarmSettings
from coastwatch.batches import Bools, Flag, Floats, Ints, NavStatus, Picture
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, scale_m_deg
from coastwatch.kernels.tables.lookup import find

SPANS = 2
CLASSES_M_S = (12.0, 60.0)
"""Greatest speed of each class. What is faster is no vessel."""

MOST_NEAR = 384
"""Vessels within the reach of one that it is compared with, itself one of them. Of more it is compared with the nearest alone."""

MOST_FOLLOWED = 16
"""Pairs of a vessel that are followed: within the limits first, then by the time left. One is left out if both vessels have others."""

MOST_OPEN = 32
"""Pairs of a vessel whose alarm is open, that are followed beside these. Of more those with the least time left."""

SLACK_M = 100.0
"""How far the middle of a way may be from where it is taken to be, with the scale of its start."""


@dataclass(frozen=True, eq=False)
class Approaching:
    """Pairs that are followed. P rows, sorted."""

    first_id: Ints  # (P,) vessels, the lower id of each pair
    second_id: Ints
    turn: int  # cycles so far: which span is searched next
    left_out: int  # pairs that were not looked at, or are not followed, in this cycle, at most

    @classmethod
    def none(cls) -> Approaching:
        number = np.zeros(0, np.int64)
        return cls(number, number, 0, 0)


class Pairs(NamedTuple):
    """Pairs of rows of a picture, the first below the second. P pairs, sorted."""

    first: Ints
    second: Ints
    cpa_m: Floats
    tcpa_s: Floats  # negative: they have passed
    range_m: Floats

    def take(self, some: Bools | Ints) -> Pairs:
        """These pairs."""
        return Pairs(self.first[some], self.second[some], self.cpa_m[some], self.tcpa_s[some], self.range_m[some])


def close_pairs(
    settings: AlarmSettings, before: Approaching, picture: Picture, time_s: float, opened: tuple[Ints, Ints] | None = None
) -> tuple[Approaching, Pairs]:
    """The pairs whose closest approach lies within the limits, each widened by `cpa_hold_factor`.

    A pair is found within the limits themselves, at the latest after `SPANS` cycles. One of the two whose newest report is older than
    `cpa_oldest_s` may be elsewhere, so it has no pair. Of a crowd only the nearest are compared, and the most urgent followed.
    Args: picture: vessels with a track, sorted; opened: ids of the vessels of pairs with an open alarm, the lower first; none: no pair.
    """
    speed_m_s = np.hypot(picture.velocity_m_s[:, 0], picture.velocity_m_s[:, 1])
    slow = speed_m_s < settings.cpa_under_way_kn * KNOT_M_S
    counts = _counts(settings, picture, slow, time_s) & (speed_m_s <= CLASSES_M_S[-1])
    limit_m, within_s = settings.cpa_nm * NAUTICAL_MILE_M, settings.tcpa_min * 60.0
    half_s = 0.5 * within_s / SPANS
    middle_s = (2 * (before.turn % SPANS) + 1) * half_s
    *new, left_out = _candidates(picture, np.flatnonzero(counts), speed_m_s, limit_m, middle_s, half_s)
    old = find(picture.vessel_id, before.first_id), find(picture.vessel_id, before.second_id)
    there = (old[0] >= 0) & (old[1] >= 0)
    ends = [np.concatenate([row[there], rows]) for row, rows in zip(old, new, strict=True)]
    first, second = np.minimum(*ends), np.maximum(*ends)
    counted = counts[first] & counts[second] & ~(slow[first] & slow[second])
    pairs = _within_limits(settings, picture, first[counted], second[counted])
    weak = (pairs.cpa_m > limit_m) | (pairs.tcpa_s > within_s)
    urgent = _most_urgent(pairs, weak, MOST_FOLLOWED, len(picture))
    if opened is not None and not urgent.all():
        one, other = (find(picture.vessel_id, ids) for ids in opened)
        here, count = (one >= 0) & (other >= 0), len(picture)
        is_open = np.flatnonzero(np.isin(pairs.first * count + pairs.second, one[here] * count + other[here]))
        of_open = pairs.take(is_open)
        urgent[is_open] |= _most_urgent(of_open, np.zeros(len(is_open), np.bool_), MOST_OPEN, len(picture))
    pairs, left_out = pairs.take(urgent), left_out + int((~urgent).sum())
    return Approaching(picture.vessel_id[pairs.first], picture.vessel_id[pairs.second], before.turn + 1, left_out), pairs


def _most_urgent(pairs: Pairs, weak: Bools, most: int, vessels: int) -> Bools:
    """Which pairs are among so many of one of their vessels: those that are not weak first, then by the time left. (P,)

    Args: weak: (P,); vessels: V, rows of the picture.
    """
    count, is_urgent = len(pairs.first), np.ones(len(pairs.first), np.bool_)
    of_vessel = np.bincount(pairs.first, minlength=vessels) + np.bincount(pairs.second, minlength=vessels)
    if of_vessel.max(initial=0) <= most:
        return is_urgent
    soonest = np.lexsort((pairs.tcpa_s, weak))
    ends = np.column_stack([pairs.first, pairs.second])[soonest].ravel()
    start, end = kernels.tables.counting_sort.counting_sort(ends, vessels)
    urgent = np.arange(2 * count) - np.repeat(start[:-1], np.diff(start)) < most
    is_urgent[:] = False
    is_urgent[soonest[end[urgent] // 2]] = True
    return is_urgent


def _counts(settings: AlarmSettings, picture: Picture, slow: Bools, time_s: float) -> Bools:
    """Which vessels may be one of a pair. (V,) Args: slow: (V,)."""
    is_certain = (time_s - picture.since_s >= settings.cpa_known_s) & (time_s - picture.updated_s <= settings.cpa_oldest_s)
    if not settings.cpa_at_rest:
        return np.asarray(is_certain & ~slow)
    at_rest = np.isin(picture.nav_status, (NavStatus.AT_ANCHOR, NavStatus.MOORED, NavStatus.AGROUND))
    at_rest |= (picture.flags & Flag.STATIONARY) != 0
    return np.asarray(is_certain & (~slow | (at_rest & (picture.mmsi >= 0))))


def _candidates(
    picture: Picture, rows: Ints, speed_m_s: Floats, limit_m: float, middle_s: float, half_s: float
) -> tuple[Ints, Ints, int]:
    """Pairs of these rows that may come within the limit in a span, and how many more were not looked at, at most.

    Args: speed_m_s: (V,); middle_s: of the span; half_s: its half.
    """
    north, east = scale_m_deg(picture.position_deg[rows, 0])
    ahead_deg = np.stack([picture.velocity_m_s[rows, 1] / north, picture.velocity_m_s[rows, 0] / east], 1) * middle_s
    middle_deg = picture.position_deg[rows] + ahead_deg
    of_speed = np.searchsorted(CLASSES_M_S, speed_m_s[rows])
    classes = [np.flatnonzero(of_speed == k) for k in range(len(CLASSES_M_S))]
    near, first, second, left_out = kernels.association, [rows[:0]], [rows[:0]], 0
    for b, faster in enumerate(classes):
        for a, slower in enumerate(classes[: b + 1]):
            if not len(faster) or not len(slower):
                continue
            reach_m = limit_m + SLACK_M + (CLASSES_M_S[a] + CLASSES_M_S[b]) * half_s
            members = slower if a == b else np.concatenate([slower, faster])
            group = np.arange(len(members)) if a == b else np.repeat([0, 1], [len(slower), len(faster)])
            place = near.places.sorted_places(middle_deg[members], group, np.zeros(len(members), np.int64), reach_m)
            member = members[place["row"]]
            crowds = near.crowds.find_crowds(place, member, reach_m, MOST_NEAR)
            no_halo = np.zeros(len(members) + 1, np.int64), rows[:0]
            pairs = near.candidate_pairs.candidate_pairs(
                0, len(members), np.arange(len(members)), place, no_halo, crowds, reach_m
            )
            first.append(rows[member][pairs["first"]])
            second.append(rows[member][pairs["second"]])
            left_out += crowds.left_out
    return np.concatenate(first), np.concatenate(second), left_out


def _within_limits(settings: AlarmSettings, picture: Picture, first: Ints, second: Ints) -> Pairs:
    """The pairs whose closest approach on straight courses lies within the limits, each widened by `cpa_hold_factor`; each once.

    Most pairs fail at their relative velocity or their time already, so the distances of few are computed.
    Args: first, second: (P,), may repeat.
    """
    relative = picture.velocity_m_s[second] - picture.velocity_m_s[first]
    speed2 = relative[:, 0] ** 2 + relative[:, 1] ** 2
    some = np.flatnonzero(np.sqrt(speed2) >= settings.cpa_relative_kn * KNOT_M_S)
    first, second, relative = first[some], second[some], relative[some]
    away = difference_m(picture.position_deg[second], picture.position_deg[first])
    tcpa_s = -(away[:, 0] * relative[:, 0] + away[:, 1] * relative[:, 1]) / np.maximum(speed2[some], 1e-12)
    soon = np.flatnonzero((tcpa_s >= 0.0) & (tcpa_s <= settings.cpa_hold_factor * settings.tcpa_min * 60.0))
    first, second, relative, away, tcpa_s = first[soon], second[soon], relative[soon], away[soon], tcpa_s[soon]
    cpa_m = np.hypot(away[:, 0] + relative[:, 0] * tcpa_s, away[:, 1] + relative[:, 1] * tcpa_s)
    near = np.flatnonzero(cpa_m <= settings.cpa_hold_factor * settings.cpa_nm * NAUTICAL_MILE_M)
    _, once = np.unique(first[near] * len(picture) + second[near], return_index=True)
    near = near[once]
    return Pairs(first[near], second[near], cpa_m[near], tcpa_s[near], np.hypot(away[near, 0], away[near, 1]))
