"""The database: opened, read and written in transactions, or one sentence on why that is not possible (`StoreError`).

SQLite is opened with a write-ahead log, `synchronous = NORMAL`, foreign keys on and the standard library's driver. A power cut may
take the newest cycles, whole ones; a killed process takes none.
"""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Self

from sqlalchemy import URL, Connection, Engine, create_engine, event, func, inspect, make_url, select, text
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from coastwatch.errors import DatabaseAddressError, StoreError
from coastwatch.spelling import did_you_mean, json_value
from coastwatch.store.schema.tables import METADATA, REVISION, REVISION_TABLE

BACKENDS = ("sqlite", "postgresql")
URLS = "the path of an SQLite file, sqlite:///FILE or postgresql+psycopg://USER@HOST/DATABASE"
"""How a database is named, for messages."""

WAIT_S = 10.0
LINK_LIMITS = {
    "connect_timeout": 5, "keepalives_idle": 15, "keepalives_interval": 5, "keepalives_count": 3, "tcp_user_timeout": 30_000,
}  # fmt: skip
"""Of a connection to PostgreSQL, in s, the last one in ms: a server whose machine is gone is noticed after half a minute."""

PAGE_BYTES = 16_384
"""Page size of a new SQLite file: a cycle of 100,000 vessels changes a quarter as many pages as with SQLite's 4 kB."""

CACHE_KIB, MOST_CACHE_KIB = 16 * 1024, 512 * 1024
CYCLE_BYTES = 384
"""Size of the pages that a cycle changes, for each vessel. The page cache of a writing connection is as large. With a smaller one
SQLite writes pages before the transaction ends, some of them twice."""

LOG_BYTES, MOST_LOG_BYTES = 1000 * PAGE_BYTES, 1 << 29
PICTURE_BYTES = 256
"""Size of a row of table `vessel`. SQLite copies the write-ahead log into the database when it is eight pictures long."""

TOO_LONG = 3
"""A log longer than this many times that length is held by a reader: an old transaction that still needs it."""

TRUNCATE_WAIT_MS = 50

STEPS = 10_000
"""Steps of SQLite's machine, a fraction of a millisecond, between two looks at the clock."""

FULL = ("is full", "no space left", "could not extend file")
WRITE_FAILED = "disk i/o error"
"""SQLite's message for any other failure to write, such as the file size limit of the process."""

LEAST_FREE_BYTES = 1_000_000
"""With less free space, a failure to write is reported as a full disk."""


class NoSuchRunError(StoreError):
    """A run that was written is not there any more: somebody has deleted it."""


class NotThere(StoreError):
    """The database is there, and holds nothing of what was asked: no such vessel, or nothing of that time."""


@dataclass(frozen=True)
class QueryLimit:
    """How long a read transaction may take."""

    seconds: float
    clock: Callable[[], float]  # seconds; the store reads no clock of its own


@dataclass(frozen=True)
class Store:
    """An open database and what this process last wrote to it. Close it, or use it in a `with`."""

    engine: Engine
    where: str  # for messages: a path, or a URL without its password
    wait_s: float
    limit: QueryLimit | None = None
    run_states: dict[int, Any] = field(default_factory=dict)  # run -> run_state.RunState

    @property
    def file(self) -> Path | None:
        """The file of an SQLite database; None: it has none, or is PostgreSQL."""
        return _file(self.engine.url)

    @property
    def shared(self) -> bool:
        """Whether all threads see one database: each has one of its own where it is in memory."""
        return self.file is not None or not is_sqlite(self.engine.url)

    def close(self) -> None:
        """Close the connections. The last one to close an SQLite database copies its write-ahead log into the file."""
        self.engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *unused: object) -> None:
        self.close()


def other_schema(stored: str | None) -> str:
    """What to do about a database of another schema. Args: stored: its revision, None: it has no tables."""
    if stored is not None and stored > REVISION:
        return f"schema: got {stored}, needed {REVISION}: it was written by a newer Coastwatch; use that version or a newer one"
    return f"schema: got {stored or 'no tables'}, needed {REVISION}: `coastwatch db upgrade` brings it there"


def connect(url: str, wait_s: float, *, may_create: bool, limit: QueryLimit | None = None, touch: bool = True) -> Store:
    """An open database, whatever is in it. Args: touch: set up the file of a database that may be made. Raises: StoreError."""
    address = _address(url)
    where = address.database or ":memory:" if is_sqlite(address) else address.render_as_string(hide_password=True)
    if (path := _file(address)) is not None:
        if path.is_dir():
            raise StoreError(f"{path}: is a folder, needed a database file")
        if not path.exists() and not may_create:
            raise StoreError(f"{path}: there is no such database; `coastwatch run` makes one")
        if not path.parent.is_dir():
            raise StoreError(f"{path}: there is no folder {path.parent}")
    limits = {name: value for name, value in LINK_LIMITS.items() if name not in address.query}
    try:
        engine = create_engine(
            address,
            json_serializer=as_json,
            connect_args={"timeout": wait_s} if is_sqlite(address) else limits,
            pool_pre_ping=not is_sqlite(address),
        )
    except (ArgumentError, NoSuchModuleError) as error:
        raise DatabaseAddressError(f"{where}: got an unknown driver, needed {URLS}") from error
    except ModuleNotFoundError as error:
        how = ": pip install 'coastwatch[postgresql]'" if error.name == "psycopg" else ""
        raise StoreError(f"{where}: needs the Python package {error.name!r}{how}") from error
    store = Store(engine, where, wait_s, limit)
    _prepare(store)
    if engine.dialect.name == "sqlite" and may_create and touch:
        with refusals(store), engine.connect() as connection:
            _set_up_file(sqlite_connection(connection), wait_s)
    return store


def _set_up_file(raw: sqlite3.Connection, wait_s: float) -> None:
    """Give an SQLite file its write-ahead log. SQLite does not wait for another process that does so, so we ask again."""
    raw.execute(f"PRAGMA page_size = {PAGE_BYTES}")  # has no effect on a file with content
    until_s = time.monotonic() + wait_s
    while True:
        try:
            raw.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > until_s:
                raise
            time.sleep(0.02)


def is_sqlite(address: URL) -> bool:
    """Whether a URL is of SQLite."""
    return address.get_backend_name() == "sqlite"


def _file(address: URL) -> Path | None:
    """The file of an SQLite database that is not in memory."""
    return Path(str(address.database)) if is_sqlite(address) and address.database not in (None, "", ":memory:") else None


def _address(url: str) -> URL:
    """Raises: DatabaseAddressError."""
    if not url.strip():
        raise DatabaseAddressError(f"--db: got an empty text, needed {URLS}")
    try:
        address = make_url(url if "://" in url else f"sqlite:///{url}")
    except (ArgumentError, ValueError) as error:
        raise DatabaseAddressError(f"database: got {url!r}, needed {URLS}") from error
    kind = address.get_backend_name()
    if kind not in BACKENDS:
        hidden = address.render_as_string(hide_password=True)
        raise DatabaseAddressError(
            f"database: got {hidden!r}, a database of {kind!r}, needed {URLS}{did_you_mean(kind, BACKENDS)}"
        )
    return address


def _prepare(store: Store) -> None:
    """Settings of every new connection. Transactions begin explicitly: Python's driver would begin them too late."""
    if store.engine.dialect.name == "postgresql":

        @event.listens_for(store.engine, "connect")
        def configure(raw: DBAPIConnection, record: object) -> None:
            with closing(raw.cursor()) as cursor:
                cursor.execute(f"SET lock_timeout = {max(int(store.wait_s * 1000.0), 1)}")
                cursor.execute("SET jit = off")  # compiling takes 0.3 s, the query a tenth of that
                if store.limit is not None:
                    cursor.execute(f"SET statement_timeout = {max(int(store.limit.seconds * 1000.0), 1)}")
            raw.commit()

    if store.engine.dialect.name != "sqlite":
        return

    @event.listens_for(store.engine, "connect")
    def set_pragmas(raw: sqlite3.Connection, record: object) -> None:
        raw.isolation_level = None
        # Some builds overwrite deleted rows with zeros: the picture of every cycle would be written twice.
        for pragma in ("synchronous = NORMAL", "foreign_keys = ON", "secure_delete = OFF", f"cache_size = -{CACHE_KIB}"):
            raw.execute(f"PRAGMA {pragma}")
        add_math_functions(raw)

    @event.listens_for(store.engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
        if (limit := store.limit) is not None:
            raw = sqlite_connection(connection)
            until = limit.clock() + limit.seconds
            raw.set_progress_handler(None if writes else lambda: limit.clock() > until, STEPS)


def sqlite_connection(connection: Connection) -> sqlite3.Connection:
    """The connection of the driver."""
    raw = connection.connection.driver_connection
    assert isinstance(raw, sqlite3.Connection)
    return raw


def add_math_functions(raw: sqlite3.Connection) -> None:
    """Define the four mathematical functions that db/operator uses, for an SQLite that was built without them."""
    try:
        raw.execute("SELECT cos(0.0), radians(0.0), sqrt(0.0), floor(0.0)")
    except sqlite3.OperationalError:
        for name, function in (("cos", math.cos), ("radians", math.radians), ("sqrt", math.sqrt), ("floor", math.floor)):
            raw.create_function(name, 1, lambda x, f=function: None if x is None else float(f(x)), deterministic=True)


def revision(connection: Connection, where: str) -> str | None:
    """The migration at which a database stands; None where it has no tables yet.

    Raises: StoreError where the tables are another program's.
    """
    tables = set(inspect(connection).get_table_names())
    if REVISION_TABLE in tables:
        return connection.execute(text(f"SELECT max(version_num) FROM {REVISION_TABLE}")).scalar_one_or_none()
    foreign = tables if connection.dialect.name == "sqlite" else tables & set(METADATA.tables)
    if foreign:
        raise StoreError(f"{where}: not a Coastwatch database: it has {', '.join(sorted(foreign)[:5])} and no {REVISION_TABLE}")
    return None


@contextmanager
def reading(store: Store) -> Iterator[Connection]:
    """A read transaction: all its queries see one state of the database, with whole cycles only.

    Keep it short: SQLite's write-ahead log cannot shrink while a reader looks at an old state.
    """
    options: dict[str, Any] = {}
    if store.engine.dialect.name == "postgresql":
        options = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
    with refusals(store), store.engine.connect() as plain, plain.execution_options(**options).begin():
        yield plain


@contextmanager
def writing(store: Store) -> Iterator[Connection]:
    """A write transaction. It takes SQLite's only write lock when it begins."""
    with refusals(store), store.engine.connect() as plain, plain.execution_options(writes=True).begin():
        yield plain


@contextmanager
def refusals(store: Store) -> Iterator[None]:
    """Turn a driver's error into a StoreError that an operator can act on."""
    try:
        yield
    except DBAPIError as error:
        raise StoreError(_message(store, error.orig)) from error
    except (sqlite3.Error, ModuleNotFoundError) as error:
        raise StoreError(_message(store, error)) from error


def _message(store: Store, error: BaseException | None) -> str:
    message = str(error).strip()
    low = message.lower()
    if store.limit is not None and (low == "interrupted" or "statement timeout" in low):
        return f"the question took longer than {store.limit.seconds:g} s: ask for a smaller box or a shorter time"
    if "locked" in low or "lock timeout" in low:
        return f"database is locked by another process: {store.where} (waited {store.wait_s:g} s); end it, or use another --db"
    if is_full(message):
        return cannot_grow(store.where, message.split("\n")[0], is_file=store.engine.dialect.name == "sqlite")
    if "not a database" in low:
        return f"{store.where}: is not an SQLite database"
    if "malformed" in low:
        return f"{store.where}: is damaged ({message}); restore a copy, or start a new database"
    if "readonly" in low or "unable to open" in low:
        return f"{store.where}: cannot be opened or written: {message}"
    return f"{store.where}: {message.splitlines()[0] if message else type(error).__name__}"


KEPT = "every whole cycle stored so far is kept"


def is_full(message: str) -> bool:
    """Whether a driver says that it could not write."""
    return WRITE_FAILED in message.lower() or any(sign in message.lower() for sign in FULL)


def cannot_grow(where: str, message: str, *, is_file: bool, kept: str = KEPT) -> str:
    """Why a database could not be written: its disk is full, its file has reached the limit of this process, or neither is known.

    Args: where: path of an SQLite file, or for messages; message: the driver's; is_file: whether `where` is a path; kept: what is not
    lost.
    """
    full = any(sign in message.lower() for sign in FULL)
    folder = Path(where).absolute().parent
    free = shutil.disk_usage(folder).free if is_file and folder.is_dir() else None
    most = _largest_file_bytes() if is_file else None
    if not full and most is not None and any(_size(Path(where + end)) + PAGE_BYTES > most for end in ("", "-wal")):
        head, why = "file cannot grow", f"this process may write files of {most / 1e6:.1f} MB at most (ulimit -f): "
    else:
        head = "disk full" if full or (free is not None and free < LEAST_FREE_BYTES) else "cannot be written"
        why = "" if free is None else f"{free / 1e6:.1f} MB free in {folder}: "
    return f"{head}: {where}: {why}{message}; {kept}"


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _largest_file_bytes() -> int | None:
    """The largest file that this process may write; None: no limit, or a system that has none."""
    try:
        import resource
    except ImportError:
        return None
    soft = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if soft == resource.RLIM_INFINITY else soft


def size_for(connection: Connection, vessels: int) -> None:
    """Size SQLite's page cache and write-ahead log for a picture of so many vessels. Any other database: nothing."""
    if connection.dialect.name != "sqlite":
        return
    pages = log_bytes(vessels) // int(connection.exec_driver_sql("PRAGMA page_size").scalar_one())
    cache_kib = min(max(CACHE_KIB, vessels * CYCLE_BYTES // 1024), MOST_CACHE_KIB)
    limit = TOO_LONG * log_bytes(vessels)  # a longer log is cut back to that
    for pragma in (f"wal_autocheckpoint = {pages}", f"journal_size_limit = {limit}", f"cache_size = -{cache_kib}"):
        connection.exec_driver_sql(f"PRAGMA {pragma}").close()


def log_bytes(vessels: int) -> int:
    """Length of the write-ahead log at which SQLite copies it into the database."""
    return min(max(LOG_BYTES, 8 * vessels * PICTURE_BYTES), MOST_LOG_BYTES)


def log_size(store: Store) -> int:
    """Bytes of the write-ahead log of an SQLite database; 0: there is none."""
    return 0 if store.file is None else _size(Path(f"{store.file}-wal"))


def long_log_warning(store: Store, vessels: int) -> str | None:
    """A sentence where a reader holds the write-ahead log, so that it grows; None where all is well.

    Where readers follow each other closely, the log is cut in a moment between two of them. A log that is copied and could not be cut,
    as another process writes, is no reader's: the next cycle cuts it.
    """
    if log_size(store) < TOO_LONG * log_bytes(vessels):
        return None
    with store.engine.connect() as connection:
        raw = sqlite_connection(connection)
        raw.execute(f"PRAGMA busy_timeout = {TRUNCATE_WAIT_MS}")
        try:
            is_busy, pages, copied = raw.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        finally:
            raw.execute(f"PRAGMA busy_timeout = {int(store.wait_s * 1000.0)}")
    if not is_busy or copied >= pages:  # -1 both: another process copies it now
        return None
    return f"{store.file}-wal has grown to {log_size(store) / 1e6:.0f} MB: another process reads in one transaction and does not end it"


def require_room_for_log(store: Store, vessels: int) -> None:
    """Refuse to write where a reader holds a log that is longer than the disk has room: it could never be copied into the database.

    Raises: StoreError: nothing is written until the reader ends.
    """
    size = log_size(store)
    if size < TOO_LONG * log_bytes(vessels):
        return
    assert store.file is not None
    free = shutil.disk_usage(store.file.parent).free
    if free < size and (warning := long_log_warning(store, vessels)) is not None:
        raise StoreError(
            f"{warning}; {free / 1e6:.0f} MB are free, needed as much as the log: nothing is written until it ends"
        )


def now_utc(connection: Connection, later: timedelta = timedelta()) -> str:
    """The database's clock, or so much later: 2026-01-31T12:00:00Z, which sorts as time does. No other clock is read in the store."""
    now: datetime = connection.execute(select(func.current_timestamp())).scalar_one()
    there = (now.astimezone(UTC) if now.tzinfo else now) + later
    return there.strftime("%Y-%m-%dT%H:%M:%SZ")


def as_json(value: object) -> str:
    """JSON text of plain values; not a number and infinity are null."""
    return json.dumps(json_value(value), allow_nan=False, default=str)
