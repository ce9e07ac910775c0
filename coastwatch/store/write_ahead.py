"""SQLite's write-ahead log, kept short: no longer than a few cycles, unless a reader holds a transaction open, which is said.

SQLite moves the log into the database when a transaction ends and the log is long; it begins the log anew once all of it has been
moved and no reader looks into it. A reader that keeps a transaction open prevents both, and the log then grows by all that is written.
"""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Connection

from coastwatch.store.opening import CACHE_KIB, PAGE_BYTES, Store

LEAST_BYTES = 1000 * PAGE_BYTES
"""SQLite's own measure, 1000 pages: enough for small pictures."""

VESSEL_BYTES = 256
"""Of a row of table `vessel`, with a reserve."""

REST_BYTES, RECORDED_BYTES = 128, 128
"""Of a cycle's other pages a vessel: its points, the tables of members and stays and their indices; and its recording."""

PICTURES, FEW_PICTURES, LONG_BYTES = 8, 2, 1 << 29
"""The log has room for so many pictures: a page that every cycle writes is then moved once for all of them. For few where that is
longer than so many bytes: the cycle that has to move such a log would be late."""

MOST_CACHE_KIB = 512 * 1024

TOO_LONG = 3
"""Times that length from which on something is wrong."""

PATIENCE_MS = 50


def fit(connection: Connection, vessels: int, *, recorded: bool = False) -> None:
    """Let the log of this connection's database grow to a few pictures of so many vessels, and give it memory for one cycle: pages that
    do not fit in are written before the transaction ends, and where one of these is changed again, all that was written since is read
    again for its check sums. Any other database: nothing.
    """
    if connection.dialect.name == "sqlite":
        pages = _length(vessels) // int(connection.exec_driver_sql("PRAGMA page_size").scalar_one())
        cycle_bytes = VESSEL_BYTES + REST_BYTES + (RECORDED_BYTES if recorded else 0)
        cache_kib = min(max(CACHE_KIB, vessels * cycle_bytes // 1024), MOST_CACHE_KIB)
        most = TOO_LONG * _most(vessels)  # what the log has grown by beyond that is given back
        for pragma in (f"wal_autocheckpoint = {pages}", f"journal_size_limit = {most}", f"cache_size = -{cache_kib}"):
            connection.exec_driver_sql(f"PRAGMA {pragma}").close()


def complaint(store: Store, vessels: int) -> str | None:
    """A sentence where the log has grown too long, and readers do not let go of it; None where all is well.

    Where readers only follow close on each other, so that there is always one, the log is begun anew in a moment between them.
    """
    if store.engine.dialect.name != "sqlite" or not store.shared:
        return None
    path = Path(f"{store.engine.url.database}-wal")
    if not path.exists() or path.stat().st_size < TOO_LONG * _most(vessels):
        return None
    with store.engine.connect() as connection:
        raw = connection.connection.driver_connection
        assert raw is not None
        raw.execute(f"PRAGMA busy_timeout = {PATIENCE_MS}")
        try:
            held, _, _ = raw.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        finally:
            raw.execute(f"PRAGMA busy_timeout = {int(store.wait_s * 1000.0)}")
    if not held:
        return None
    size_mb = path.stat().st_size / 1e6
    return f"{path} has grown to {size_mb:.0f} MB: another process reads in one transaction and does not end it"


def _length(vessels: int) -> int:
    """Bytes up to which the log may grow."""
    picture = vessels * VESSEL_BYTES
    return max(LEAST_BYTES, picture * (PICTURES if PICTURES * picture <= LONG_BYTES else FEW_PICTURES))


def _most(vessels: int) -> int:
    """The same, no less than of fewer vessels: where a picture grows past LONG_BYTES the log of before is no one's fault."""
    picture = vessels * VESSEL_BYTES
    return max(LEAST_BYTES, FEW_PICTURES * picture, min(PICTURES * picture, LONG_BYTES))
