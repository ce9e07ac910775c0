"""Columns as the bytes that PostgreSQL's COPY takes in its binary form: made by numpy for all rows at once.

Source: PostgreSQL documentation, COPY, "Binary Format": a head, then of each row the number of its fields, then of each field its
length (-1: NULL) and its bytes, big end first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from sqlalchemy import Boolean, Float, Integer, Table

from coastwatch.batches import Array, Bools
from coastwatch.store.cells import Blobs, Column, Named, Texts, Value, part, values

HEAD = b"PGCOPY\n\xff\r\n\x00" + bytes(8)
END = b"\xff\xff"
BLOCK = 16_384
"""Rows made at a time: a few megabytes."""


def payload(table: Table, columns: Sequence[Column], count: int) -> Iterator[bytes]:
    """The bytes in parts. Args: columns: of all of the table's columns, in their order."""
    yield HEAD
    kinds = [_kind(column.type) for column in table.columns]
    for low in range(0, count, BLOCK):
        rows = slice(low, min(low + BLOCK, count))
        yield _block([_field(part(c, rows), kind, rows.stop - low) for c, kind in zip(columns, kinds, strict=True)])
    yield END


def _kind(of: object) -> str:
    """The number that a column of the table holds, as numpy writes it; empty: bytes."""
    return "?" if isinstance(of, Boolean) else ">i8" if isinstance(of, Integer) else ">f8" if isinstance(of, Float) else ""


def _field(column: Column, kind: str, count: int) -> tuple[Array, Array]:
    """(V, width) bytes of a field, padded behind, and (V,) how many of them count; -1 where it is NULL."""
    if isinstance(column, Texts | str):
        texts = column if isinstance(column, Texts) else Texts(np.zeros(count, np.int64), (column,))
        encoded = [text.encode() for text in texts.of] or [b""]
        lengths = np.array([len(text) for text in encoded])
        padded = np.array(encoded, f"S{max(int(lengths.max()), 1)}")
        return _bytes_of(padded[texts.codes]), np.where(texts.codes < 0, -1, lengths[texts.codes])
    if isinstance(column, Blobs):
        return column.rows, np.where(column.there, column.rows.shape[1], -1)
    if column is None:
        return np.zeros((count, 0), np.uint8), np.full(count, -1)
    given = np.full(count, column) if isinstance(column, Value) else values(column)
    written = _bytes_of(given.astype(kind))
    return written, np.where(_absent(column, given), -1, written.shape[1])


def _absent(column: Column, given: Array) -> Bools:
    absent: Bools = given < 0 if isinstance(column, Named) else given != given
    return absent


def _bytes_of(numbers: Array) -> Array:
    return np.ascontiguousarray(numbers).view(np.uint8).reshape(len(numbers), numbers.itemsize)


def _block(fields: Sequence[tuple[Array, Array]]) -> bytes:
    """The rows of some fields: laid out at full width, then what does not count is left out."""
    count, width = len(fields[0][1]), 2 + sum(4 + padded.shape[1] for padded, _ in fields)
    rows, counts = np.empty((count, width), np.uint8), np.ones((count, width), np.bool_)
    rows[:, :2] = np.frombuffer(len(fields).to_bytes(2, "big"), np.uint8)
    at = 2
    for padded, lengths in fields:
        to = at + 4 + padded.shape[1]
        rows[:, at : at + 4] = _bytes_of(lengths.astype(">i4"))
        rows[:, at + 4 : to] = padded
        if (lengths != padded.shape[1]).any():
            counts[:, at + 4 : to] = np.arange(padded.shape[1]) < lengths[:, None]
        at = to
    return rows.tobytes() if counts.all() else rows[counts].tobytes()
