"""Insert, update and delete rows of a table, in the transaction of a connection. Rows are given as columns, an array each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Boolean, Connection, Float, Integer, LargeBinary, Table, bindparam, delete, func, update

from coastwatch.batches import Array, Ints

BATCH_ROWS = 50_000
"""Rows that are converted to Python tuples at a time, to limit memory."""


class NullableId(NamedTuple):
    """Numbers that name something, such as an MMSI; a negative one becomes NULL."""

    values: Ints


class Categorical(NamedTuple):
    """Texts of which many are equal: for each row the index of its text; a negative one becomes NULL."""

    codes: Ints
    texts: Sequence[str]


Column = Array | NullableId | Categorical | list[Any] | int | float | str | None
"""Of rows to be written: an array (NaN becomes NULL), a list of Python's values, or one value for every row."""


def row_count(columns: Sequence[Column]) -> int:
    """How many rows the columns have; at least one column must have a value for each row."""
    return next(len(_values(column)) for column in columns if not isinstance(column, int | float | str | None))


def take(column: Column, rows: slice | Array) -> Column:
    """The column of some rows: a range, indices or a mask."""
    if isinstance(column, np.ndarray):
        return column[rows]
    if isinstance(column, Categorical):
        return Categorical(column.codes[rows], column.texts)
    if isinstance(column, NullableId):
        return NullableId(column.values[rows])
    if isinstance(column, list):
        return column[rows] if isinstance(rows, slice) else np.array(column, object)[rows].tolist()
    return column


def to_python(column: Column, count: int) -> Sequence[Any]:
    """A column as Python's values. Args: count: of rows."""
    if isinstance(column, NullableId):
        return [None if x < 0 else x for x in column.values.tolist()]
    if isinstance(column, Categorical):
        return [None if code < 0 else column.texts[code] for code in column.codes.tolist()]
    if isinstance(column, np.ndarray):
        values: list[Any] = column.tolist()
        has_nan = column.dtype.kind == "f" and np.isnan(column).any()
        return [None if x != x else x for x in values] if has_nan else values
    return column if isinstance(column, list) else [column] * count


def insert(connection: Connection, table: Table, columns: Sequence[Column]) -> int:
    """Insert rows given as columns, in the order of the table's columns. PostgreSQL takes them by COPY. Returns: how many.

    Raises: sqlalchemy.exc.IntegrityError or the driver's own: a row exists already.
    """
    names, count = [column.name for column in table.columns], row_count(columns)
    if count and connection.dialect.driver == "psycopg":
        raw: Any = connection.connection.driver_connection
        with raw.cursor() as cursor, cursor.copy(f"COPY {table.name} ({', '.join(names)}) FROM STDIN (FORMAT BINARY)") as copy:
            copy.set_types([_postgresql_type(column.type) for column in table.columns])
            for low in range(0, count, BATCH_ROWS):
                for row in _rows(columns, low, count):
                    copy.write_row(row)
    elif count:
        statement = f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})"
        for low in range(0, count, BATCH_ROWS):
            connection.exec_driver_sql(statement, _rows(columns, low, count))
    return count


def update_rows(
    connection: Connection, table: Table, keys: Mapping[str, Column], where: Mapping[str, int | None], to: Mapping[str, Column]
) -> None:
    """Update the rows that have these keys; NULL among the new values leaves the old value.

    Args: keys: a column each; where: column to value, further conditions; to: the new values, a column each.
    """
    values: dict[str, Any] = {name: func.coalesce(bindparam(f"to_{name}"), table.c[name]) for name in to}
    given = {f"to_{name}": column for name, column in to.items()}
    _by_keys(connection, update(table).values(values), table, keys, where, given)


def delete_rows(connection: Connection, table: Table, keys: Mapping[str, Column], where: Mapping[str, int | None]) -> None:
    """Delete the rows that have these keys. Args: keys: a column each; where: column to value, further conditions."""
    _by_keys(connection, delete(table), table, keys, where, {})


def clear_columns(
    connection: Connection, table: Table, keys: Mapping[str, Column], where: Mapping[str, int | None], names: Sequence[str]
) -> None:
    """Set columns to NULL in the rows that have these keys. Args: keys, where: as of `update_rows`; names: of the columns."""
    _by_keys(connection, update(table).values(dict.fromkeys(names)), table, keys, where, {})


def _by_keys(
    connection: Connection,
    statement: Any,
    table: Table,
    keys: Mapping[str, Column],
    where: Mapping[str, int | None],
    more: Mapping[str, Column],
) -> None:
    columns = {**{f"key_{name}": column for name, column in keys.items()}, **more}
    count = row_count(list(keys.values()))
    if count:
        alike = [table.c[name].is_(None) if value is None else table.c[name] == value for name, value in where.items()]
        alike += [table.c[name] == bindparam(f"key_{name}") for name in keys]
        rows = zip(*(to_python(column, count) for column in columns.values()), strict=True)
        connection.execute(statement.where(*alike), [dict(zip(columns, row, strict=True)) for row in rows])


def _rows(columns: Sequence[Column], low: int, count: int) -> list[tuple[Any, ...]]:
    """At most BATCH_ROWS rows as tuples."""
    high = min(low + BATCH_ROWS, count)
    return list(zip(*(to_python(take(column, slice(low, high)), high - low) for column in columns), strict=True))


def _values(column: Array | NullableId | Categorical | list[Any]) -> Array | list[Any]:
    return column if isinstance(column, np.ndarray | list) else column[0]


def _postgresql_type(kind: object) -> str:
    for of, name in ((Boolean, "bool"), (Integer, "int8"), (Float, "float8"), (LargeBinary, "bytea")):
        if isinstance(kind, of):
            return name
    return "text"
