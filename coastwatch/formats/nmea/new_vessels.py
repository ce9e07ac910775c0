"""A budget of new MMSI for each sender of AIS: one sender that invents vessels does not fill the picture."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S, SEMI_MAJOR_M

BEYOND = "first report of an MMSI beyond the budget of its sender, set aside until a second one agrees"

BURST, PER_SECOND = 2_000, 20.0
"""New MMSI of one sender that are vessels at their first report: at once, and then a second."""

BURST_OF_FEED, PER_SECOND_OF_FEED = 10_000, 100.0
"""The same of all senders of a feed together: addresses can be invented too."""

FORGOTTEN_S = 3_600.0
"""An MMSI that was not heard for so long is new again: as long as a track without reports lives."""

MOST_WAITING = 100_000
"""MMSI that wait for a second report. Those that were heard longest ago go first."""

AGREES_WITHIN_S, AGREES_M_S, AGREES_M = 900.0, 60.0 * KNOT_M_S, 500.0
"""Two reports of one vessel: the time between them at most, and how far apart they may be: speed times time and a constant."""

MOST_SENDERS = 1_024


@dataclass
class _Budget:
    """What one sender has left."""

    burst: float
    per_s: float
    left: float
    at_s: float | None = None

    def take(self, asked: int, now_s: float) -> int:
        """How many of these are granted now."""
        if self.at_s is not None:
            self.left = min(self.left + self.per_s * max(now_s - self.at_s, 0.0), self.burst)
        self.at_s = now_s
        granted = min(asked, int(self.left))
        self.left -= granted
        return granted

    @classmethod
    def full(cls, burst: float, per_s: float) -> _Budget:
        """One of which nothing is taken yet."""
        return cls(burst, per_s, burst)


class NewVessels:
    """Which reports are used: those of a known MMSI, of a new one within the budget of its sender, and second ones that agree."""

    def __init__(self) -> None:
        self._accepted, self._heard_s = np.zeros(0, np.int64), np.zeros(0)  # sorted MMSI, and when each was heard last
        self._waiting, self._waits_s, self._at_deg = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2))  # sorted by MMSI
        self._budgets: OrderedDict[tuple[int, int], _Budget] = OrderedDict()
        self._of_feeds: dict[int, _Budget] = {}
        self._looked_s = -np.inf  # when those were forgotten that were not heard for long

    def accepted(self, mmsi: Ints, time_s: Floats, position_deg: Floats, feed: Ints, sender: Ints) -> Bools:
        """Which reports are used. Args: (M,) in order of time, position_deg: (M, 2); sender: number in its feed. Returns: (M,)."""
        if not len(mmsi):
            return np.zeros(0, np.bool_)
        now_s = float(time_s[-1])
        is_used = _is_in(mmsi, self._accepted)
        if not is_used.all():
            is_used |= self._agree(mmsi, time_s, position_deg, ~is_used)
            new = np.flatnonzero(~is_used)
            _, first = np.unique(mmsi[new], return_index=True)
            granted = self._granted(new[np.sort(first)], feed, sender, now_s)
            is_used |= _is_in(mmsi, np.sort(mmsi[granted]))
            self._wait(mmsi, time_s, position_deg, np.flatnonzero(~is_used))
        self._note(mmsi[is_used], time_s[is_used], now_s)
        return is_used

    def _granted(self, rows: Ints, feed: Ints, sender: Ints, now_s: float) -> Ints:
        """The rows of new MMSI that are within the budgets of their senders. Args: rows: in order of time."""
        granted = [np.zeros(0, np.int64)]
        pairs, group = np.unique(np.stack([feed[rows], sender[rows]], 1), axis=0, return_inverse=True)
        for number, (number_of_feed, who) in enumerate(pairs.tolist()):
            own = rows[group == number]
            budget = self._budgets.setdefault((number_of_feed, who), _Budget.full(BURST, PER_SECOND))
            self._budgets.move_to_end((number_of_feed, who))
            whole = self._of_feeds.setdefault(number_of_feed, _Budget.full(BURST_OF_FEED, PER_SECOND_OF_FEED))
            granted.append(own[: whole.take(budget.take(len(own), now_s), now_s)])
        while len(self._budgets) > MOST_SENDERS:
            self._budgets.popitem(last=False)
        return np.concatenate(granted)

    def _agree(self, mmsi: Ints, time_s: Floats, position_deg: Floats, unknown: Bools) -> Bools:
        """Which reports agree with one of the same MMSI that waits, and all of that MMSI after them. Returns: (M,)."""
        is_agreed = np.zeros(len(mmsi), np.bool_)
        rows = np.flatnonzero(unknown & _is_in(mmsi, self._waiting))
        if len(rows):
            at = np.searchsorted(self._waiting, mmsi[rows])
            apart_s = time_s[rows] - self._waits_s[at]
            apart_m = _distance_m(position_deg[rows], self._at_deg[at])
            agrees = (apart_s > 0.0) & (apart_s <= AGREES_WITHIN_S) & (apart_m <= AGREES_M + AGREES_M_S * apart_s)
            is_agreed = unknown & _is_in(mmsi, np.unique(mmsi[rows[agrees]]))
        return is_agreed

    def _wait(self, mmsi: Ints, time_s: Floats, position_deg: Floats, rows: Ints) -> None:
        """Keep the newest report of each MMSI that is not known."""
        if not len(rows) and not len(self._waiting):
            return
        every = np.concatenate([self._waiting, mmsi[rows]])
        when = np.concatenate([self._waits_s, time_s[rows]])
        where = np.concatenate([self._at_deg, position_deg[rows]])
        order = np.lexsort((when, every))
        last = order[np.append(every[order][1:] != every[order][:-1], True)]
        last = last[when[last] > when.max() - AGREES_WITHIN_S]
        if len(last) > MOST_WAITING:
            last = np.sort(last[np.argsort(when[last], kind="stable")[-MOST_WAITING:]])
            last = last[np.argsort(every[last], kind="stable")]
        self._waiting, self._waits_s, self._at_deg = every[last], when[last], where[last]

    def _note(self, mmsi: Ints, time_s: Floats, now_s: float) -> None:
        """Remember when each MMSI was heard, and forget those that were not for long."""
        old = _is_in(mmsi, self._accepted)
        self._heard_s[np.searchsorted(self._accepted, mmsi[old])] = time_s[old]  # in order of time: the last one stays
        if not old.all():
            new, last = np.unique(mmsi[~old][::-1], return_index=True)
            at = np.searchsorted(self._accepted, new)
            self._accepted = np.insert(self._accepted, at, new)
            self._heard_s = np.insert(self._heard_s, at, time_s[~old][::-1][last])
        if now_s > self._looked_s + FORGOTTEN_S / 60.0:
            keep = self._heard_s >= now_s - FORGOTTEN_S
            self._accepted, self._heard_s, self._looked_s = self._accepted[keep], self._heard_s[keep], now_s
        if len(self._waiting):
            keep = ~_is_in(self._waiting, self._accepted)
            self._waiting, self._waits_s, self._at_deg = self._waiting[keep], self._waits_s[keep], self._at_deg[keep]


def _is_in(values: Ints, ordered: Ints) -> Bools:
    """Whether each value is among sorted ones. (M,)"""
    if not len(ordered):
        return np.zeros(len(values), np.bool_)
    at = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return np.asarray(ordered[at] == values)


def _distance_m(one_deg: Floats, other_deg: Floats) -> Floats:
    """Distances of positions, on a plane at their latitude. Args: (M, 2) latitude and longitude. Returns: (M,)."""
    north = np.radians(other_deg[:, 0] - one_deg[:, 0])
    east = np.radians((other_deg[:, 1] - one_deg[:, 1] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(one_deg[:, 0]))
    return np.asarray(SEMI_MAJOR_M * np.hypot(north, east))
