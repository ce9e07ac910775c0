"""Many rows into one table by the fastest way that the driver has, inside the transaction in hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, Table, insert


def append(connection: Connection, table: Table, columns: Sequence[Sequence[Any]]) -> None:
    """Insert rows given as columns, in the order of the table's columns.

    SQLite takes tuples by executemany, PostgreSQL takes COPY, any other database SQLAlchemy's own insert.
    """
    if not len(columns[0]):
        return
    names = [column.name for column in table.columns]
    rows = zip(*columns, strict=True)
    if connection.dialect.name == "sqlite":
        marks = ", ".join("?" * len(names))
        connection.exec_driver_sql(f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({marks})", list(rows))
    elif connection.dialect.driver == "psycopg":
        raw = connection.connection.driver_connection
        assert raw is not None
        with raw.cursor() as cursor, cursor.copy(f"COPY {table.name} ({', '.join(names)}) FROM STDIN") as copy:
            for row in rows:
                copy.write_row(row)
    else:
        connection.execute(insert(table), [dict(zip(names, row, strict=True)) for row in rows])
