"""A budget of new MMSI for each sender of AIS: one sender that invents vessels does not fill the picture."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.formats.nmea.mmsi_table import MmsiTable
from coastwatch.geodesy import KNOT_M_S, SEMI_MAJOR_M
from coastwatch.kernels.tables.lookup import find

BEYOND = "first report of an MMSI beyond the budget of its sender, set aside until a second one agrees"

NAME_BEYOND = "name of an MMSI without a position beyond the budget of its feed, not used"

BURST, PER_SECOND = 2_000, 20.0
"""New MMSI of one sender that are vessels at their first report: at once, and then a second."""

BURST_OF_FEED, PER_SECOND_OF_FEED = 10_000, 100.0
"""The same of all senders of a feed together: addresses can be invented too."""

FORGOTTEN_S = 3_600.0
"""An MMSI that was not heard for so long is new again: as long as a track without reports lives."""

MOST_WAITING = 1_250_000
"""Rows of MMSI that wait for a second report, 40 bytes each. Where there are more, a tenth goes: those heard longest ago.

So at least 1,125,000 have room: vessels at anchor report each 180 s, and all of them are heard once before the first is again.
"""

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
        self._accepted = MmsiTable(1)  # when each was heard last
        self._waiting = MmsiTable(4)  # when and where each was heard last, latitude and longitude in degrees, and by which feed
        self._no_room = np.zeros(0, np.int64)  # how many of each feed went as there was no room
        self._budgets: OrderedDict[tuple[int, int], _Budget] = OrderedDict()
        self._of_feeds: dict[int, _Budget] = {}
        self._of_names: dict[int, _Budget] = {}  # by feed
        self._looked_s = -np.inf  # when those were forgotten that were not heard for long

    def accepted(self, mmsi: Ints, time_s: Floats, position_deg: Floats, feed: Ints, sender: Ints) -> Bools:
        """Which reports are used. Args: (M,) in order of time, position_deg: (M, 2); sender: number in its feed. Returns: (M,)."""
        if not len(mmsi):
            return np.zeros(0, np.bool_)
        now_s = float(time_s[-1])
        is_known = self._accepted.has(mmsi)
        is_used = is_known.copy()
        if not is_used.all():
            is_used |= self._agree(mmsi, time_s, position_deg, ~is_used)
            new = np.flatnonzero(~is_used)
            _, first = np.unique(mmsi[new], return_index=True)
            granted = self._granted(new[np.sort(first)], feed, sender, now_s)
            is_used |= find(np.sort(mmsi[granted]), mmsi) >= 0
            self._waiting.remove(mmsi[is_used & ~is_known])
            self._wait(mmsi[~is_used], np.column_stack([time_s, position_deg, feed])[~is_used], now_s)
        self._accepted.put(mmsi[is_used], time_s[is_used, None])
        if now_s > self._looked_s + FORGOTTEN_S / 60.0:
            self._accepted.keep_after(np.nextafter(now_s - FORGOTTEN_S, -np.inf))
            self._looked_s = now_s
        return is_used

    def named(self, feed: int, mmsi: Ints, now_s: float) -> Bools:
        """Which names of a feed are used: those of known MMSI, and of others within its budget, which is not that of positions.

        A name may come minutes before the first position. Args: (M,). Returns: (M,).
        """
        is_used = self._accepted.has(mmsi)
        unknown, first = np.unique(mmsi[~is_used], return_index=True)
        if not len(unknown):
            return is_used
        budget = self._of_names.setdefault(feed, _Budget.full(BURST_OF_FEED, PER_SECOND_OF_FEED))
        granted = unknown[np.argsort(first)][: budget.take(len(unknown), now_s)]
        return is_used | (find(np.sort(granted), mmsi) >= 0)

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
        rows = np.flatnonzero(unknown)
        waiting = self._waiting.values(mmsi[rows])
        apart_s = time_s[rows] - waiting[:, 0]
        near = np.flatnonzero((apart_s > 0.0) & (apart_s <= AGREES_WITHIN_S))
        apart_m = _distance_m(position_deg[rows[near]], waiting[near, 1:3])
        agrees = near[apart_m <= AGREES_M + AGREES_M_S * apart_s[near]]
        return unknown & (find(np.unique(mmsi[rows[agrees]]), mmsi) >= 0)

    def _wait(self, mmsi: Ints, report: Floats, now_s: float) -> None:
        """Keep the newest report of each MMSI that is not known, within bounds. Args: report: (M, 4), as waits, in order of time."""
        self._waiting.put(mmsi, report)
        if self._waiting.rows > MOST_WAITING:
            gone = self._waiting.keep_after(now_s - AGREES_WITHIN_S, MOST_WAITING - MOST_WAITING // 10)
            before = self._no_room
            self._no_room = np.bincount(gone[:, 3].astype(np.int64), minlength=len(before))
            self._no_room[: len(before)] += before

    def set_aside(self, now_s: float, feeds: int) -> tuple[Ints, Ints]:
        """How many MMSI of each feed wait for a second report, and how many went since the start as there was no room. (F,), (F,)"""
        waiting = self._waiting.column(3, now_s - AGREES_WITHIN_S).astype(np.int64)
        return np.bincount(waiting, minlength=feeds), np.pad(self._no_room, (0, max(feeds - len(self._no_room), 0)))


def _distance_m(one_deg: Floats, other_deg: Floats) -> Floats:
    """Distances of positions, on a plane at their latitude. Args: (M, 2) latitude and longitude. Returns: (M,)."""
    north = np.radians(other_deg[:, 0] - one_deg[:, 0])
    east = np.radians((other_deg[:, 1] - one_deg[:, 1] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(one_deg[:, 0]))
    return np.asarray(SEMI_MAJOR_M * np.hypot(north, east))
