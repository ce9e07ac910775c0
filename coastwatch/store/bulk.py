"""Many rows into, in and out of one table by the fastest way that the driver has, inside the transaction in hand.

SQLite: a copy of a table whose pages are made here, where it is empty (`image`), else compiled code that binds the columns'
own memory (`native`), executemany where there are few rows or its handle cannot be reached. PostgreSQL: COPY in binary, and arrays
of keys. Any other database: SQLAlchemy's own way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Connection, Delete, Table, Update, bindparam, delete, func, insert, update

from coastwatch.batches import Ints
from coastwatch.store.cells import Column, length, plain

NATIVE_FROM = 256
"""Rows under which executemany is as fast, and a process that writes no more than that need not load the compiled code."""


def append(connection: Connection, table: Table, columns: Sequence[Column]) -> int:
    """Insert rows given as columns, in the order of the table's columns; gives how many."""
    names, count = [column.name for column in table.columns], length(columns)
    if not count:
        return 0
    if connection.dialect.name == "sqlite":
        # Without "or fail" SQLite keeps a second copy of every page, to take back one statement; we take back the transaction.
        head = f"INSERT OR FAIL INTO {table.name} ({', '.join(names)}) VALUES "
        if count >= NATIVE_FROM and _as_image(connection, table, columns):
            return count
        _on_sqlite(connection, head, f"({', '.join('?' * len(names))})", columns, count)
    elif connection.dialect.driver == "psycopg":
        from coastwatch.store.copying import payload

        copying = f"COPY {table.name} ({', '.join(names)}) FROM STDIN (FORMAT BINARY)"
        with _driver(connection).cursor() as cursor, cursor.copy(copying) as copy:
            for some in payload(table, columns, count):
                copy.write(some)
    else:
        connection.execute(insert(table), _dicts(names, columns, count))
    return count


def amend(
    connection: Connection, table: Table, keys: Mapping[str, Ints], same: Mapping[str, int | None], to: Mapping[str, int | None]
) -> None:
    """Set values in the rows that have these keys. Args: keys: a column each; same: what else the rows have; to: the values."""
    setting = ", ".join(f"{name} = {'NULL' if value is None else value}" for name, value in to.items())
    _by_keys(connection, f"UPDATE {table.name} SET {setting}", "FROM", table, keys, same, update(table).values(**to))


def renew(
    connection: Connection, table: Table, keys: Mapping[str, Ints], same: Mapping[str, int], to: Mapping[str, Column]
) -> None:
    """Give each row that has these keys its values; what is absent leaves the old one. Args: as of `amend`; to: a column each."""
    columns = [*to.values(), *keys.values()]
    count = length(columns)
    if count and connection.dialect.name == "sqlite":
        setting = ", ".join(f"{name} = coalesce(?, {name})" for name in to)
        found = " AND ".join([*(f"{name} = {of}" for name, of in same.items()), *(f"{name} = ?" for name in keys)])
        _on_sqlite(connection, f"UPDATE {table.name} SET {setting} WHERE {found}", "", columns, count)
    elif count:
        values: dict[str, Any] = {name: func.coalesce(bindparam(f"to_{name}"), table.c[name]) for name in to}
        alike = [table.c[name] == bindparam(f"of_{name}") for name in keys] + [table.c[name] == of for name, of in same.items()]
        names = [*(f"to_{name}" for name in to), *(f"of_{name}" for name in keys)]
        connection.execute(update(table).where(*alike).values(values), _dicts(names, columns, count))


def erase(connection: Connection, table: Table, keys: Mapping[str, Ints], same: Mapping[str, int | None]) -> None:
    """Delete the rows that have these keys. Args: keys: a column each; same: what else the rows have."""
    _by_keys(connection, f"DELETE FROM {table.name}", "USING", table, keys, same, delete(table))


def _by_keys(
    connection: Connection,
    verb: str,
    joint: str,
    table: Table,
    keys: Mapping[str, Ints],
    same: Mapping[str, int | None],
    usual: Delete | Update,
) -> None:
    columns = list(keys.values())
    count = length(columns)
    if not count:
        return
    fixed = " AND ".join(f"{table.name}.{name} {'IS NULL' if of is None else f'= {of}'}" for name, of in same.items())
    if connection.dialect.name == "sqlite":
        _on_sqlite(connection, f"{verb} WHERE {fixed} AND {' AND '.join(f'{name} = ?' for name in keys)}", "", columns, count)
    elif connection.dialect.driver == "psycopg":
        # A row is looked up for each key, and then found by where it lies: left the choice, and new to the table, the planner scans it.
        names, arrays = ", ".join(keys), ", ".join(["%s::bigint[]"] * len(keys))
        alike = " AND ".join(f"{table.name}.{name} = k.{name}" for name in keys)
        of_key = f"SELECT {table.name}.ctid AS place FROM {table.name} WHERE {fixed} AND {alike} OFFSET 0"
        found = f"unnest({arrays}) AS k ({names}) CROSS JOIN LATERAL ({of_key}) AS f"
        with _driver(connection).cursor() as cursor:
            cursor.execute(f"{verb} {joint} {found} WHERE {table.name}.ctid = f.place", [column.tolist() for column in columns])
    else:
        of_key_too = [table.c[name] == bindparam(f"of_{name}") for name in keys]
        of_all = [table.c[name].is_(None) if of is None else table.c[name] == of for name, of in same.items()]
        connection.execute(usual.where(*of_all, *of_key_too), _dicts([f"of_{name}" for name in keys], columns, count))


def _as_image(connection: Connection, table: Table, columns: Sequence[Column]) -> bool:
    from coastwatch.store import image, native

    raw = _driver(connection)
    address = native.handle(raw)
    return address is not None and image.load(connection, raw, address, table, columns)


def _on_sqlite(connection: Connection, head: str, row: str, columns: Sequence[Column], count: int) -> None:
    if count >= NATIVE_FROM:
        from coastwatch.store import native

        raw = _driver(connection)
        address = native.handle(raw)
        if address is not None:
            native.carry_out(raw, address, head, row, columns)
            return
    connection.exec_driver_sql(head + row, list(zip(*(plain(c, count) for c in columns), strict=True)))


def _driver(connection: Connection) -> Any:
    raw = connection.connection.driver_connection
    assert raw is not None
    return raw


def _dicts(names: Sequence[str], columns: Sequence[Column], count: int) -> list[dict[str, Any]]:
    rows = zip(*(plain(column, count) for column in columns), strict=True)
    return [dict(zip(names, row, strict=True)) for row in rows]
