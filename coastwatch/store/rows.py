"""Rows of tables as columns of arrays: written, updated and deleted in the transaction of a connection, and the answer to a query.

Many rows are columns, an array each, in both directions (`Column`, `Table`); few ones are plain values (`Rows`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import (
    Boolean,
    ColumnElement,
    Connection,
    Delete,
    Executable,
    Float,
    Integer,
    LargeBinary,
    SelectBase,
    String,
    Table as SqlTable,
    Update,
    bindparam,
    delete,
    func,
    select,
    update,
)

from coastwatch.batches import Array, Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.tables.lookup import find

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

    @classmethod
    def of(cls, named: Mapping[str, Array]) -> Table:
        """The table of named columns, in their order."""
        return cls(tuple(named), tuple(named.values()))

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


def fetch_arrays(connection: Connection, query: Executable) -> list[Array]:
    """The answer to a query as one array a column: float64 (NULL: NaN), objects (texts), else int64 (NULL: -1).

    Args: query: a `select`, or a `text` with the types of its columns.
    """
    assert isinstance(query, SelectBase)
    types = [column.type for column in query.selected_columns]
    parts = [[_array((), kind) for kind in types]]
    for rows in connection.execute(query).partitions(FETCH_ROWS):
        parts.append([_array(values, kind) for values, kind in zip(zip(*rows, strict=True), types, strict=True)])
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def is_one_of(connection: Connection, column: ColumnElement[int], numbers: Ints) -> ColumnElement[bool]:
    """That a column has one of these numbers, of which there may be many: SQLite takes them as one JSON parameter."""
    if connection.dialect.name == "sqlite":
        listed = func.json_each(json.dumps(numbers.tolist())).table_valued("value")
        return column.in_(select(listed.c.value))
    return column.in_(bindparam("numbers", numbers.tolist(), expanding=True, literal_execute=True, unique=True))


def _array(values: Sequence[object], kind: object) -> Array:
    if isinstance(kind, Float):
        return np.array(values, float)  # None becomes NaN
    if isinstance(kind, String):
        return np.array([value or None for value in values], object)
    return np.array([-1 if value is None else value for value in values], np.int64)


def _python_values(values: Array) -> list[object]:
    if values.dtype.kind == "i":
        return [None if value == -1 else value for value in values.tolist()]
    if values.dtype.kind == "f":
        return [None if value != value else value for value in values.tolist()]
    return values.tolist()  # type: ignore[no-any-return]


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
    long = (column for column in columns if not isinstance(column, int | float | str | None))
    return next(len(column if isinstance(column, np.ndarray | list) else column[0]) for column in long)


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


def to_python(column: Column, count: int) -> Sequence[object]:
    """A column as Python's values. Args: count: of rows."""
    if isinstance(column, NullableId):
        return [None if x < 0 else x for x in column.values.tolist()]
    if isinstance(column, Categorical):
        return [None if code < 0 else column.texts[code] for code in column.codes.tolist()]
    if isinstance(column, np.ndarray):
        values: list[object] = column.tolist()
        has_nan = column.dtype.kind == "f" and np.isnan(column).any()
        return [None if x != x else x for x in values] if has_nan else values
    return column if isinstance(column, list) else [column] * count


def insert(connection: Connection, table: SqlTable, columns: Sequence[Column]) -> int:
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
    connection: Connection,
    table: SqlTable,
    keys: Mapping[str, Column],
    where: Mapping[str, int | None],
    to: Mapping[str, Column],
) -> None:
    """Update the rows that have these keys; NULL among the new values leaves the old value.

    Args: keys: a column each; where: column to value, further conditions; to: the new values, a column each.
    """
    values: dict[str, Any] = {name: func.coalesce(bindparam(f"to_{name}"), table.c[name]) for name in to}
    new_values = {f"to_{name}": column for name, column in to.items()}
    _by_keys(connection, update(table).values(values), table, keys, where, new_values)


def delete_rows(connection: Connection, table: SqlTable, keys: Mapping[str, Column], where: Mapping[str, int | None]) -> None:
    """Delete the rows that have these keys. Args: keys: a column each; where: column to value, further conditions."""
    _by_keys(connection, delete(table), table, keys, where, {})


def clear_columns(
    connection: Connection, table: SqlTable, keys: Mapping[str, Column], where: Mapping[str, int | None], names: Sequence[str]
) -> None:
    """Set columns to NULL in the rows that have these keys. Args: keys, where: as of `update_rows`; names: of the columns."""
    _by_keys(connection, update(table).values(dict.fromkeys(names)), table, keys, where, {})


def _by_keys(
    connection: Connection,
    statement: Update | Delete,
    table: SqlTable,
    keys: Mapping[str, Column],
    where: Mapping[str, int | None],
    new_values: Mapping[str, Column],
) -> None:
    columns = {**{f"key_{name}": column for name, column in keys.items()}, **new_values}
    count = row_count(list(keys.values()))
    if count:
        alike = [table.c[name].is_(None) if value is None else table.c[name] == value for name, value in where.items()]
        alike += [table.c[name] == bindparam(f"key_{name}") for name in keys]
        rows = zip(*(to_python(column, count) for column in columns.values()), strict=True)
        connection.execute(statement.where(*alike), [dict(zip(columns, row, strict=True)) for row in rows])


def _rows(columns: Sequence[Column], low: int, count: int) -> list[tuple[object, ...]]:
    """At most BATCH_ROWS rows as tuples."""
    high = min(low + BATCH_ROWS, count)
    return list(zip(*(to_python(take(column, slice(low, high)), high - low) for column in columns), strict=True))


def _postgresql_type(kind: object) -> str:
    for sql_type, name in ((Boolean, "bool"), (Integer, "int8"), (Float, "float8"), (LargeBinary, "bytea")):
        if isinstance(kind, sql_type):
            return name
    return "text"


def motion(velocity_m_s: Floats, covariance: Floats) -> Floats:
    """Speed, course and 1-sigma ellipse of vessels.

    Args: velocity_m_s: (V, 2) east, north; covariance: (V, 4, 4).
    Returns: (V, 5) knots; degrees true in [0, 360), NaN at rest; half axes, m; direction of the longer one from north, deg, [0, 180).
    Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 1.4.9: eigenvalues of P.
    """
    east, north = velocity_m_s.T
    speed = np.hypot(east, north)
    course = np.degrees(np.arctan2(east, north)) % 360.0
    course = np.where(speed > 0.0, np.where(course >= 360.0, 0.0, course), np.nan)
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    orientation = np.degrees(0.5 * np.arctan2(2.0 * xy, yy - xx)) % 180.0
    orientation = np.where(orientation >= 180.0, 0.0, orientation)
    axes = (np.sqrt(np.maximum(mean + half, 0.0)), np.sqrt(np.maximum(mean - half, 0.0)))
    return np.stack([speed / KNOT_M_S, course, *axes, orientation], 1)


def source_texts(vessel_id: Ints, members: Ints, names: Sequence[str]) -> Categorical:
    """Names of the sources of each vessel, "guanabara,ais", each once, in the order of their numbers.

    Args: vessel_id: (V,) sorted; members: (L, 3) vessel, source, track, sorted.
    """
    code, texts, width = np.zeros(len(vessel_id), np.int64), [""], len(names)
    fresh = np.append(True, (members[1:, :2] != members[:-1, :2]).any(1))[: len(members)]
    vessel, source = members[fresh, :2].T
    row = find(vessel_id, vessel)
    vessel, source, row = vessel[row >= 0], source[row >= 0], row[row >= 0]
    rank = np.arange(len(vessel)) - np.searchsorted(vessel, vessel)
    for k in range(int(rank.max(initial=-1)) + 1):
        here = np.flatnonzero(rank == k)
        sets, index = np.unique(code[row[here]] * width + source[here], return_inverse=True)
        code[row[here]] = len(texts) + index
        texts += [",".join(filter(None, (texts[pair // width], names[pair % width]))) for pair in sets.tolist()]
    return Categorical(code, texts)
