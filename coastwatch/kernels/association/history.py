"""`History`: values of many ids at the newest W cycles, in one array. Each cycle writes one column (a ring buffer)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike

from coastwatch.kernels.arrays import Array, Ints, Rows
from coastwatch.kernels.tables.match_ids import index_of, match_ids
from coastwatch.kernels.tables.row_numbers import require_rows

MARGIN = 8  # one spare slot for so many used ones, so that few cycles have to enlarge the array


@dataclass(frozen=True, eq=False)
class History:
    """Values of ids at the newest W cycles. An id keeps its slot, a row of `values`, for as long as it is there.

    The value of a slot `age` cycles ago stands in column `(cycle - age) % W`. It counts only for `age < length[slot]`.
    The caller chooses the type of a value: a record with named fields, or C numbers.

    `advanced` writes into the arrays of the history that it is called on. Use only the history that it returns.
    """

    values: Array  # (S, W) records or (S, W, C) numbers
    ids: Ints  # (L,) the ids that have a slot
    slot: Rows  # (L,) of each id
    absent: Rows  # (L,) cycles since the id was there
    free: Rows  # (F,) slots without an id
    length: Rows  # (S,) cycles since the first value of the slot, that one counted, at most W
    cycle: int  # number of the newest cycle; -1 before the first

    @staticmethod
    def empty(window: int, dtype: DTypeLike = np.float64, columns: tuple[int, ...] = ()) -> History:
        """No id yet. Args: window: W; dtype: of a value, records for named fields; columns: () or (C,)."""
        none = np.zeros(0, np.int32)
        return History(np.zeros((0, window, *columns), dtype), np.zeros(0, np.int64), none, none, none, none, -1)

    def check_rows(self) -> None:
        """Check slots and lengths, as after reading a checkpoint: kernels do not. Raises: ValueError that names the field."""
        slots, ids = len(self.values), len(self.ids)
        for name, size in (("slot", ids), ("absent", ids), ("length", slots)):
            if len(getattr(self, name)) != size:
                raise ValueError(f"History.{name}: got {len(getattr(self, name))} rows, needed {size}")
        require_rows("History.slot", self.slot, slots)
        require_rows("History.free", self.free, slots)
        require_rows("History.length", self.length, self.window + 1)

    @property
    def window(self) -> int:
        """W."""
        return int(self.values.shape[1])

    @property
    def column(self) -> int:
        """Where the values of the newest cycle stand."""
        return self.cycle % self.window

    def advanced(self, ids: Ints, order: Ints | Rows | None = None, patience: int = 0) -> tuple[History, Rows]:
        """The history one cycle later, and the slot of each id. The caller writes `history.values[slot, history.column]`.

        Args:
            ids: (N,) that are there now, each once.
            order: (N,) rows of ids, the order in which new ids take slots, so that neighbours are adjacent. None: order of `ids`.
            patience: cycles that an id may be absent and keeps its slot, at most W - 1. Its values are NaN meanwhile.
        Returns: the history, (N,) slots.
        """
        at, to = match_ids(self.ids, ids)
        new = np.flatnonzero(at < 0) if order is None else order[at[order] < 0]
        waits = (to < 0) & (self.absent < patience)
        history = self._with_free_slots(self.slot[(to < 0) & ~waits], len(new))
        slot = np.full(len(ids), -1, np.int32)
        known = at >= 0
        slot[known] = self.slot[at[known]]
        left = len(history.free) - len(new)
        slot[new] = history.free[left:]
        waiting, cycle = self.slot[waits], self.cycle + 1
        history.length[slot[new]] = 0
        for rows in (slot, waiting):
            history.length[rows] = np.minimum(history.length[rows] + 1, self.window)
        absent, slots = np.zeros(len(slot), np.int32), slot
        if len(waiting):
            history.values[waiting, cycle % self.window] = np.nan
            ids, slots = np.concatenate([ids, self.ids[waits]]), np.concatenate([slot, waiting])
            absent = np.concatenate([absent, self.absent[waits] + 1])
        return History(history.values, ids, slots, absent, history.free[:left], history.length, cycle), slot

    def slots_of(self, ids: Ints) -> Rows:
        """The slot of each of these ids, -1 for one that has none. Args: (M,), each once. Returns: (M,)."""
        at = index_of(self.ids, ids)
        return np.where(at >= 0, np.append(self.slot, np.int32(-1))[at], -1).astype(np.int32)

    def columns(self, ages: Ints) -> Ints:
        """Where values of these ages stand. Args: (A,) cycles before the newest, 0 to W - 1. Returns: (A,)."""
        return (self.cycle - ages) % self.window

    def _with_free_slots(self, left: Rows, count: int) -> History:
        """The same with the slots that ids have left among the free ones, and at least so many of these."""
        free, values, length = np.concatenate([self.free, left]), self.values, self.length
        missing = count - len(free)
        if missing > 0:
            before = len(length)
            more = missing + (before + missing) // MARGIN
            values = np.concatenate([values, np.zeros((more, *values.shape[1:]), values.dtype)])
            length = np.concatenate([length, np.zeros(more, np.int32)])
            free = np.concatenate([np.arange(before, before + more, dtype=np.int32), free])
        return History(values, self.ids, self.slot, self.absent, free, length, self.cycle)
