"""The rows of a query as columns of numpy: for many rows, without a Python object a value.

SQLite calls a compiled aggregate for every row, in its own loop and without Python's lock: 0.3 us a row of 13 columns where fetching
tuples takes 2.7 (scaling/decisions/native_read.py). Another database, or an SQLite whose handle cannot be reached, gives tuples.
"""

from __future__ import annotations

import ctypes
import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Connection, Float, Select, String, bindparam, func, select

from coastwatch.batches import Array, Ints
from coastwatch.store.native import handle, library

NATIVE_FROM = 20_000
"""Rows under which the compiled aggregate, once it has to be loaded, costs more than it gains."""

TEXT_BYTES = 64  # of a text without a length of its own, 16 at least of another; where one is longer, tuples are fetched
WHOLE, REAL, TEXT = range(3)
FLAGS = 1 | 0x80000  # UTF-8; not from triggers and views


def collected(connection: Connection, query: Select[*tuple[Any, ...]], most: int, *, likely: int | None = None) -> list[Array]:
    """The columns of a query: int64 (-1 for NULL), float64 (NaN for NULL) or bytes of UTF-8 (empty for NULL). In no order.

    Args: query: without ORDER BY; most: rows that are expected at most. More are no error, but then it is asked twice. likely: rows
    that are expected, where fewer: for a few the compiled code is used if it is there, but not loaded.
    """
    types = [column.type for column in query.selected_columns]
    kinds = [_kind(of) for of in types]
    state = _state(connection) if loaded() or (most if likely is None else likely) >= NATIVE_FROM else None
    if state is None:
        return arrays(connection.execute(query).all(), types)
    call = query.with_only_columns(func.coastwatch_collect(*query.selected_columns), maintain_column_froms=True)
    while True:
        out = _prepared(state, kinds, types, most)
        count = int(connection.execute(call).scalar_one())
        if state[2]:
            return arrays(connection.execute(query).all(), types)
        if count <= most:
            return [column[:count] for column in out]
        most = count


def among(connection: Connection, column: Any, numbers: Ints) -> Any:
    """That a column has one of these numbers, of which there may be many: one parameter, and one statement for any of them."""
    if connection.dialect.name == "sqlite":
        listed = func.json_each(json.dumps(numbers.tolist())).table_valued("value")
        return column.in_(select(listed.c.value))
    return column.in_(bindparam("numbers", numbers.tolist(), expanding=True, literal_execute=True, unique=True))


def listed(
    connection: Connection, name: str, columns: Sequence[str], rows: Sequence[Sequence[int]]
) -> tuple[str, dict[str, str]]:
    """A table of whole numbers for a WITH clause, and its parameters. For SQLite any such table is the same statement."""
    if connection.dialect.name != "sqlite":
        written = ", ".join(f"({', '.join(map(str, row))})" for row in rows)
        return f"{name} ({', '.join(columns)}) AS (VALUES {written})", {}
    taken = ", ".join(f"json_extract(value, '$[{k}]') AS {column}" for k, column in enumerate(columns))
    return f"{name} AS (SELECT {taken} FROM json_each(:{name}))", {name: json.dumps([list(row) for row in rows])}


def loaded() -> bool:
    """Whether compiled code is in this process, which takes a second to load."""
    return "numba" in sys.modules


def _kind(kind: Any) -> int:
    return REAL if isinstance(kind, Float) else TEXT if isinstance(kind, String) else WHOLE


def _state(connection: Connection) -> Array | None:
    """The state of the aggregate of this connection, which is made known to SQLite at the first use; None where it cannot be."""
    if connection.dialect.name != "sqlite":
        return None
    known: Array | None = connection.info.get("collect")
    if known is not None:
        return known
    address, sqlite = handle(connection.connection.driver_connection), library()
    if address is None or sqlite is None:
        return None
    from coastwatch.store.collect_loop import STATE, finish, take_row

    state = np.zeros(STATE, np.int64)
    pointer = ctypes.c_void_p
    make = sqlite.call.sqlite3_create_function_v2
    make.argtypes = [pointer, ctypes.c_char_p, ctypes.c_int, ctypes.c_int, *[pointer] * 5]
    if make(address, b"coastwatch_collect", -1, FLAGS, state.ctypes.data, None, take_row.address, finish.address, None) != 0:
        return None
    connection.info["collect"] = state
    return state


def _prepared(state: Array, kinds: Sequence[int], types: Sequence[Any], most: int) -> list[Array]:
    """Room for the rows, which the state then names: one piece of memory, which the C library keeps and gives again. Many pieces of
    a megabyte go back to the system each time, and come back page by page: 5 to 20 ms for 170,000 rows."""
    from coastwatch.store.collect_loop import KINDS, PLACES, WIDTHS

    texts = [f"S{max(getattr(of, 'length', None) or TEXT_BYTES, 16)}" for of in types]
    forms = [np.dtype({WHOLE: "i8", REAL: "f8"}.get(kind, text)) for kind, text in zip(kinds, texts, strict=True)]
    ends = np.cumsum([-(-most * form.itemsize // 64) * 64 for form in forms]).tolist()
    room = np.empty(ends[-1], np.uint8)
    out = [room[low : low + most * form.itemsize].view(form) for low, form in zip([0, *ends], forms, strict=False)]
    state[:3] = 0, most, 0
    for k, (kind, column) in enumerate(zip(kinds, out, strict=True)):
        state[KINDS + k], state[PLACES + k], state[WIDTHS + k] = kind, column.ctypes.data, column.itemsize
    return out


def arrays(rows: Sequence[Any], types: Sequence[Any]) -> list[Array]:
    """Rows of Python's values as columns. Args: types: SQLAlchemy's, of each."""
    columns = list(zip(*rows, strict=True)) or [()] * len(types)
    return [_array(column, _kind(of)) for column, of in zip(columns, types, strict=True)]


def _array(values: Sequence[Any], kind: int) -> Array:
    if kind == TEXT:
        return np.array([(value or "").encode() for value in values] or [b""], "S")[: len(values)]
    if kind == REAL:
        return np.array(values, float)
    return np.array([-1 if value is None else value for value in values], np.int64)
