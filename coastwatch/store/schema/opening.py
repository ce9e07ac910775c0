"""Open a database of this version; one without tables gets them. Copy an SQLite database that others use: PostgreSQL has pg_dump."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from sqlalchemy import func, select

from coastwatch.errors import OtherSchemaError, StoreError
from coastwatch.store.schema.database import (
    WAIT_S,
    QueryLimit,
    Store,
    cannot_grow,
    connect,
    is_full,
    other_schema,
    reading,
    refusals,
    revision,
    sqlite_connection,
    writing,
)
from coastwatch.store.schema.tables import METADATA, REVISION, REVISIONS

MAKES_TABLES = 0x636F617374
"""Key of the advisory lock of PostgreSQL while tables are made: the bytes of "coast"."""

RESERVE_BYTES, RESERVE_SHARE = 100_000_000, 0.1
"""Room that a copy leaves for a database on the same disk: at least so many bytes, and so much of the pages in use."""

PART = ".part"
"""End of the name of a copy that is not yet whole."""


def open_store(url: str, *, create: bool = True, wait_s: float = WAIT_S, limit: QueryLimit | None = None) -> Store:
    """An open database with the tables of this version.

    Args: url: any SQLAlchemy URL, or the path of an SQLite file; create: make the tables where there are none; wait_s: how long
    to wait for another process that holds a lock; limit: of each read transaction, none: it may take any time.
    Raises: StoreError where it is absent, unreachable, of another version, or not a Coastwatch database.
    """
    store = connect(url, wait_s, may_create=create, limit=limit)
    try:
        with reading(store) as connection:
            stored = revision(connection, store.where)
        if stored is None and not create:
            raise StoreError(f"{store.where}: holds no tables; `coastwatch run` or `coastwatch db upgrade` makes them")
        if stored is None:
            stored = _make_tables(store)
        if stored != REVISION:
            raise OtherSchemaError(f"{store.where}: {other_schema(stored)}")
    except BaseException:
        store.close()
        raise
    return store


def _make_tables(store: Store) -> str | None:
    """Make the tables of this version in a database without any: as all migrations would, in a tenth of their time.

    Returns: the revision at which it stands then; another process may have been first.
    """
    with writing(store) as connection:
        if connection.dialect.name == "postgresql":  # one process at a time; SQLite has one writer anyway
            connection.execute(select(func.pg_advisory_xact_lock(MAKES_TABLES)))
        stored = revision(connection, store.where)
        if stored is not None:
            return stored
        METADATA.create_all(connection, checkfirst=False)
        REVISIONS.create(connection)
        connection.execute(REVISIONS.insert().values(version_num=REVISION))
        return REVISION


def backup(store: Store, path: Path) -> int:
    """Copy a database to a new file: its state of one moment, with whole cycles. Returns: bytes of the file.

    It is one long read transaction: no writer waits, and the write-ahead log grows meanwhile.
    Raises: FileExistsError; StoreError, OSError that name the file.
    """
    if store.engine.dialect.name != "sqlite":
        raise StoreError(f"{store.where}: got PostgreSQL, needed an SQLite database: pg_dump copies PostgreSQL (ops/README.md)")
    if path.exists():
        raise FileExistsError(f"{path}: is there already, needed the name of a new file")
    part = path.with_name(path.name + PART)
    part.unlink(missing_ok=True)
    with refusals(store), store.engine.connect() as connection:
        _require_room(sqlite_connection(connection), store.file, path)
    try:
        with refusals(store), _room_for(path), store.engine.connect() as connection:
            sqlite_connection(connection).execute("VACUUM INTO ?", (str(part),))
        with refusals(store), _room_for(path), closing(sqlite3.connect(part)) as raw:
            verdict = raw.execute("PRAGMA quick_check").fetchone()[0]
            raw.execute("PRAGMA journal_mode = WAL")  # as every database has it
        if verdict != "ok":
            raise StoreError(
                f"{store.where}: the copy is damaged ({verdict}), so the database is too: `coastwatch db check` says more"
            )
        _put_on_disk(part)
        part.rename(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise
    _put_on_disk(path.parent)
    return path.stat().st_size


def _require_room(raw: sqlite3.Connection, source: Path | None, path: Path) -> None:
    """Raises: StoreError where a copy would not fit, or would take the last room of the database that is in use on the same disk."""
    pages, unused, page_bytes = (
        raw.execute(f"PRAGMA {name}").fetchone()[0] for name in ("page_count", "freelist_count", "page_size")
    )
    size, folder = (pages - unused) * page_bytes, path.absolute().parent
    if not folder.is_dir():
        return
    is_beside = source is not None and source.is_file() and source.stat().st_dev == folder.stat().st_dev
    reserve = max(RESERVE_BYTES, int(RESERVE_SHARE * size)) if is_beside else 0
    free = shutil.disk_usage(folder).free
    if free < size + reserve:
        kept = f" and {reserve / 1e6:.1f} MB that stay for the database" if reserve else ""
        raise StoreError(
            f"disk full: {path}: {free / 1e6:.1f} MB free in {folder}, needed {size / 1e6:.1f} MB of the copy{kept}; no copy is left"
        )


@contextmanager
def _room_for(path: Path) -> Iterator[None]:
    """Raises: StoreError where there is no room for a copy; it names the copy, not the database."""
    try:
        yield
    except sqlite3.Error as error:
        if not is_full(str(error)):
            raise
        raise StoreError(cannot_grow(str(path), str(error), is_file=True, kept="no copy is left")) from error


def restore(source: Path, url: str) -> int:
    """Copy a backup to where there is no database. Returns: bytes of the file.

    Raises: StoreError where the backup is damaged or of a newer version; FileExistsError where the database exists; OSError.
    """
    with connect(str(source), WAIT_S, may_create=False) as backup_store:
        with reading(backup_store) as connection:
            schema = revision(connection, backup_store.where)
        if schema is None or schema > REVISION:
            raise OtherSchemaError(f"{backup_store.where}: {other_schema(schema)}")
        with connect(url, WAIT_S, may_create=True, touch=False) as new:
            if new.file is None:
                raise StoreError(f"{new.where}: got PostgreSQL, needed an SQLite database: pg_restore restores PostgreSQL")
        return backup(backup_store, new.file)


def _put_on_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
