"""Open a database of this version; one without tables gets them."""

from __future__ import annotations

from coastwatch.store.schema.database import WAIT_S, QueryLimit, Store, StoreError, connect, other_schema, reading, revision
from coastwatch.store.schema.tables import REVISION


def open_store(url: str, *, create: bool = True, wait_s: float = WAIT_S, limit: QueryLimit | None = None) -> Store:
    """An open database with the tables of this version.

    Args: url: any SQLAlchemy URL, or the path of an SQLite file; create: make the tables where there are none; wait_s: how long
    to wait for another process that holds a lock; limit: of each read transaction, none: it may take any time.
    Raises: StoreError where it is absent, unreachable, of another version, or not a Coastwatch database.
    """
    store = connect(url, wait_s, may_create=create, limit=limit)
    try:
        with reading(store) as connection:
            found = revision(connection, store.where)
        if found is None and not create:
            raise StoreError(f"{store.where}: holds no tables; `coastwatch run` or `coastwatch db upgrade` makes them")
        if found is None:
            from coastwatch.store.schema.migrate import upgrade_open  # Alembic is slow to import

            upgrade_open(store)
        elif found != REVISION:
            raise StoreError(f"{store.where}: {other_schema(found)}")
    except BaseException:
        store.close()
        raise
    return store
