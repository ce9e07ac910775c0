"""The result of a query: `Rows` of Python values, or a `Table` of arrays for many rows."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Connection, Executable, Float, String, bindparam, func, select

from coastwatch.batches import Array, Ints

INSTANTS = (
    "time_s", "since_s", "updated_s", "start_s", "from_s", "to_s", "first_s", "last_s", "heard_s", "end_s", "changed_s",
    "acknowledged_s", "last_ais_until_s",
)  # fmt: skip
"""Columns that hold an instant, seconds since 1970 UTC; any other column in `_s` is a length of time."""

FETCH_ROWS = 512
"""Rows converted to arrays at a time. More of them alive at once start a full garbage collection, which takes up to 80 ms."""


class Rows(NamedTuple):
    """Named columns and rows of plain values."""

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]

    def column(self, name: str) -> list[Any]:
        """The values of one column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns as arrays: float64 (NaN: absent), int64 (-1: absent), or objects that are texts (None: absent)."""

    columns: tuple[str, ...]
    arrays: tuple[Array, ...]

    def __len__(self) -> int:
        return len(self.arrays[0])

    def __eq__(self, other: object) -> bool:
        """Whether both have the same rows."""
        return isinstance(other, Table) and self.columns == other.columns and self.rows == other.rows

    __hash__ = None  # type: ignore[assignment]

    def array(self, name: str) -> Array:
        """One column as it is."""
        return self.arrays[self.columns.index(name)]

    def column(self, name: str) -> list[Any]:
        """The values of one column, as `Rows` has them."""
        return _python_values(self.array(name))

    def take(self, rows: Array) -> Table:
        """Some of the rows: indices or a mask."""
        return Table(self.columns, tuple(array[rows] for array in self.arrays))

    @property
    def rows(self) -> list[tuple[Any, ...]]:
        """The rows, as `Rows` has them."""
        return list(zip(*map(_python_values, self.arrays), strict=True))


def fetch_rows(connection: Connection, query: Executable) -> Rows:
    """The answer to a query as plain values."""
    result = connection.execute(query)
    return Rows(tuple(result.keys()), [tuple(row) for row in result.all()])


def fetch_arrays(connection: Connection, query: Any) -> list[Array]:
    """The answer to a query as one array a column: float64 (NULL: NaN), objects (texts), else int64 (NULL: -1).

    Args: query: a `select`, or a `text` with the types of its columns.
    """
    types = [column.type for column in query.selected_columns]
    parts = [[_array((), kind) for kind in types]]
    for rows in connection.execute(query).partitions(FETCH_ROWS):
        parts.append([_array(values, kind) for values, kind in zip(zip(*rows, strict=True), types, strict=True)])
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def is_one_of(connection: Connection, column: Any, numbers: Ints) -> Any:
    """That a column has one of these numbers, of which there may be many: SQLite takes them as one JSON parameter."""
    if connection.dialect.name == "sqlite":
        listed = func.json_each(json.dumps(numbers.tolist())).table_valued("value")
        return column.in_(select(listed.c.value))
    return column.in_(bindparam("numbers", numbers.tolist(), expanding=True, literal_execute=True, unique=True))


def _array(values: tuple[Any, ...], kind: Any) -> Array:
    if isinstance(kind, Float):
        return np.array(values, float)  # None becomes NaN
    if isinstance(kind, String):
        return np.array([value or None for value in values], object)
    return np.array([-1 if value is None else value for value in values], np.int64)


def _python_values(values: Array) -> list[Any]:
    if values.dtype.kind == "i":
        return [None if value == -1 else value for value in values.tolist()]
    if values.dtype.kind == "f":
        return [None if value != value else value for value in values.tolist()]
    return values.tolist()  # type: ignore[no-any-return]
