"""What vessels and tracks were at past instants, by id: an array an instant, so that any pair can be compared on the fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.kernels.tables.lookup import find


@dataclass(frozen=True, eq=False)
class Path:
    """Values of V ids at T common instants, oldest first. Each id has a slot, a row of every array.

    An array is never written again, and nothing is copied but the newest: a slot goes to another id only when no array holds a value of
    the last one any more.
    """

    ids: Ints  # (V,) sorted
    slot: Ints  # (V,)
    last_s: Floats  # (V,) the newest instant with a value
    time_s: Floats  # (T,)
    values: tuple[Floats, ...]  # (S, C) each; NaN where a slot was absent, as slots are that are not there

    @staticmethod
    def empty() -> Path:
        none = np.zeros(0, np.int64)
        return Path(none, none, np.zeros(0), np.zeros(0), ())

    def extended(
        self, ids: Ints, values: Floats, time_s: float, window_s: float, spacing_s: float, room: Callable[..., Array] = np.empty
    ) -> Path:
        """The path after one more instant; instants older than the window, but for one, are forgotten, and ids without any value.

        Of instants closer than `spacing_s` the last one stands, so that a fast clock needs no more room than a slow one.
        Args: ids: (M,) unique; values: (M, C). time_s: not before the last instant. room: who makes arrays, as np.empty.
        """

        keep = int(np.searchsorted(self.time_s, time_s - window_s, side="right")) - 1
        first, last = max(keep, 0), len(self.time_s)
        if last - first >= 2 and self.time_s[-1] - self.time_s[-2] < spacing_s:
            last -= 1
        if last > first and self.time_s[last - 1] >= time_s:
            last -= 1
        kept = self._reaching(first, last)
        there = np.flatnonzero(np.isfinite(values[:, 0]))
        there = there[np.argsort(ids[there], kind="stable")]
        every, slot, last_s, given = kernels.bearings.candidates.merged(
            kept.ids, kept.slot, kept.last_s, ids[there], float(time_s)
        )
        newest = room((int(slot.max(initial=-1)) + 1, values.shape[1]))
        newest[...] = np.nan
        newest[given] = values[there]
        return Path(every, slot, last_s, np.append(self.time_s[first:last], time_s), (*self.values[first:last], newest))

    def _reaching(self, first: int, last: int) -> Path:
        """The path of these instants alone."""
        time_s, values, last_s = self.time_s[first:last], self.values[first:last], self.last_s.copy()
        dropped = np.flatnonzero(last_s > (time_s[-1] if len(time_s) else -np.inf))  # their newest value is not kept
        if len(dropped):
            last_s[dropped] = self._newest(dropped, first, last)
        alive = last_s >= (time_s[0] if len(time_s) else np.inf)
        return Path(self.ids[alive], self.slot[alive], last_s[alive], time_s, values)

    def _newest(self, rows: Ints, first: int, last: int) -> Floats:
        """The newest of these instants at which rows have a value, -inf for none."""
        out, asked = np.full(len(rows), -np.inf), np.arange(len(rows))
        for k in range(last - 1, first - 1, -1):
            has = self._has(rows[asked], k)
            out[asked[has]] = self.time_s[k]
            asked = asked[~has]
        return out

    def _has(self, rows: Ints, instant: int) -> Bools:
        values, slot = self.values[instant], self.slot[rows]
        out = slot < len(values)
        out[out] = np.isfinite(values[slot[out], 0])
        return out

    def slots(self, ids: Ints) -> Ints:
        """The slot of each of these ids, -1 for one that has no value. Args: (M,). Returns: (M,)."""
        row = find(self.ids, ids)
        return np.where(row >= 0, self.slot[row], -1) if len(self.slot) else np.full(len(ids), -1, np.int64)

    def newest(self, instants: int) -> Path:
        """The path of the newest so many instants alone."""
        last = len(self.time_s)
        return self._reaching(max(last - instants, 0), last)


def values_of(values: Sequence[Floats], slots: Ints) -> Floats:
    """What slots, -1 for none, had at the instants of a path, NaN for nothing. Args: values: of a Path; slots: (M,). Returns: (M, T, C)."""
    out = np.full((len(slots), len(values), values[0].shape[1]), np.nan)
    for k, at in enumerate(values):
        there = np.flatnonzero((slots >= 0) & (slots < len(at)))
        out[there, k] = at[slots[there]]
    return out
