"""One prepared statement of SQLite carried out for many rows by compiled code, on the connection and in the transaction in hand.

The rows are columns of numpy; each value goes from its array into SQLite by one call, with no Python object and without Python's
lock. The library is the one that the standard library's sqlite3 has loaded, and the handle is that of its connection: two SQLite
libraries on one file in a process break the isolation of transactions (speed.md, section 6).
Figures: scaling/decisions/bulk_insert.py.
"""

from __future__ import annotations

import _sqlite3
import ctypes
import functools
import platform
import sqlite3
import struct
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.store.cells import Blobs, Column, Texts, Value, length, values

INTEGER, REAL, NAMED, TEXT, BLOB = range(5)

AT_ONCE = 32
"""Rows a statement: a third faster than one. With more the program of the statement leaves the processor's nearest cache."""

BLOCK = 4096
"""Rows whose values are gathered before they are bound."""

CALLED = ("bind_int64", "bind_double", "bind_null", "bind_text", "bind_blob", "step", "reset")
DONE = 101

KNOWN_LAYOUT = ((3, 11), (3, 12), (3, 13))
"""Versions of CPython whose sqlite3.Connection begins with the object's head and then the handle."""

ERRORS: dict[int, type[Exception]] = {
    7: MemoryError,
    11: sqlite3.DatabaseError,  # corrupt
    18: sqlite3.DataError,  # too big
    19: sqlite3.IntegrityError,  # constraint
    20: sqlite3.IntegrityError,  # mismatch
    21: sqlite3.InterfaceError,  # misuse
    25: sqlite3.InterfaceError,  # range
    26: sqlite3.DatabaseError,  # not a database
}
"""By SQLite's primary code, as the standard library raises them; any other is an OperationalError."""


class Library(NamedTuple):
    """SQLite's functions."""

    call: Any
    addresses: Ints  # of those that the compiled loop calls


@functools.cache
def library() -> Library | None:
    """The SQLite that the standard library uses; None where its functions cannot be reached."""
    found = ctypes.CDLL(_sqlite3.__file__)
    pointer, text, number = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int
    wanted = {
        "prepare_v2": ([pointer, text, number, ctypes.POINTER(pointer), pointer], number),
        "finalize": ([pointer], number),
        "errmsg": ([pointer], text),
        "extended_errcode": ([pointer], number),
        "vfs_find": ([text], pointer),
        "get_autocommit": ([pointer], number),
        "bind_int64": ([pointer, number, ctypes.c_int64], number),
        "bind_double": ([pointer, number, ctypes.c_double], number),
        "bind_text": ([pointer, number, text, number, pointer], number),
    }
    try:
        for name, (arguments, gives) in wanted.items():
            function = getattr(found, f"sqlite3_{name}")
            function.argtypes, function.restype = arguments, gives
        addresses = [ctypes.cast(getattr(found, f"sqlite3_{name}"), pointer).value for name in CALLED]
    except AttributeError:
        return None
    return Library(found, np.array(addresses, np.int64))


def handle(raw: Any) -> int | None:
    """The address of SQLite's own connection behind that of Python; None where it is not known to be there.

    The place is CPython's. It is believed only if what is found there begins, as SQLite's connections do, with the address of its
    default file system, and is in a transaction when Python says so.
    """
    known = platform.python_implementation() == "CPython" and sys.version_info[:2] in KNOWN_LAYOUT
    heads = object.__basicsize__ == 16 and struct.calcsize("P") == 8
    sqlite = library()
    if not (known and heads and sqlite and isinstance(raw, sqlite3.Connection)):
        return None
    address = ctypes.c_void_p.from_address(id(raw) + object.__basicsize__).value
    if not address or address % 8 or ctypes.c_void_p.from_address(address).value != sqlite.call.sqlite3_vfs_find(None):
        return None
    return address if bool(sqlite.call.sqlite3_get_autocommit(address)) != raw.in_transaction else None


def carry_out(raw: sqlite3.Connection, address: int, head: str, row: str, columns: Sequence[Column]) -> None:
    """Carry out a statement for every row. What is bound is read while this runs and no longer.

    Args: address: from `handle`; head: the statement up to its rows, such as `INSERT INTO t (a, b) VALUES `; row: what stands for
    one row, `(?, ?)`; empty: the head is a statement of one row, such as an update.
    Raises: what the standard library raises for the same error.
    """
    count = length(columns)
    together = AT_ONCE if row and count >= AT_ONCE else 1
    whole = count // together * together
    _rows(address, head + ", ".join([row] * together), columns, 0, whole, together)
    _rows(address, head + row, columns, whole, count, 1)


def _rows(address: int, sql: str, columns: Sequence[Column], low: int, high: int, together: int) -> None:
    """Rows low to high, so many a statement."""
    from coastwatch.store.native_loop import bind_and_step

    sqlite = library()
    assert sqlite is not None
    if low == high:
        return
    call, statement = sqlite.call, ctypes.c_void_p()
    _check(call, address, call.sqlite3_prepare_v2(address, sql.encode(), -1, ctypes.byref(statement), None))
    try:
        _bind_constants(call, address, statement, columns, together)
        varying = [(k, column) for k, column in enumerate(columns) if not isinstance(column, Value)]
        places = np.array([k + 1 for k, _ in varying], np.int32)
        kinds = np.array([_kind(column) for _, column in varying], np.int32)
        widths = np.array([c.rows.shape[1] if isinstance(c, Blobs) else -1 for _, c in varying], np.int32)
        held = [_held(column) for _, column in varying]
        cells = np.empty((min(BLOCK, high - low), len(varying)), np.int64)
        for first in range(low, high, BLOCK):
            some = slice(first, min(first + BLOCK, high))
            _gather([column for _, column in varying], held, some, cells)
            here = cells[: some.stop - some.start]
            shape = (sqlite.addresses, statement.value or 0, len(columns), together, places, kinds, widths)
            _check(call, address, bind_and_step(*shape, here, here.view(np.float64)))
    finally:
        call.sqlite3_finalize(statement)


def _bind_constants(call: Any, address: int, statement: Any, columns: Sequence[Column], together: int) -> None:
    """The values that are the same in every row: bound once, they stay. What is never bound is NULL."""
    for place, value in ((k, c) for k, c in enumerate(columns, 1) if isinstance(c, Value) and c is not None):
        for row in range(together):
            at = row * len(columns) + place
            if isinstance(value, str):
                transient = ctypes.c_void_p(-1)
                _check(call, address, call.sqlite3_bind_text(statement, at, value.encode(), -1, transient))
            elif isinstance(value, float):
                _check(call, address, call.sqlite3_bind_double(statement, at, value))
            else:
                _check(call, address, call.sqlite3_bind_int64(statement, at, int(value)))


def _kind(column: Column) -> int:
    if isinstance(column, np.ndarray):
        return REAL if column.dtype.kind == "f" else INTEGER
    return TEXT if isinstance(column, Texts) else BLOB if isinstance(column, Blobs) else NAMED


def _held(column: Column) -> Array:
    """What must stay in memory while rows are bound: values, or the bytes that they point to."""
    if isinstance(column, Texts):
        encoded = [text.encode() + b"\x00" for text in column.of]
        return np.array(encoded or [b"\x00"], f"S{max(map(len, encoded), default=1)}")
    if isinstance(column, Blobs):
        return np.ascontiguousarray(column.rows)
    assert not isinstance(column, Value)
    return values(column)


def _gather(columns: Sequence[Column], held: Sequence[Array], some: slice, cells: Array) -> None:
    """The values of some rows side by side; of texts and blobs their addresses, 0 for what is absent."""
    n, reals = some.stop - some.start, cells.view(np.float64)
    for k, (column, memory) in enumerate(zip(columns, held, strict=True)):
        if isinstance(column, Texts):
            codes = column.codes[some]
            cells[:n, k] = np.where(codes < 0, 0, memory.ctypes.data + codes * memory.itemsize)
        elif isinstance(column, Blobs):
            places = memory.ctypes.data + np.arange(some.start, some.stop) * memory.strides[0]
            cells[:n, k] = np.where(column.there[some], places, 0)
        elif memory.dtype.kind == "f":
            reals[:n, k] = memory[some]
        else:
            cells[:n, k] = memory[some]


def _check(call: Any, address: int, code: int) -> None:
    """Raise what the standard library would for SQLite's answer."""
    if code in (0, DONE):
        return
    extended = int(call.sqlite3_extended_errcode(address))
    primary = extended & 0xFF
    kind = ERRORS.get(primary, sqlite3.OperationalError)
    error = kind(call.sqlite3_errmsg(address).decode("utf-8", "replace"))
    if isinstance(error, sqlite3.Error):
        error.sqlite_errorcode = extended
    raise error
