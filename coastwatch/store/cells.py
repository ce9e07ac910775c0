"""Columns of rows that are to be written: arrays, never Python values a row. What is absent becomes NULL.

| column | absent |
|---|---|
| array of float64 | NaN |
| array of int64 or bool | nothing is |
| `Named` | a negative number |
| `Texts` | a negative code |
| `Blobs` | where `there` is False |
| one value for every row | None |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Array, Bools, Ints

Value = int | float | str | None


class Named(NamedTuple):
    """Numbers that name something, such as an MMSI; a negative one names nothing."""

    values: Ints


class Texts(NamedTuple):
    """Texts of which many are alike: for each row the place of its text in a short list."""

    codes: Ints
    of: Sequence[str]


class Blobs(NamedTuple):
    """Bytes of one length."""

    rows: Array  # (V, width) uint8, row by row in memory
    there: Bools


Column = Array | Named | Texts | Blobs | Value


def length(columns: Sequence[Column]) -> int:
    """How many rows the columns are of: at least one column must be more than one value for all."""
    return next(len(values(column)) for column in columns if not isinstance(column, Value))


def values(column: Array | Named | Texts | Blobs) -> Array:
    """The array that has an entry a row."""
    return column if isinstance(column, np.ndarray) else column[0]


def part(column: Column, rows: slice | Array) -> Column:
    """The same column of some rows: a range, indices or a mask."""
    if isinstance(column, np.ndarray):
        return column[rows]
    if isinstance(column, Texts):
        return Texts(column.codes[rows], column.of)
    if isinstance(column, Blobs):
        return Blobs(column.rows[rows], column.there[rows])
    return Named(column.values[rows]) if isinstance(column, Named) else column


def plain(column: Column, count: int) -> Sequence[Any]:
    """Python's own values, for a driver that takes nothing else."""
    if isinstance(column, Value):
        return [column] * count
    if isinstance(column, Named):
        return [None if x < 0 else x for x in column.values.tolist()]
    if isinstance(column, Texts):
        return [None if code < 0 else column.of[code] for code in column.codes.tolist()]
    if isinstance(column, Blobs):
        width = column.rows.shape[1]
        rows: list[Any] = np.ascontiguousarray(column.rows).view(f"V{width}").ravel().tolist()
        return [row if there else None for row, there in zip(rows, column.there.tolist(), strict=True)]
    if column.dtype.kind == "f" and np.isnan(column).any():
        return [None if x != x else x for x in column.tolist()]
    return column.tolist()  # type: ignore[no-any-return]
