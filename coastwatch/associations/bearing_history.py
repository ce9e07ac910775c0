"""What vessels and tracks were at past instants, by id: rows are ids, so that any pair can be compared on the fly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats, Ints


@dataclass(frozen=True, eq=False)
class Path:
    """Values of V rows at T common instants, oldest first; NaN where a row was absent. Rows are sorted by id."""

    ids: Ints  # (V,)
    time_s: Floats  # (T,)
    values: Floats  # (V, T, C)

    @staticmethod
    def empty(columns: int) -> Path:
        return Path(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 0, columns)))

    def extended(self, ids: Ints, values: Floats, time_s: float, window_s: float, spacing_s: float) -> Path:
        """The path after one more instant; instants older than the window, but for one, are forgotten, and rows without any value.

        Of instants closer than `spacing_s` the last one stands, so that a fast clock needs no more room than a slow one.
        Args: ids: (M,) unique; values: (M, C). time_s: not before the last instant.
        """
        keep = int(np.searchsorted(self.time_s, time_s - window_s, side="right")) - 1
        first, last = max(keep, 0), len(self.time_s)
        if last - first >= 2 and self.time_s[-1] - self.time_s[-2] < spacing_s:
            last -= 1
        if last > first and self.time_s[last - 1] >= time_s:
            last -= 1
        alive = self.ids[np.isfinite(self.values[:, first:last, 0]).any(axis=1)]
        every = np.union1d(alive, ids).astype(np.int64)
        out = np.full((len(every), last - first + 1, values.shape[1]), np.nan)
        if len(alive):
            out[np.searchsorted(every, alive), :-1] = self.values[np.searchsorted(self.ids, alive), first:last]
        out[np.searchsorted(every, ids), -1] = values
        return Path(every, np.append(self.time_s[first:last], time_s), out)

    def rows(self, ids: Ints) -> Ints:
        """Where each of these ids stands; they must be there. Args: (M,). Returns: (M,)."""
        return np.searchsorted(self.ids, ids).astype(np.int64)

    def instants(self, time_s: Floats) -> tuple[Ints, Floats]:
        """The instant before each time, with one after it, and the share of that one; -1 where the time is outside.

        Args: any shape, NaN allowed. Returns: two arrays of that shape.
        """
        if len(self.time_s) < 2:
            return np.full(time_s.shape, -1, np.int64), np.zeros(time_s.shape)
        hi = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self.time_s) - 1)
        lo = hi - 1
        share = (time_s - self.time_s[lo]) / (self.time_s[hi] - self.time_s[lo])
        good = (share >= 0.0) & (share <= 1.0)
        return np.where(good, lo, -1).astype(np.int64), np.where(good, share, 0.0)
