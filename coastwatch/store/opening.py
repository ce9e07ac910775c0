"""A database opened, or a plain sentence on why it cannot be."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from sqlalchemy import URL, Connection, Engine, create_engine, event, inspect, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from coastwatch.store.image import let_go
from coastwatch.store.room import cannot_grow
from coastwatch.store.tables import REVISION, REVISION_TABLE, Base

WAIT_S = 10.0
PAGE_BYTES = 16_384
"""Of a new SQLite file: a cycle of 100,000 vessels changes a quarter as many pages as of SQLite's own 4 kB."""

CACHE_KIB = 16_384


class StoreError(Exception):
    """The database cannot do what was asked; the message says which database, why, and what to do."""


@dataclass(frozen=True)
class Store:
    """An open database and what this process last wrote to it. Close it, or use it in a `with`."""

    engine: Engine
    where: str  # for messages: a path, or a URL without its password
    wait_s: float
    newest: dict[int, Any] = field(default_factory=dict)  # run -> newest.Newest

    @property
    def shared(self) -> bool:
        """Whether all threads see one database: each has one of its own where it is in memory."""
        return not is_sqlite(self.engine.url) or self.engine.url.database not in (None, "", ":memory:")

    def close(self) -> None:
        """Give the connections back. The last one to close an SQLite database folds its write-ahead log into the file."""
        self.engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *unused: object) -> None:
        self.close()


def open_store(url: str, *, create: bool = True, wait_s: float = WAIT_S) -> Store:
    """An open database with the tables of this version.

    Args: url: any SQLAlchemy URL, or the path of an SQLite file; create: make the tables where there are none; wait_s: how long
    to wait for another process that holds a lock.
    Raises: StoreError where it is absent, unreachable, of another version, or not a Coastwatch database.
    """
    store = connect(url, wait_s, may_create=create)
    try:
        with reading(store) as connection:
            found = revision(connection, store.where)
        if found is None and not create:
            raise StoreError(f"{store.where}: holds no tables; `coastwatch run` or `coastwatch db upgrade` makes them")
        if found is None:
            from coastwatch.store.migrate import upgrade_open

            upgrade_open(store)
        elif found != REVISION:
            older = found < REVISION
            remedy = "`coastwatch db upgrade` brings it there" if older else "it was written by a newer Coastwatch"
            raise StoreError(f"{store.where}: got schema {found}, needed {REVISION}: {remedy}")
    except BaseException:
        store.close()
        raise
    return store


def connect(url: str, wait_s: float, *, may_create: bool) -> Store:
    """An open database, whatever is in it. Raises: StoreError."""
    address = _address(url)
    where = address.database or ":memory:" if is_sqlite(address) else address.render_as_string(hide_password=True)
    if is_sqlite(address) and address.database not in (None, "", ":memory:"):
        _look_at_file(Path(str(address.database)), may_create)
    try:
        engine = create_engine(
            address,
            json_serializer=as_json,
            connect_args={"timeout": wait_s} if is_sqlite(address) else {},
            pool_pre_ping=not is_sqlite(address),
        )
    except (ArgumentError, NoSuchModuleError) as error:
        raise StoreError(f"{where}: {error}") from error
    except ModuleNotFoundError as error:
        how = ": pip install 'coastwatch[postgresql]'" if error.name == "psycopg" else ""
        raise StoreError(f"{where}: needs the Python package {error.name!r}{how}") from error
    store = Store(engine, where, wait_s)
    _prepare(store)
    if engine.dialect.name == "sqlite" and may_create:
        with refusals(store), engine.connect() as connection:
            for pragma in (f"page_size = {PAGE_BYTES}", "journal_mode = WAL"):  # the first is heard while the file is empty
                connection.connection.cursor().execute(f"PRAGMA {pragma}")
    return store


def is_sqlite(address: URL) -> bool:
    """Whether a URL is of SQLite, of which only the standard library's may be in the process."""
    return address.get_backend_name() == "sqlite"


def _address(url: str) -> URL:
    try:
        return make_url(url if "://" in url else f"sqlite:///{url}")
    except (ArgumentError, ValueError) as error:
        raise StoreError(f"database: got {url!r}, needed a SQLAlchemy URL such as sqlite:///coastwatch.db: {error}") from error


def _look_at_file(path: Path, may_create: bool) -> None:
    if path.is_dir():
        raise StoreError(f"{path}: is a folder, needed a database file")
    if not path.exists() and not may_create:
        raise StoreError(f"{path}: there is no such database; `coastwatch run` makes one")
    if not path.parent.is_dir():
        raise StoreError(f"{path}: there is no folder {path.parent}")


def _prepare(store: Store) -> None:
    """What every new connection is told. Transactions are begun in so many words, as the driver would begin them too late."""
    if store.engine.dialect.name == "postgresql":

        @event.listens_for(store.engine, "connect")
        def settle(raw: Any, record: Any) -> None:
            with raw.cursor() as cursor:
                cursor.execute(f"SET lock_timeout = {max(int(store.wait_s * 1000.0), 1)}")
                cursor.execute("SET jit = off")  # it takes 0.3 s to compile what then runs for a tenth of that
            raw.commit()

    if store.engine.dialect.name != "sqlite":
        return

    @event.listens_for(store.engine, "connect")
    def set_pragmas(raw: Any, record: Any) -> None:
        raw.isolation_level = None
        # A build may overwrite what is deleted with zeros: the picture of every cycle would be written twice.
        for pragma in ("synchronous = NORMAL", "foreign_keys = ON", "secure_delete = OFF", f"cache_size = -{CACHE_KIB}"):
            raw.execute(f"PRAGMA {pragma}")
        lend_mathematics(raw)

    event.listen(store.engine, "checkin", let_go)

    @event.listens_for(store.engine, "begin")
    def begin(connection: Connection) -> None:
        options = connection.get_execution_options()
        known = options.get("parents_known", False)
        if known != connection.info.get("parents_known", False):  # SQLite hears it only between transactions
            connection.exec_driver_sql(f"PRAGMA foreign_keys = {'OFF' if known else 'ON'}").close()
            connection.info["parents_known"] = known
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("writes", False) else "BEGIN")


def lend_mathematics(raw: sqlite3.Connection) -> None:
    """Give an SQLite that was built without mathematics the four functions that db/operator uses."""
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
    foreign = tables if connection.dialect.name == "sqlite" else tables & set(Base.metadata.tables)
    if foreign:
        raise StoreError(f"{where}: not a Coastwatch database: it has {', '.join(sorted(foreign)[:5])} and no {REVISION_TABLE}")
    return None


@contextmanager
def reading(store: Store) -> Iterator[Connection]:
    """A connection that sees one state of the database, whole cycles only, however many questions it is asked.

    Keep it short: SQLite's write-ahead log cannot shrink while a reader looks at an old state.
    """
    options: dict[str, Any] = {}
    if store.engine.dialect.name == "postgresql":
        options = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
    with refusals(store), store.engine.connect() as plain, plain.execution_options(**options).begin():
        yield plain


@contextmanager
def writing(store: Store, *, parents_known: bool = False) -> Iterator[Connection]:
    """A connection in one transaction, which holds SQLite's only write lock from its first moment.

    Args: parents_known: who writes looks itself, in this transaction, whether the run is there that its rows name, and deletes no
    run: then SQLite does not look for every row, and keeps no copy of the pages that a statement which may fail so has changed.
    """
    options = {"writes": True, "parents_known": parents_known}
    with refusals(store), store.engine.connect() as plain, plain.execution_options(**options).begin():
        yield plain


@contextmanager
def refusals(store: Store) -> Iterator[None]:
    """Turns what a driver says into a StoreError that an operator can act on."""
    try:
        yield
    except DBAPIError as error:
        raise StoreError(_sentence(store, error.orig)) from error
    except (sqlite3.Error, ModuleNotFoundError) as error:
        raise StoreError(_sentence(store, error)) from error


def _sentence(store: Store, error: BaseException | None) -> str:
    said = str(error).strip()
    low = said.lower()
    if "locked" in low or "lock timeout" in low:
        return f"database is locked by another process: {store.where} (waited {store.wait_s:g} s); end it, or use another --db"
    refused = cannot_grow(store.where, said, PAGE_BYTES, here=store.engine.dialect.name == "sqlite")
    if refused:
        return refused
    if "not a database" in low:
        return f"{store.where}: is not an SQLite database"
    if "malformed" in low:
        return f"{store.where}: is damaged ({said}); restore a copy, or start a new database"
    if "readonly" in low or "unable to open" in low:
        return f"{store.where}: cannot be opened or written: {said}"
    return f"{store.where}: {said.splitlines()[0] if said else type(error).__name__}"


def as_json(value: Any) -> str:
    """JSON text of plain values; what JSON cannot say (not a number, infinity) is null."""
    return json.dumps(_sayable(value), allow_nan=False, default=_plain)


def _sayable(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(k): _sayable(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_sayable(v) for v in value]
    return value


def _plain(value: Any) -> Any:
    """What an array or a number of numpy holds."""
    return _sayable(value.tolist()) if hasattr(value, "tolist") else str(value)
