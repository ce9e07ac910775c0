"""Retention: old rows are deleted, a few in every cycle, so that no cycle is delayed. 0 hours: rows are kept for ever.

| setting | deleted when older |
|---|---|
| `history_hours` | points, and stays of vessels, their tracks and their MMSI that ended before; no pictures of so early |
| `details_hours` | associations, spots, timings, registrations, cycles of regions that were used |
| `event_hours` | events that ended before |
| `recording_hours` | recorded cycles, whole key cycles at a time |
| `picture_hours` | the current picture of runs that ended so long ago by the database's clock |

Rows of `cycle` and `run` stay. An SQLite file does not shrink: what becomes free is used again.
"""

from __future__ import annotations

import math
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Table, delete, func, select, update

from coastwatch.store.schema.database import now_utc
from coastwatch.store.schema.tables import CYCLE, EVENT, EVENT_GAP, HISTORY, METADATA, RUN, VESSEL
from coastwatch.store.write.recording import delete_recording

if TYPE_CHECKING:
    from coastwatch.scenario import StoreSettings

TABLES = METADATA.tables
STAYS = ("presence", "member_history", "identity")
DETAILS = ("association", "bearing_association", "spot", "stage_timing", "sensor_registration", "region_intake")

ROWS = 10_000
"""Rows deleted from a table in a cycle, on top of twice as many as the cycle added: the rate at which a backlog shrinks."""

RECORDED_CYCLES = 2
"""Recorded cycles that are deleted in a cycle."""

CYCLES = 1000
"""Cycles that one cycle may mark as no longer kept."""

LOOK_EVERY = 100
"""Cycles between two searches for runs that ended long ago."""


def delete_old(
    connection: Connection, run_id: int, number: int, period_s: float, keep: StoreSettings, kept: tuple[int, int], written: int
) -> tuple[int, int]:
    """Delete a little of what is too old.

    Args: number: of this cycle; kept: first cycle whose history, and whose details, are kept; written: rows that this cycle added.
    Returns: the first kept cycles afterwards.
    """
    most = ROWS + 2 * written
    history = _first_kept(number, period_s, keep.history_hours, kept[0])
    if history > kept[0]:
        _update_cycles(connection, run_id, kept[0], history, {"history_from": None})
    if history > 0:
        _delete_history(connection, run_id, history, most)
    details = _first_kept(number, period_s, keep.details_hours, kept[1])
    if details > kept[1]:
        _update_cycles(connection, run_id, kept[1], details, {"associations_kept": False})
    if details > 0:
        for name in DETAILS:
            _delete_some(connection, TABLES[name], run_id, ("cycle",), details, most)
    if keep.event_hours > 0.0:
        first = number + 1 - math.ceil(max(keep.event_hours * 3600.0, keep.event_gap_s + period_s) / period_s)
        _delete_some(connection, EVENT, run_id, ("to_cycle",), first, most)
        _delete_some(connection, EVENT_GAP, run_id, ("cycle",), first, most)
    if keep.recording_hours > 0.0:
        first = number + 1 - math.ceil(keep.recording_hours * 3600.0 / period_s)
        delete_recording(connection, run_id, first, RECORDED_CYCLES)
    if keep.picture_hours > 0.0 and number % LOOK_EVERY == 0:
        _delete_pictures(connection, keep.picture_hours)
    return history, details


def delete_before(connection: Connection, run_id: int, first: int, kind: str, most: int) -> int:
    """Delete about so many rows of a kind, of cycles before one. Args: kind: history, details or events. Returns: rows deleted."""
    if kind == "history":
        _update_cycles(connection, run_id, 0, first, {"history_from": None})
        return _delete_history(connection, run_id, first, most)
    if kind == "details":
        _update_cycles(connection, run_id, 0, first, {"associations_kept": False})
        return sum(_delete_some(connection, TABLES[name], run_id, ("cycle",), first, most) for name in DETAILS)
    gaps = _delete_some(connection, EVENT_GAP, run_id, ("cycle",), first, most)
    return gaps + _delete_some(connection, EVENT, run_id, ("to_cycle",), first, most)


def _first_kept(number: int, period_s: float, hours: float, before: int) -> int:
    """The first cycle that is kept, at most CYCLES later than before."""
    if hours == 0.0:
        return before
    return max(min(number + 1 - math.ceil(hours * 3600.0 / period_s), before + CYCLES), before)


def _update_cycles(connection: Connection, run_id: int, low: int, high: int, values: dict[str, Any]) -> None:
    where = (CYCLE.c.run_id == run_id, CYCLE.c.number >= low, CYCLE.c.number < high)
    connection.execute(update(CYCLE).where(*where).values(values))


def _delete_history(connection: Connection, run_id: int, kept: int, most: int) -> int:
    """Delete the points that the first kept cycle does not need. Some points that it needs are in earlier cycles. Returns: rows."""
    rows = 0
    first = connection.scalar(select(CYCLE.c.history_from).where(CYCLE.c.run_id == run_id, CYCLE.c.number == kept))
    if first is not None:
        rows += _delete_some(connection, HISTORY, run_id, ("cycle", "vessel_id"), first, most)
    for name in STAYS:
        rows += _delete_some(connection, TABLES[name], run_id, ("to_cycle",), kept, most)
    return rows


def _delete_some(connection: Connection, table: Table, run_id: int, key: tuple[str, ...], below: int, most: int) -> int:
    """Delete about so many rows whose first key is below a cycle, the lowest first; each statement deletes one stretch of an index.

    Returns: rows deleted.
    """
    columns = [table.c[name] for name in key]
    old = (table.c.run_id == run_id, columns[0] < below)
    last = connection.execute(select(*columns).where(*old).order_by(*columns).offset(most - 1).limit(1)).first()
    if last is None:
        return connection.execute(delete(table).where(*old)).rowcount
    rows = connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] < last[0])).rowcount
    upto = [column <= value for column, value in zip(columns[1:], last[1:], strict=True)]
    return rows + connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] == last[0], *upto)).rowcount


def _delete_pictures(connection: Connection, hours: float) -> None:
    """Delete the picture of one run that ended too long ago, if there is one."""
    then = now_utc(connection, -timedelta(hours=hours))
    has = select(VESSEL.c.run_id).where(VESSEL.c.run_id == RUN.c.id).exists()
    old = connection.scalar(select(func.min(RUN.c.id)).where(RUN.c.status != "running", RUN.c.finished_utc < then, has))
    if old is not None:
        for name in ("vessel", "bearing_track"):
            connection.execute(delete(TABLES[name]).where(TABLES[name].c.run_id == old))
        connection.execute(update(CYCLE).where(CYCLE.c.run_id == old).values(picture_kept=False))
