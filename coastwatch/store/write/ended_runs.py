"""Runs that ended long ago, deleted a part at a time beside a run that goes on: else each start of a server would leave one for ever.

Only runs whose own settings had a retention are deleted. A run of `coastwatch run` or `fuse` keeps everything.
"""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Table, delete, exists, func, select, text, tuple_

from coastwatch.store.processes import Presence, presence
from coastwatch.store.recording import delete_recording
from coastwatch.store.schema.database import now_utc
from coastwatch.store.schema.tables import CHECKPOINT, CYCLE, EVENT, METADATA, OF_NO_RUN, RUN
from coastwatch.store.write.retention import (
    CYCLES,
    DETAILS,
    RECORDED_CYCLES,
    ROWS,
    STAYS,
    delete_some,
    longest_kept_s,
    mark_cycles,
)

if TYPE_CHECKING:
    from coastwatch.scenario import StoreSettings

EVERY = 10
"""Cycles of the run that goes on between two parts."""

FEW = 20
"""Runs that are looked at at a time."""

OF_CYCLES = ("history", *DETAILS, "track_journal")


def delete_ended(connection: Connection, run_id: int, keep: StoreSettings) -> int:
    """Delete a part of the oldest run that has ended: of its history after `history_hours`, of all of it when nothing is to be kept.

    A run with an alarm that lasts and that nobody has acknowledged stays, without its history.
    Args: run_id: of the run that goes on, and keep: its settings. Returns: rows deleted.
    """
    longest_s, has_cycle = longest_kept_s(keep), exists().where(CYCLE.c.run_id == RUN.c.id)
    if keep.history_hours > 0.0 and (found := _ended(connection, run_id, keep.history_hours * 3600.0, has_cycle)) is not None:
        return _delete_history(connection, found)
    if longest_s is not None and (found := _ended(connection, run_id, longest_s, ~_lasting_alarm())) is not None:
        return _delete_run(connection, found)
    return 0


def _lasting_alarm() -> Any:
    """That a run has an alarm that lasts and that nobody has acknowledged."""
    return exists().where(EVENT.c.run_id == RUN.c.id, EVENT.c.to_cycle.is_(None), text("event.unacknowledged"))


def _ended(connection: Connection, run_id: int, after_s: float, where: Any) -> int | None:
    """The oldest run that has written nothing for so long, had a retention, and is not written any more; None: there is none."""
    r, then = RUN.c, now_utc(connection, -timedelta(seconds=after_s))
    silent = func.coalesce(r.finished_utc, r.written_utc, r.started_utc) < then
    limited = r.settings[("store", "history_hours")].as_float() > 0.0
    query = select(r.id, r.status, r.machine, r.process).where(r.id != run_id, silent, limited, where)
    found = connection.execute(query.order_by(r.id).limit(FEW)).all()
    ended = (row.id for row in found if row.status != "running" or presence(row.machine, row.process) is not Presence.HERE)
    return next(ended, None)


def _delete_history(connection: Connection, run_id: int) -> int:
    """Delete the rows of the oldest cycles of a run, then the rows of `cycle`. Returns: rows."""
    low = connection.scalar(select(func.min(CYCLE.c.number)).where(CYCLE.c.run_id == run_id)) or 0
    high, tables = low + CYCLES, METADATA.tables
    connection.execute(delete(CHECKPOINT).where(CHECKPOINT.c.run_id == run_id))
    mark_cycles(connection, run_id, low, high, {"history_from": None, "associations_kept": False})
    keys = dict.fromkeys(OF_CYCLES, ("cycle",)) | {"history": ("cycle", "vessel_id")} | dict.fromkeys(STAYS, ("to_cycle",))
    rows = [delete_some(connection, tables[name], run_id, key, high, ROWS) for name, key in keys.items()]
    recorded = delete_recording(connection, run_id, high, RECORDED_CYCLES)
    if max(rows) < ROWS and not recorded:
        rows.append(delete_some(connection, CYCLE, run_id, ("number",), high, ROWS))
    return sum(rows)


def _delete_run(connection: Connection, run_id: int) -> int:
    """Delete rows of a run, table by table, and in the end the run. Returns: rows."""
    left = ROWS
    for table in (one for one in reversed(METADATA.sorted_tables) if one not in (*OF_NO_RUN, RUN)):
        left -= _delete_part(connection, table, run_id, left)
        if left <= 0:
            return ROWS
    connection.execute(delete(RUN).where(RUN.c.id == run_id))
    return ROWS - left


def _delete_part(connection: Connection, table: Table, run_id: int, most: int) -> int:
    """Delete so many rows of a run at most, in the order of their key. Returns: rows."""
    key = [column for column in table.primary_key if column.name != "run_id"]
    last = connection.execute(select(*key).where(table.c.run_id == run_id).order_by(*key).offset(most - 1).limit(1)).first()
    upto = () if last is None else (tuple_(*key) <= tuple_(*last),)
    return connection.execute(delete(table).where(table.c.run_id == run_id, *upto)).rowcount
