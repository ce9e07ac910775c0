"""Many rows into a table of SQLite by way of a database in memory whose bytes are made here.

SQLite copies a table into an empty one of the same form record by record, without a look into them (its transfer optimisation). So
the columns become the pages of such a table, in SQLite's file format (https://sqlite.org/fileformat2.html), which SQLite reads where
they lie (sqlite3_deserialize). Since it does not look, all that it would check is checked here: order and uniqueness of keys, absent
values, types. What cannot be so is left to `native`, which reports what is wrong with it. Into a table that has rows, or foreign keys
that SQLite is to heed, the same statement inserts row by row with all of its checks, and spares only the binding of each value.
Figures: scaling/decisions/bulk_insert.py.
"""

from __future__ import annotations

import ctypes
import sqlite3
from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Connection, Table

from coastwatch.batches import Array, Ints
from coastwatch.store.cells import Column, length
from coastwatch.store.image_form import Form, form_of, told
from coastwatch.store.native import library

PAGE_BYTES = 65_536
"""Of the image. With pages of 16 kB SQLite takes half as long again to read them."""

ROOT = 2
"""The page at which SQLite begins the first table of a database."""

IMAGES = "images"
"""Under which a connection has its images: each by the name under which it is attached."""

MANY = 1024
"""Rows from which an image is worth its attaching where the table is not empty."""

READ_ONLY = 4
"""SQLITE_DESERIALIZE_READONLY: the memory is ours, SQLite neither writes to it nor frees it."""


def load(connection: Connection, raw: sqlite3.Connection, address: int, table: Table, columns: Sequence[Column]) -> bool:
    """Insert rows into a table, in the transaction in hand; False: that is not possible or not worth it, and nothing was done.

    Images stay attached until the connection goes back to its pool (`let_go`).
    Args: address: from `native.handle`; columns: in the order of the table's.
    Raises: what the standard library raises where SQLite refuses a row or cannot write.
    """
    found = raw.execute("SELECT sql FROM main.sqlite_master WHERE type = 'table' AND name = ?", (table.name,)).fetchone()
    form = form_of(found[0], table.name, PAGE_BYTES) if found else None
    if form is None or form.names != tuple(column.name for column in table.columns) or not _may_attach(raw):
        return False
    if length(columns) < MANY and raw.execute(f"SELECT 1 FROM main.{table.name} LIMIT 1").fetchone():
        return False
    image, images = image_of(form, columns, PAGE_BYTES), connection.info.setdefault(IMAGES, {})
    name = f"image_{len(images)}"
    if image is None or not _attach(raw, address, name, image):
        return False
    images[name] = image
    raw.execute(f"INSERT OR FAIL INTO main.{table.name} SELECT * FROM {name}.{table.name}")
    return True


def let_go(raw: Any, record: Any) -> None:
    """Detach and free the images of a connection that goes back to its pool, if it has some."""
    if raw is not None:
        for name in record.info.pop(IMAGES, ()):
            raw.execute(f"DETACH {name}")


def _may_attach(raw: sqlite3.Connection) -> bool:
    """Whether SQLite can be given an image: its texts are of UTF-8, and the function is there."""
    known = library()
    return bool(
        known and hasattr(known.call, "sqlite3_deserialize") and raw.execute("PRAGMA encoding").fetchone()[0] == "UTF-8"
    )


def _attach(raw: sqlite3.Connection, address: int, name: str, image: Array) -> bool:
    """Give SQLite a database that is this memory."""
    known = library()
    assert known is not None
    try:
        raw.execute(f"ATTACH ':memory:' AS {name}")
    except sqlite3.OperationalError:  # as many are attached as may be
        return False
    give, whole = known.call.sqlite3_deserialize, ctypes.c_int64(image.nbytes)
    give.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_uint]
    if give(address, name.encode(), image.ctypes.data, whole, whole, READ_ONLY) == 0:
        return True
    raw.execute(f"DETACH {name}")
    return False


def image_of(form: Form, columns: Sequence[Column], page_bytes: int) -> Array | None:
    """The bytes of a database whose table has these rows; None where SQLite would not store them as they are."""
    from coastwatch.store import image_loop

    found, count = told(form, columns), length(columns)
    if found is None:
        return None
    sizes, heads = np.empty(count, np.int32), np.empty(count, np.uint8)
    most = image_loop.measure(found.numbers, form.keys, sizes, heads)
    if not 0 < most <= (page_bytes - 12) * 64 // 255 - 23:  # SQLite puts what is longer into pages of its own
        return None
    levels = _levels(sizes, page_bytes)
    number, below = len(form.empty) // page_bytes + 1, 0
    pages = number - 1 + sum(len(ends) for _, ends in levels[:-1])
    image = np.empty(pages * page_bytes, np.uint8)
    image[: len(form.empty)] = np.frombuffer(form.empty, np.uint8)
    image[28:32] = np.frombuffer(pages.to_bytes(4, "big"), np.uint8)
    for rows, ends in levels[:-1]:
        image_loop.fill(image.ctypes.data, page_bytes, number, below, rows, ends, found.numbers, sizes, heads)
        number, below = number + len(ends), number
    image_loop.fill(image.ctypes.data, page_bytes, ROOT, below, *levels[-1], found.numbers, sizes, heads)
    return image


def _levels(sizes: Array, page_bytes: int) -> list[tuple[Ints, Ints]]:
    """The levels of the tree, from its leaves to its root: the rows of each, and where each of its pages ends among them.

    At such an end stands a row that the level above has too; the last is their number. Leaves have all rows, which are not listed.
    """
    from coastwatch.store.image_loop import cut

    levels: list[tuple[Ints, Ints]] = []
    rows: Ints = np.zeros(0, np.int64)
    held = sizes
    while True:
        risen = np.empty(len(held) // 4 + 1, np.int64)
        count = cut(held, 4 if levels else 0, page_bytes - (12 if levels else 8), risen)
        levels.append((rows, np.append(risen[:count], len(held))))
        if count == 0:
            return levels
        rows = risen[:count].copy() if len(levels) == 1 else rows[risen[:count]]
        held = sizes[rows]
