"""Arrays that are kept for some cycles, one a cycle, reached from compiled code by their addresses.

A tuple of arrays would do as well, but numba compiles it anew for every length of the window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit

COLUMNS = 4  # of an entry: latitude and longitude, and in the place of two more the four of RATES
EAST_RATE, NORTH_RATE, VARIANCE, RATE_VARIANCE = RATES = range(4, 8)
"""Of an entry as eight float32: velocity east, north, variance of position, of velocity. A window is read more often than anything
else of a track, and of these seven digits are more than a track knows."""
ENTRY_BYTES = 8 * COLUMNS
LINE_BYTES = 64

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
