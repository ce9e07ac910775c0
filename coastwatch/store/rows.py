"""What is read, as rows of plain values or as columns of arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from sqlalchemy import Connection, Executable

from coastwatch.batches import Array


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
    """Named columns as arrays, for many rows: float64 (NaN: absent), int64 (-1: absent), bytes of UTF-8 (empty: absent), text."""

    columns: tuple[str, ...]
    arrays: tuple[Array, ...]

    def __len__(self) -> int:
        return len(self.arrays[0])

    def __eq__(self, other: object) -> bool:
        """Whether the same rows are told."""
        return isinstance(other, Table) and self.columns == other.columns and self.rows == other.rows

    __hash__ = None  # type: ignore[assignment]

    def array(self, name: str) -> Array:
        """One column as it is."""
        return self.arrays[self.columns.index(name)]

    def column(self, name: str) -> list[Any]:
        """The values of one column as those of `Rows` are."""
        return plain(self.array(name))

    @property
    def rows(self) -> list[tuple[Any, ...]]:
        """The rows as those of `Rows` are."""
        return list(zip(*map(plain, self.arrays), strict=True))


def plain(values: Array) -> list[Any]:
    """Python's own values; what is absent is None."""
    if values.dtype.kind == "S":
        return [value.decode("utf-8", "replace") or None for value in values.tolist()]
    if values.dtype.kind == "i":
        return [None if value == -1 else value for value in values.tolist()]
    if values.dtype.kind == "f":
        return [None if value != value else value for value in values.tolist()]
    return values.tolist()  # type: ignore[no-any-return]


def fetched(connection: Connection, query: Executable) -> Rows:
    """The answer of the database."""
    result = connection.execute(query)
    return Rows(tuple(result.keys()), [tuple(row) for row in result])
