"""The compiled loop of `native`: values of rows into a prepared statement of SQLite, by the addresses of SQLite's functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from coastwatch.kernels.jit import jit
from coastwatch.store.native import DONE, INTEGER, NAMED, REAL, TEXT

_WHOLE, _SHORT, _DOUBLE = (types.int64, ir.IntType(64)), (types.int32, ir.IntType(32)), (types.float64, ir.DoubleType())


def _generated(takes: tuple[tuple[Any, Any], ...]) -> tuple[Any, Any]:
    """Signature and code of a call of the C function at an address, which gives an int. A pointer goes as a whole number."""
    made = ir.FunctionType(ir.IntType(32), [kind for _, kind in takes])

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.call(builder.inttoptr(given[0], made.as_pointer()), list(given[1:]))

    return types.int32(types.int64, *(kind for kind, _ in takes)), code


@intrinsic
def _bind_whole(context, function, statement, place, value):  # type: ignore[no-untyped-def]
    return _generated((_WHOLE, _SHORT, _WHOLE))


@intrinsic
def _bind_double(context, function, statement, place, value):  # type: ignore[no-untyped-def]
    return _generated((_WHOLE, _SHORT, _DOUBLE))


@intrinsic
def _bind_null(context, function, statement, place):  # type: ignore[no-untyped-def]
    return _generated((_WHOLE, _SHORT))


@intrinsic
def _bind_bytes(context, function, statement, place, at, length, keeper):  # type: ignore[no-untyped-def]
    return _generated((_WHOLE, _SHORT, _WHOLE, _SHORT, _WHOLE))


@intrinsic
def _act(context, function, statement):  # type: ignore[no-untyped-def]
    return _generated((_WHOLE,))


@jit
def _bind(functions, statement, place, kind, width, cell, real):  # type: ignore[no-untyped-def]
    """One value. NaN and the address 0 are NULL for SQLite."""
    if kind == REAL:
        return _bind_double(functions[1], statement, place, real)  # type: ignore[call-arg]
    if kind == INTEGER or (kind == NAMED and cell >= 0):
        return _bind_whole(functions[0], statement, place, cell)  # type: ignore[call-arg]
    if kind == NAMED:
        return _bind_null(functions[2], statement, place)  # type: ignore[call-arg]
    return _bind_bytes(functions[3 if kind == TEXT else 4], statement, place, cell, width, np.int64(0))  # type: ignore[call-arg]


@jit
def bind_and_step(functions, statement, width, together, places, kinds, widths, cells, reals):  # type: ignore[no-untyped-def]
    """Carry a prepared statement out for every row, `together` rows at a time; gives SQLite's answer, 0 when all is well.

    Args: functions: addresses, as in native.CALLED; width: parameters a row; places: (C,) of the parameters that vary, from 1;
    kinds, widths: of each, widths in bytes; cells: (V, C) values, V a multiple of `together`; reals: the same memory as float64.
    """
    for first in range(0, cells.shape[0], together):
        for k in range(together):
            row, before = first + k, np.int32(k * width)
            for c in range(places.shape[0]):
                answer = _bind(functions, statement, before + places[c], kinds[c], widths[c], cells[row, c], reals[row, c])
                if answer != 0:
                    return answer
        answer = _act(functions[5], statement)  # type: ignore[call-arg]
        if answer != DONE:
            return answer
        _act(functions[6], statement)
    return np.int32(0)
