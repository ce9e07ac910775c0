"""Delete runs. A run is marked as `deleting` first, so that nobody reads half of it; then its rows go, a few a transaction.

What is interrupted is finished by the next deletion, or in parts by a server that writes into the database. A writer of the database
gets its turn between two transactions. An SQLite file does not shrink: what becomes free is used again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from sqlalchemy import ColumnElement, Connection, Select, delete, select, true, tuple_, update

from coastwatch.errors import StoreError
from coastwatch.store.processes import Presence, presence, this_process
from coastwatch.store.runs import run_status, runs
from coastwatch.store.schema.database import Store, reading, writing
from coastwatch.store.schema.tables import CHECKPOINT, DELETING, METADATA, OF_NO_RUN, RECORDING, RUN, TRACK_JOURNAL

ROWS, LONG_ROWS = 10_000, 20
"""Rows that a transaction deletes: about 0.1 s. Of tables with long rows fewer: one may have megabytes."""

LONG = (CHECKPOINT, RECORDING, TRACK_JOURNAL)

PAUSE_S = 0.12
"""Between two transactions while another process writes: SQLite looks for its turn each 0.1 s, and has no queue."""

OnPart = Callable[[int, int, str], None]
"""Called after each transaction with runs deleted, runs to delete, and a text."""


def no_progress(done: int, total: int, what: str) -> None:
    """Tell nobody."""


def discard_runs(store: Store, scenario: str, seed: int | None = None, on_part: OnPart = no_progress) -> list[int]:
    """Delete all runs of a scenario (of one seed, where given) with everything they stored; returns their numbers.

    A run that another process of this machine writes stays. Raises: StoreError.
    """
    r = RUN.c
    which = select(r.id).where(r.scenario == scenario, true() if seed is None else r.seed == seed)
    with reading(store) as connection:
        live = _of_others(connection, Presence.HERE)
    return _delete(store, which.where(r.id.not_in(live)), on_part)


def delete_run(store: Store, run_id: int, on_part: OnPart = no_progress) -> None:
    """Delete one run with everything it stored. Raises: StoreError where there is none, or it is being written."""
    if run_status(store, run_id) == "running":
        raise StoreError(f"{store.where}: run {run_id} is being written: got delete, needed a run that has ended")
    _delete(store, select(RUN.c.id).where(RUN.c.id == run_id), on_part)


def keep_runs(store: Store, count: int, scenario: str | None = None, on_part: OnPart = no_progress) -> list[int]:
    """Delete all but the newest runs; one that is being written stays. Returns: the deleted ones.

    Args: count: how many stay; scenario: delete only runs of this scenario, and never its last good run.
    Raises: StoreError.
    """
    listed = runs(store)
    about = zip(*(listed.column(name) for name in ("id", "scenario", "status", "scores", "verdict")), strict=True)
    of_scenario = [row for row in about if scenario in (None, row[1]) and row[2] != DELETING]
    good = [number for number, _, status, scores, verdict in of_scenario if status == "finished" and scores and not verdict]
    stay = set() if scenario is None else set(good[:1])
    old = [number for number, _, status, *_ in of_scenario[count:] if status != "running" and number not in stay]
    return delete_runs(store, old, on_part)


def delete_runs(store: Store, run_ids: Collection[int], on_part: OnPart = no_progress) -> list[int]:
    """Delete runs that have ended. Returns: their numbers. Raises: StoreError."""
    return _delete(store, select(RUN.c.id).where(RUN.c.id.in_(run_ids)), on_part)


def left_behind(connection: Connection) -> list[int]:
    """Runs whose deletion was interrupted: the process that deleted them is no longer there."""
    query = select(RUN.c.id, RUN.c.machine, RUN.c.process).where(RUN.c.status == DELETING).order_by(RUN.c.id)
    mine = this_process()
    return [
        row.id
        for row in connection.execute(query)
        if (row.machine, row.process) == mine or presence(row.machine, row.process) is not Presence.HERE
    ]


def _of_others(connection: Connection, *presences: Presence) -> list[int]:
    """Runs that other processes of these presences write."""
    r, mine = RUN.c, this_process()
    running = connection.execute(select(r.id, r.machine, r.process).where(r.status == "running")).all()
    others = [row for row in running if (row.machine, row.process) != mine]
    return [row.id for row in others if presence(row.machine, row.process) in presences]


def _delete(store: Store, which: Select[tuple[int]], on_part: OnPart) -> list[int]:
    """Mark runs, then delete them and those that were left behind. Returns: the marked ones."""
    with writing(store) as connection:
        asked = mark_deleting(connection, RUN.c.id.in_(which))
        numbers = left_behind(connection)  # the marked ones too
    for done, run_id in enumerate(numbers):
        store.run_states.pop(run_id, None)
        rows, is_whole = 0, False
        while not is_whole:
            with writing(store) as connection:
                part, is_whole = delete_part(connection, run_id)
                is_alone = not _of_others(connection, Presence.HERE, Presence.UNKNOWN)
            rows += part
            on_part(done + is_whole, len(numbers), f"run {run_id}: {rows:,} rows deleted")
            if not is_alone and not is_whole:
                time.sleep(PAUSE_S)
    return asked


def mark_deleting(connection: Connection, which: ColumnElement[bool]) -> list[int]:
    """Note that this process deletes runs. Returns: their numbers."""
    machine, process = this_process()
    mark = update(RUN).where(which).values(status=DELETING, machine=machine, process=process)
    return sorted(connection.scalars(mark.returning(RUN.c.id)))


def delete_part(connection: Connection, run_id: int) -> tuple[int, bool]:
    """Delete ROWS rows of a run in the order of their keys, table by table, and in the end the run.

    Returns: rows, and whether the run is gone.
    """
    left = ROWS
    for table in (one for one in reversed(METADATA.sorted_tables) if one not in (*OF_NO_RUN, RUN)):
        most = min(left, LONG_ROWS) if table in LONG else left
        key = [column for column in table.primary_key if column.name != "run_id"]
        here = select(*key).where(table.c.run_id == run_id).order_by(*key)
        last = connection.execute(here.offset(most - 1).limit(1)).first()
        upto = () if last is None else (tuple_(*key) <= tuple_(*last),)
        left -= connection.execute(delete(table).where(table.c.run_id == run_id, *upto)).rowcount
        if last is not None:
            return ROWS - left, False
    connection.execute(delete(RUN).where(RUN.c.id == run_id))
    return ROWS - left, True
