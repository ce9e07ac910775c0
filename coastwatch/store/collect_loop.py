"""The compiled aggregate of `collect`: values of rows from SQLite into columns of numpy, called by SQLite for every row."""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import carray, cfunc, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from coastwatch.store.native import library

REAL, TEXT = 1, 2
MOST_COLUMNS = 32
COUNT, CAPACITY, CUT = 0, 1, 2
KINDS, PLACES, WIDTHS = 3, 3 + MOST_COLUMNS, 3 + 2 * MOST_COLUMNS
STATE = 3 + 3 * MOST_COLUMNS
"""Words of the state: rows so far, rows that there is room for, texts that were cut; then of each column kind, address and width."""

NULL = 5

for _name in ("value_type", "value_int64", "value_double", "value_text", "value_bytes", "user_data", "result_int64"):
    _sqlite = library()
    assert _sqlite is not None
    llvm.add_symbol(f"sqlite3_{_name}", ctypes.cast(getattr(_sqlite.call, f"sqlite3_{_name}"), ctypes.c_void_p).value)

_pointer_to: Any = types.CPointer
_WORDS, _BYTES = _pointer_to(types.int64), _pointer_to(types.uint8)
_value_type = types.ExternalFunction("sqlite3_value_type", types.int32(types.intp))
_value_whole = types.ExternalFunction("sqlite3_value_int64", types.int64(types.intp))
_value_real = types.ExternalFunction("sqlite3_value_double", types.float64(types.intp))
_value_text = types.ExternalFunction("sqlite3_value_text", _BYTES(types.intp))
_value_bytes = types.ExternalFunction("sqlite3_value_bytes", types.int32(types.intp))
_user_data = types.ExternalFunction("sqlite3_user_data", _WORDS(types.intp))
_result = types.ExternalFunction("sqlite3_result_int64", types.void(types.intp, types.int64))


def _pointer(kind: Any, made: Any) -> tuple[Any, Any]:
    """Signature and code that take a whole number for the address of values of a kind."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.inttoptr(given[0], made.as_pointer())

    return _pointer_to(kind)(types.int64), code


@intrinsic
def _words_at(context, address):  # type: ignore[no-untyped-def]
    return _pointer(types.int64, ir.IntType(64))


@intrinsic
def _reals_at(context, address):  # type: ignore[no-untyped-def]
    return _pointer(types.float64, ir.DoubleType())


@intrinsic
def _bytes_at(context, address):  # type: ignore[no-untyped-def]
    return _pointer(types.uint8, ir.IntType(8))


@cfunc(types.void(types.intp, types.int32, _pointer_to(types.intp)), cache=True)
def take_row(context, count, values):  # type: ignore[no-untyped-def]
    """One row: whole numbers, -1 for NULL; real ones, NaN for NULL; texts in a fixed width, empty for NULL."""
    state = carray(_user_data(context), STATE)
    row, value = state[COUNT], carray(values, count)
    state[COUNT] = row + 1
    if row >= state[CAPACITY]:
        return
    for c in range(count):
        kind, place = state[KINDS + c], state[PLACES + c]
        absent = _value_type(value[c]) == NULL
        if kind == REAL:
            carray(_reals_at(place), row + 1)[row] = float("nan") if absent else _value_real(value[c])  # type: ignore[call-arg]
        elif kind == TEXT:
            width = state[WIDTHS + c]
            length = 0 if absent else _value_bytes(value[c])
            if length > width:
                state[CUT] += 1
                length = width
            out = carray(_bytes_at(place + row * width), width)  # type: ignore[call-arg]
            if length > 0:
                text = carray(_value_text(value[c]), length)
                for k in range(length):
                    out[k] = text[k]
            for k in range(length, width):
                out[k] = 0
        else:
            carray(_words_at(place), row + 1)[row] = -1 if absent else _value_whole(value[c])  # type: ignore[call-arg]


@cfunc(types.void(types.intp), cache=True)
def finish(context):  # type: ignore[no-untyped-def]
    """The number of rows."""
    _result(context, carray(_user_data(context), STATE)[COUNT])
