"""What is kept of the cycles that a live run skips: all that no later cycle says again, within bounds. Their pictures are not stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from coastwatch.batches import AisStatics, EventChanges
from coastwatch.store import ForCentres, Intake, SkippedCycle

MOST_EVENTS, MOST_MESSAGES = 200_000, 200
"""Events, and messages for other centres, that wait. The oldest go first."""

MOST_NAMED, MOST_COUNTED = 200_000, 20_000
"""Messages with names that wait, and cycles with counts of their own. The oldest go first, or are counted together."""


@dataclass(frozen=True)
class Counted(SkippedCycle):
    """Skipped cycles up to a number that are counted together. Nothing but their rows is left of them."""

    first: int = 0  # number and instant of the first one
    first_s: float = 0.0

    @classmethod
    def together(cls, older: SkippedCycle, newer: SkippedCycle) -> Self:
        """Two cycles, or rows of cycles, that follow each other."""
        first, first_s = (older.first, older.first_s) if isinstance(older, Counted) else (older.number, older.time_s)
        used: dict[tuple[str, str], Intake] = {}
        for one in (*older.for_centres.intake, *newer.for_centres.intake):
            before = used.pop((one.region, one.region_run), one._replace(late=0))
            used[one.region, one.region_run] = one._replace(first_seq=before.first_seq, late=before.late + one.late)
        return cls(
            newer.number,
            newer.time_s,
            newer.why if newer.why == older.why else "not_stored",
            {name: older.counts.get(name, 0) + count for name, count in newer.counts.items()},
            heard=older.heard | newer.heard,
            for_centres=ForCentres(None, tuple(used.values())),
            first=first,
            first_s=first_s,
        )

    def rows(self) -> Sequence[SkippedCycle]:
        """Its cycles. The last one has the counts."""
        times_s = np.linspace(self.first_s, self.time_s, self.number - self.first + 1)[:-1].tolist()
        none = dict.fromkeys(self.counts, 0)
        before = [SkippedCycle(self.first + k, time_s, self.why, none) for k, time_s in enumerate(times_s)]
        last = {field.name: getattr(self, field.name) for field in fields(SkippedCycle)}
        return *before, SkippedCycle(**last)


def bounded(skipped: list[SkippedCycle]) -> tuple[list[SkippedCycle], int]:
    """Skipped cycles without what has no room: the oldest events, messages for other centres, names and counts.

    Names are those of the newest cycle, one a vessel. Returns: they, and how many events and names were forgotten.
    """
    events = forgotten = 0
    cycles: list[SkippedCycle] = []
    for age, one in enumerate(reversed(skipped)):
        kept = replace(one, statics=AisStatics.empty())
        events += len(one.events)
        if events > MOST_EVENTS and len(one.events):
            forgotten += len(one.events)
            kept = replace(kept, events=EventChanges.empty())
        if age >= MOST_MESSAGES and one.for_centres.message is not None:
            kept = replace(kept, for_centres=ForCentres(None, one.for_centres.intake))
        if age >= MOST_COUNTED and cycles and _is_bare(kept) and _is_bare(cycles[-1]):
            cycles[-1] = Counted.together(kept, cycles[-1])
        else:
            cycles.append(kept)
    if cycles:
        names = newest_names([one.statics for one in skipped])
        forgotten += max(len(names) - MOST_NAMED, 0)
        cycles[0] = replace(cycles[0], statics=names.take(np.arange(len(names))[-MOST_NAMED:]))
    return cycles[::-1], forgotten


def newest_names(parts: list[AisStatics]) -> AisStatics:
    """The newest message of each vessel and of each pattern of fields that it gives.

    A message that leaves fields out erases nothing: messages with other fields stay beside it.
    """
    every = AisStatics.join(parts)
    numbers, texts = (every.ship_type >= 0, ~np.isnan(every.length_m), ~np.isnan(every.beam_m)), (every.name, every.call_sign)
    is_stated = np.array([*numbers, *(text != "" for text in texts)])
    pattern = (is_stated.T * (1 << np.arange(len(is_stated)))).sum(axis=1)
    backwards = np.lexsort((-np.arange(len(every)), pattern, every.mmsi))
    first = np.append(True, (np.diff(every.mmsi[backwards]) != 0) | (np.diff(pattern[backwards]) != 0))[: len(every)]
    return every.take(np.sort(backwards[first]))


def rows(skipped: Sequence[SkippedCycle]) -> tuple[SkippedCycle, ...]:
    """Skipped cycles as they are written."""
    return tuple(row for one in skipped for row in (one.rows() if isinstance(one, Counted) else (one,)))


def _is_bare(one: SkippedCycle) -> bool:
    """Whether a skipped cycle has nothing that is of it alone."""
    return not len(one.events) and one.for_centres.message is None
