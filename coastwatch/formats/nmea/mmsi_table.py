"""A table of numbers by MMSI that takes new rows at a cost which hardly grows with its length. No numba."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.kernels.tables.lookup import find

LEAST_TAIL, TAIL_SHARE = 4_096, 16
"""New rows are merged when there are more than this, and more than one for so many rows of the table."""

NONE_S = -np.inf
"""The time of a row that was removed, or that there is not."""


class MmsiTable:
    """Rows of MMSI and values, of which the first is a time: a long part and a short one of new rows, both sorted by MMSI.

    A row is changed or removed where it is. The short part is merged into the long one when it has grown by a share.
    """

    def __init__(self, columns: int) -> None:
        """Args: columns: values of a row; it takes 8 bytes for its MMSI, and 8 for each value."""
        empty = np.zeros(0, np.int64), np.zeros((0, columns))
        self._long: tuple[Ints, Floats] = empty
        self._short: tuple[Ints, Floats] = empty

    @property
    def rows(self) -> int:
        """Rows in memory, also removed ones."""
        return len(self._long[0]) + len(self._short[0])

    @property
    def mmsi(self) -> Ints:
        """Those in the table, sorted. (N,)"""
        return np.sort(np.concatenate([keys[values[:, 0] > NONE_S] for keys, values in (self._long, self._short)]))

    def column(self, number: int, after_s: float) -> Floats:
        """A value of each row whose time is later, in any order. (N,)"""
        return np.concatenate([values[values[:, 0] > after_s, number] for _, values in (self._long, self._short)])

    def has(self, mmsi: Ints) -> Bools:
        """Which are in the table. Args: (M,). Returns: (M,)."""
        return np.asarray(self.values(mmsi)[:, 0] > NONE_S)

    def values(self, mmsi: Ints) -> Floats:
        """The values of each; the time of one that is not there is NONE_S. Args: (M,). Returns: (M, C)."""
        out = np.zeros((len(mmsi), self._long[1].shape[1]))
        out[:, 0] = NONE_S
        for keys, values in (self._long, self._short):
            at = find(keys, mmsi)
            out[at >= 0] = values[at[at >= 0]]
        return out

    def put(self, mmsi: Ints, values: Floats) -> None:
        """Set the values of each; of equal ones the last counts. Args: (M,), (M, C)."""
        mmsi, last = np.unique(mmsi[::-1], return_index=True)
        values = values[::-1][last]
        for keys, own in (self._long, self._short):
            at = find(keys, mmsi)
            own[at[at >= 0]] = values[at >= 0]
            mmsi, values = mmsi[at < 0], values[at < 0]
        self._short = _inserted(self._short, mmsi, values)
        if len(self._short[0]) > max(LEAST_TAIL, len(self._long[0]) // TAIL_SHARE):
            self.keep_after(NONE_S)

    def remove(self, mmsi: Ints) -> None:
        """Take these out, where they are in the table. Args: (M,)."""
        for keys, values in (self._long, self._short):
            at = find(keys, mmsi)
            values[at[at >= 0], 0] = NONE_S

    def keep_after(self, after_s: float, most: int | None = None) -> Floats:
        """Keep the rows whose time is later, in one part.

        Args: most: of them the newest; none: all. Returns: the values of those of them that went, (K, C).
        """
        kept = [_taken(part, np.flatnonzero(part[1][:, 0] > after_s)) for part in (self._long, self._short)]
        whole = _inserted(kept[0], *kept[1])
        surplus = 0 if most is None else max(len(whole[0]) - most, 0)
        gone = whole[1][:0].copy()
        if surplus:
            order = np.argsort(whole[1][:, 0], kind="stable")
            gone, whole = whole[1][order[:surplus]], _taken(whole, np.sort(order[surplus:]))
        self._long, self._short = whole, (whole[0][:0].copy(), whole[1][:0].copy())
        return gone


def _taken(part: tuple[Ints, Floats], rows: Ints) -> tuple[Ints, Floats]:
    return part[0][rows], part[1][rows]


def _inserted(part: tuple[Ints, Floats], mmsi: Ints, values: Floats) -> tuple[Ints, Floats]:
    """A part with more rows. Args: mmsi: (M,) sorted, none of the part."""
    if not len(mmsi):
        return part
    at = np.searchsorted(part[0], mmsi)
    return np.insert(part[0], at, mmsi), np.insert(part[1], at, values, axis=0)
