"""Copies of an SQLite database, taken while others read and write it. PostgreSQL has pg_dump."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

from coastwatch.store.schema.database import (
    WAIT_S,
    Store,
    StoreError,
    connect,
    is_sqlite,
    other_schema,
    reading,
    refusals,
    revision,
)
from coastwatch.store.schema.tables import REVISION

PART = ".part"
"""End of the name of a copy that is not yet whole."""


def backup(store: Store, path: Path) -> int:
    """Copy a database to a new file: its state of one moment, with whole cycles. Returns: bytes of the file.

    It is one long read transaction: no writer waits, and the write-ahead log grows meanwhile.
    Raises: FileExistsError; StoreError, OSError that name the file.
    """
    if not is_sqlite(store.engine.url):
        raise StoreError(f"{store.where}: got PostgreSQL, needed an SQLite database: pg_dump copies PostgreSQL (ops/README.md)")
    if path.exists():
        raise FileExistsError(f"{path}: is there already, needed the name of a new file")
    part = path.with_name(path.name + PART)
    part.unlink(missing_ok=True)
    try:
        with refusals(store), closing(store.engine.raw_connection()) as pooled:
            raw = pooled.driver_connection
            assert raw is not None
            raw.execute("VACUUM INTO ?", (str(part),))
        _check_copy(store, part)
        _put_on_disk(part)
        part.rename(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise
    _put_on_disk(path.parent)
    return path.stat().st_size


def restore(source: Path, url: str) -> int:
    """Copy a backup to where there is no database. Returns: bytes of the file.

    Raises: StoreError where the backup is damaged or of a newer version; FileExistsError where the database exists; OSError.
    """
    with connect(str(source), WAIT_S, may_create=False) as found:
        with reading(found) as connection:
            schema = revision(connection, found.where)
        if schema is None or schema > REVISION:
            raise StoreError(f"{found.where}: {other_schema(schema)}")
        with connect(url, WAIT_S, may_create=True, touch=False) as made:
            if not is_sqlite(made.engine.url):
                raise StoreError(f"{made.where}: got PostgreSQL, needed an SQLite database: pg_restore restores PostgreSQL")
            target = Path(str(made.engine.url.database))
        return backup(found, target)


def _check_copy(store: Store, path: Path) -> None:
    """Check the pages of a copy, and give it the write-ahead log that every database has. Raises: StoreError."""
    with refusals(store), closing(sqlite3.connect(path)) as raw:
        said = raw.execute("PRAGMA quick_check").fetchone()[0]
        raw.execute("PRAGMA journal_mode = WAL")
    if said != "ok":
        raise StoreError(
            f"{store.where}: the copy is damaged ({said}), so the database is too: `coastwatch db check` says more"
        )


def _put_on_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
