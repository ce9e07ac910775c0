"""How a table of SQLite stands in a file, and columns as the compiled loops of `image` read them: by address, as the table keeps them."""

from __future__ import annotations

import functools
import sqlite3
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.store.cells import Blobs, Column, Named, Texts, Value, values
from coastwatch.store.native import BLOB, INTEGER, NAMED, REAL, TEXT

COLUMNS = 40
"""The most of a table: with so many the header of a record is under 128 bytes, and its length one."""

KIND, REQUIRED, AT, STEP, MORE, MORE_STEP, BASE = range(7)
"""What is told of a column: addresses of its values, and bytes from row to row. Texts: AT their codes, MORE where each text begins, BASE
where the first does. Blobs: MORE whether they are there, BASE how long they are."""

AFFINITIES = (
    ("INT", "whole"),
    ("CHAR", "text"),
    ("CLOB", "text"),
    ("TEXT", "text"),
    ("BLOB", "any"),
    ("REAL", "real"),
    ("FLOA", "real"),
    ("DOUB", "real"),
)
"""By a part of the declared type, the first that is found (https://sqlite.org/datatype3.html, section 3.1)."""

KEPT = {INTEGER: ("whole", "number", "any"), NAMED: ("whole", "number", "any"), REAL: ("real",), TEXT: ("text", "any")}
"""Where values of a kind are stored as they are; bytes are everywhere."""


class Form(NamedTuple):
    """How a table stands in a file."""

    empty: bytes  # a database that has this table alone, without rows
    names: tuple[str, ...]
    affinities: tuple[str, ...]
    required: tuple[bool, ...]
    order: tuple[int, ...]  # of the columns in a record
    keys: int  # so many of these, from the first, are the primary key


class Told(NamedTuple):
    """Columns in the order of a record."""

    numbers: Ints  # (C, 7)
    held: list[Array]  # what the addresses are of


@functools.cache
def form_of(sql: str, name: str, page_bytes: int) -> Form | None:
    """The form of the table that a statement makes; None where rows may not be put there without a look by SQLite.

    They may in a table WITHOUT ROWID whose only index is its primary key, in ascending order, without conditions and computed columns.
    Foreign keys that SQLite is to heed it looks at whatever else it leaves out.
    """
    raw = sqlite3.connect(":memory:")
    try:
        raw.execute(f"PRAGMA page_size = {page_bytes}")
        raw.execute(sql)
        columns = raw.execute(f"PRAGMA table_xinfo({name})").fetchall()
        indices = raw.execute(f"PRAGMA index_list({name})").fetchall()
        if len(indices) != 1 or "CHECK" in sql.upper() or len(columns) > COLUMNS or any(c[6] for c in columns):
            return None
        record = raw.execute(f"PRAGMA index_xinfo({indices[0][1]})").fetchall()
        order, descends = tuple(entry[1] for entry in record), any(entry[3] for entry in record)
        if sorted(order) != list(range(len(columns))) or descends:
            return None
        raw.commit()
        return Form(
            raw.serialize(),
            tuple(column[1] for column in columns),
            tuple(affinity(column[2]) for column in columns),
            tuple(bool(column[3] or column[5]) for column in columns),
            order,
            sum(entry[5] for entry in record),
        )
    finally:
        raw.close()


def affinity(declared: str) -> str:
    """What SQLite makes of the values of a column of this type."""
    return next((kind for part, kind in AFFINITIES if part in declared.upper()), "number" if declared else "any")


def told(form: Form, columns: Sequence[Column]) -> Told | None:
    """Columns as the loops read them; None where SQLite would change values, or the key is not of whole numbers.

    Args: columns: in the order of the table.
    """
    numbers: list[list[int]] = []
    held: list[Array] = []
    for place in form.order:
        column, kept_as = columns[place], form.affinities[place]
        kind, arrays, base = _memory(_alone(column) if isinstance(column, Value) else column, kept_as)
        if column is not None and kind != BLOB and kept_as not in KEPT[kind]:
            return None
        at, more = arrays[0], arrays[-1]
        steps = (0, 0) if isinstance(column, Value) else (at.strides[0], more.strides[0])
        numbers.append([kind, form.required[place], at.ctypes.data, steps[0], more.ctypes.data, steps[1], base])
        held += arrays
    whole = all(entry[KIND] == INTEGER for entry in numbers[: form.keys])
    return Told(np.array(numbers, np.int64), held) if whole else None


def _alone(value: Value) -> Column:
    """A column of one row."""
    if value is None:
        return Named(np.array([-1]))
    return Texts(np.array([0]), [value]) if isinstance(value, str) else np.array([value])


def _memory(column: Column, kept_as: str) -> tuple[int, list[Array], int]:
    """Kind, arrays and base of a column. Whole numbers become reals where the table has reals."""
    if isinstance(column, Texts):
        encoded = [text.encode() for text in column.of]
        starts = np.cumsum([0, *map(len, encoded)])
        letters = np.frombuffer(b"".join(encoded) or b"\x00", np.uint8)
        return TEXT, [column.codes.astype(np.int64, copy=False), letters, starts], letters.ctypes.data
    if isinstance(column, Blobs):
        rows = np.ascontiguousarray(column.rows)
        return BLOB, [rows, column.there], rows.shape[1]
    assert not isinstance(column, Value)
    numbers = values(column)
    if kept_as == "real" or numbers.dtype.kind == "f":
        absent = isinstance(column, Named) and numbers < 0
        return (
            REAL,
            [np.where(absent, np.nan, numbers) if isinstance(column, Named) else numbers.astype(np.float64, copy=False)],
            0,
        )
    return NAMED if isinstance(column, Named) else INTEGER, [numbers.astype(np.int64, copy=False)], 0
