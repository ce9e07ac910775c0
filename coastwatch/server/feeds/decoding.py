"""What every decoder of a live feed offers, and rows that wait for their cycle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from coastwatch.batches import Bools, Floats, Reports
from coastwatch.sensors.recorded.faults import Tally
from coastwatch.server.feeds.transport import Item

FAR_AHEAD_S = 60.0
AHEAD = "time ahead of the clock of this machine, that of arrival taken"


@dataclass
class Counts:
    """What became of the reports of a feed."""

    records: int = 0  # used
    late: int = 0  # left out: they came after their cycle
    before_run: int = 0  # left out: of an instant before the first cycle of this run
    _began_s: float | None = None

    def outdated(self, time_s: Floats, after_s: float) -> Bools:
        """Which reports are of no cycle any more; they are counted. Args: time_s: (M,); after_s: where the cycle begins. (M,)"""
        if self._began_s is None:
            self._began_s = after_s
        found, before = np.asarray(time_s <= after_s), int((time_s <= self._began_s).sum())
        self.before_run += before
        self.late += int(found.sum()) - before
        return found


class Decoder(Protocol):
    """Lines or datagrams of one feed to reports."""

    tally: Tally
    counts: Counts
    newest_s: float  # time of the newest report so far, -inf before the first
    first_s: float  # of the oldest, inf before the first

    def take(self, items: list[Item], reference_s: float | None) -> None:
        """Decode what has come. Args: reference_s: about now, for times of day; None: as each item came."""
        ...


Cut = Callable[[float, float], Reports]
"""(after_s, until_s) -> the reports with after_s < time <= until_s, in an order that does not depend on their arrival. Older ones are
counted and dropped: late, or of before the run."""


class Waiting:
    """Batches of reports that wait for their cycle, by their `received_s`."""

    def __init__(self, counts: Counts, kind: Any, order: tuple[str, ...]) -> None:
        """Args: counts: of the feed; kind: of batch; order: columns by which rows of one time are sorted."""
        self._counts, self._kind, self._order = counts, kind, order
        self._parts: list[Any] = []

    def add(self, batch: Any) -> None:
        """Keep reports until they are asked for."""
        if len(batch):
            self._parts.append(batch)

    def cut(self, after_s: float, until_s: float) -> Any:
        """The reports of a span, each once, sorted by time and content. Older ones are counted."""
        every = self._kind.join(self._parts)
        keep = every.received_s > until_s
        self._parts = [every.take(keep)] if keep.any() else []
        found = every.take(~keep & ~self._counts.outdated(every.received_s, after_s))
        keys = [getattr(found, name) for name in self._order]
        keys = [column for key in keys for column in (key.T if key.ndim > 1 else [key])]
        order = np.lexsort((*keys[::-1], found.received_s))
        twice = np.zeros(len(order), np.bool_)
        same = np.diff(found.received_s[order]) == 0.0
        for key in keys:
            same &= key[order[1:]] == key[order[:-1]]
        twice[1:] = same
        self._counts.records += int((~twice).sum())
        return found.take(order[~twice])


def plausible_s(stamp_s: Floats, arrived_s: Floats, checked: bool, tally: Tally, name: str) -> Floats:
    """The times of records: their stamps; that of arrival where there is none, or if checked where a stamp is far ahead."""
    ahead = (stamp_s > arrived_s + FAR_AHEAD_S) if checked else np.zeros(len(stamp_s), np.bool_)
    tally.add_rows(AHEAD, ahead, lambda i: name, lambda i: f"{stamp_s[i] - arrived_s[i]:.0f} s")
    return np.where(np.isnan(stamp_s) | ahead, arrived_s, stamp_s)
