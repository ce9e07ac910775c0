"""`History`: what many ids were at the newest W cycles, in one array that each cycle writes one column of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.match_ids import index_of, match_ids

Array = NDArray[Any]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.int32]

MARGIN = 8  # one slot in so many more than needed, so that few cycles have to make the array larger


@dataclass(frozen=True, eq=False)
class History:
    """Values of ids at the newest W cycles. An id keeps its slot, a row of `values`, for as long as it is there.

    The value of a slot `age` cycles ago stands in column `(cycle - age) % W`. It counts only for `age < length[slot]`.
    What a value is, the caller says: a record with named fields, or C numbers.

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
    def empty(window: int, dtype: Any = np.float64, columns: tuple[int, ...] = ()) -> History:
        """No id yet. Args: window: W; dtype: of a value, records for named fields; columns: () or (C,)."""
        none = np.zeros(0, np.int32)
        return History(np.zeros((0, window, *columns), dtype), np.zeros(0, np.int64), none, none, none, none, -1)

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
            order: (N,) rows of ids in the order in which new ones take slots, for neighbours to lie together; as they come if None.
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


# What follows is read by address, and goes with its last user.
COLUMNS = 4  # of an entry: latitude and longitude, and in the place of two more the four of RATES
EAST_RATE, NORTH_RATE, VARIANCE, RATE_VARIANCE = RATES = range(4, 8)
"""Of an entry as eight float32: velocity east, north, variance of position, of velocity. A window is read more often than anything
else of a track, and of these seven digits are more than a track knows."""
ENTRY_BYTES = 8 * COLUMNS
LINE_BYTES = 64


def addresses(ring: Sequence[Floats], columns: int = COLUMNS) -> Ints:
    """Where the arrays stand, the newest first; they must outlive the use. Args: ring: newest last, (any, columns) each.

    Raises: ValueError for an array that is not laid out as the kernels read it.
    """
    for array in ring:
        if array.dtype != np.float64 or array.ndim != 2 or array.shape[1] != columns or not array.flags.c_contiguous:
            raise ValueError(f"ring: got {array.dtype} {array.shape}, needed contiguous float64 (any, {columns})")
    return np.array([array.ctypes.data for array in reversed(ring)], np.int64)


def entries(position: Floats, velocity: Floats, variance: Floats) -> Floats:
    """Rows of a ring. Args: all (N, 2): degrees, velocity east and north, variance of position and velocity. Returns: (N, COLUMNS)."""
    out: Floats = np.empty((len(position), COLUMNS))
    out[:, :2] = position
    singles(out)[:, RATES] = np.concatenate([velocity, variance], axis=1)
    return out


def singles(ring_array: Floats) -> NDArray[np.float32]:
    """The same memory, of which the columns RATES count. Args: (any, COLUMNS)."""
    return ring_array.view(np.float32)


def wide_rows(count: int, columns: int, room: Callable[..., Any]) -> Floats:
    """Rows that begin where a line of the cache does, so that none lies across one more than it need.

    Args: room: who makes arrays, as np.empty. Returns: (count, columns).
    """
    numbers: Floats = room(count * columns + LINE_BYTES // 8)
    skipped = -numbers.ctypes.data % LINE_BYTES // 8
    return numbers[skipped : skipped + count * columns].reshape(count, columns)


@intrinsic
def pointer(typingctx: Any, address: Any) -> Any:
    """An address as `numba.carray` takes it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


@intrinsic
def fetch(typingctx: Any, address: Any) -> Any:
    """Ask for the memory at an address, which is read soon; it need not be valid."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number = ir.IntType(32)
        shape = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, number, number, number])
        call = builder.module.declare_intrinsic("llvm.prefetch", [cgutils.voidptr_t], shape)
        builder.call(call, [builder.inttoptr(args[0], cgutils.voidptr_t), number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(types.int64), generate


@intrinsic
def number(typingctx: Any, address: Any) -> Any:
    """The float64 at an address."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(builder.inttoptr(args[0], ir.DoubleType().as_pointer()))

    return types.float64(types.int64), generate


@jit
def entry(table, age, row):  # type: ignore[no-untyped-def]
    """The entry of a row of the array that came `age` cycles before the newest. Args: table: of `addresses`.

    Returns: latitude, longitude, velocity east, north, variance of position, of velocity.
    """
    address = table[age] + row * ENTRY_BYTES
    place = carray(pointer(address), (2,), np.float64)  # type: ignore[call-arg]
    single = carray(pointer(address), (8,), np.float32)
    return (
        place[0],
        place[1],
        np.float64(single[EAST_RATE]),
        np.float64(single[NORTH_RATE]),
        np.float64(single[VARIANCE]),
        np.float64(single[RATE_VARIANCE]),
    )


@jit
def fetch_window(table, chain, n, track):  # type: ignore[no-untyped-def]
    """Ask for the newest n entries of a track, of which in `wide_rows` none lies across two lines of the cache.

    Args: chain: as in `kernels.differences`.
    """
    fetch(table[0] + track * ENTRY_BYTES)  # type: ignore[call-arg]
    for age in range(1, n):
        fetch(table[age] + chain[track, age - 1] * ENTRY_BYTES)
