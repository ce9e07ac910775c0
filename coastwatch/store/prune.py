"""Delete what is old at once, beside a run that goes on: `retention` does it a little in each cycle, where the scenario says so."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from sqlalchemy import Connection, delete, exists, func, select

from coastwatch.store.recording import delete_recording
from coastwatch.store.runs import delete_run, runs
from coastwatch.store.schema.database import Store, now_utc, reading, writing
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, AUDIT, CYCLE, EVENT, RECORDING
from coastwatch.store.write.retention import delete_before

OF_RUNS = ("history", "details", "events", "recording")
KINDS = (*OF_RUNS, "audit")
"""What can be deleted, as in `retention`; audit: who changed what."""

ROWS, RECORDED = 50_000, 200
"""Rows, and recorded cycles, that are deleted in a transaction: a writer waits for a second at most."""


@dataclass
class Pruned:
    """What was deleted."""

    runs: list[int] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)  # by kind; of recording: cycles


def prune(store: Store, older_s: float, kinds: Collection[str] = ()) -> Pruned:
    """Delete what is older than so many seconds. An SQLite file does not shrink: what becomes free is used again.

    Args: kinds: of KINDS; none: runs that ended so long ago, by the clock of the database, and OF_RUNS of all others. The age of
    what is in a run is counted from its newest cycle.
    Raises: StoreError.
    """
    out = Pruned()
    if not kinds:
        out.runs = _ended(store, older_s)
        for run_id in out.runs:
            delete_run(store, run_id)
    wanted = kinds or OF_RUNS
    for run_id in runs(store).column("id"):
        first = _first_kept(store, run_id, older_s)
        for kind in OF_RUNS:
            if kind in wanted:
                out.rows[kind] = out.rows.get(kind, 0) + _delete_all(store, run_id, first, kind)
    if "audit" in wanted:
        with writing(store) as connection:
            then = datetime.fromisoformat(now_utc(connection, -timedelta(seconds=older_s))).timestamp()
            out.rows["audit"] = connection.execute(delete(AUDIT).where(AUDIT.c.time_s < then)).rowcount
    return out


def _ended(store: Store, older_s: float) -> list[int]:
    """The runs that ended, or died, before so many seconds."""
    with reading(store) as connection:
        then = now_utc(connection, -timedelta(seconds=older_s))
    listed = runs(store)
    names = ("id", "status", "finished_utc", "written_utc", "started_utc")
    about = zip(*(listed.column(name) for name in names), strict=True)
    return [number for number, status, *instants in about if status != "running" and next(filter(None, instants)) < then]


def _first_kept(store: Store, run_id: int, older_s: float) -> int:
    """The first cycle of a run that is not too old; 0 where it has none."""
    c = CYCLE.c
    with reading(store) as connection:
        newest = connection.scalar(select(func.max(c.time_s)).where(c.run_id == run_id))
        if newest is None:
            return 0
        found = select(func.min(c.number)).where(c.run_id == run_id, c.time_s >= newest - older_s)
        return int(connection.scalar(found) or 0)


def _delete_all(store: Store, run_id: int, first: int, kind: str) -> int:
    """Delete one kind before a cycle, in transactions of a second or less. Returns: rows, of a recording cycles."""
    total, last = 0, -1
    while first > 0 and last != 0:
        with writing(store) as connection:
            last = _delete(connection, run_id, first, kind)
        total += last
    return total


def _delete(connection: Connection, run_id: int, first: int, kind: str) -> int:
    """Delete a part. Returns: rows; 0: nothing is left."""
    if kind == "recording":
        count = select(func.count()).select_from(RECORDING).where(RECORDING.c.run_id == run_id)
        before = connection.scalar(count) or 0
        delete_recording(connection, run_id, first, RECORDED)
        return before - (connection.scalar(count) or 0)
    rows = delete_before(connection, run_id, first, kind, ROWS)
    if kind == "events" and not rows:
        a, e = ACKNOWLEDGEMENT.c, EVENT.c
        same = [e[name] == a[name] for name in ("run_id", "vessel_id", "kind", "subject", "from_cycle")]
        connection.execute(delete(ACKNOWLEDGEMENT).where(a.run_id == run_id, ~exists().where(*same)))
    return rows
