"""Retention: old rows are deleted, a few in every cycle, so that no cycle is delayed. 0 hours: rows are kept for ever.

| setting | deleted when older |
|---|---|
| `history_hours` | points, and stays of vessels, their tracks and their MMSI that ended before; no pictures of so early |
| `details_hours` | associations, spots, timings, registrations, cycles of regions that were used |
| `event_hours` | events that ended before, and who acknowledged them; an event that lasts is never deleted |
| `recording_hours` | recorded cycles, whole key cycles at a time |
| `picture_hours` | the current picture of runs that ended so long ago by the database's clock |
| `audit_hours` | who changed what, and versions of zones that were changed since |
| the longest of history, details, events and recording | rows of `cycle`, and names of vessels that sent none since: `static_names` |

Runs that had a retention and have ended go too: `ended_runs`. An SQLite file does not shrink: what becomes free is used again.
"""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Table, delete, func, select, update

from coastwatch.store.recording import delete_recording
from coastwatch.store.rows import delete_rows
from coastwatch.store.schema.database import now_utc
from coastwatch.store.schema.tables import (
    ACKNOWLEDGEMENT,
    AUDIT,
    CYCLE,
    EVENT,
    EVENT_GAP,
    HISTORY,
    METADATA,
    RUN,
    STAGE_TIMING,
    VESSEL,
    ZONE,
)

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
"""Cycles between two searches for what is old and belongs to no cycle."""


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
        mark_cycles(connection, run_id, kept[0], history, {"history_from": None})
    if history > 0:
        _delete_history(connection, run_id, history, most)
    details = _first_kept(number, period_s, keep.details_hours, kept[1])
    if details > kept[1]:
        mark_cycles(connection, run_id, kept[1], details, {"associations_kept": False})
    if details > 0:
        for name in DETAILS:
            delete_some(connection, TABLES[name], run_id, ("cycle",), details, most)
    if keep.event_hours > 0.0:
        _delete_events(connection, run_id, number, period_s, keep, most)
    if keep.recording_hours > 0.0:
        first = number + 1 - math.ceil(keep.recording_hours * 3600.0 / period_s)
        delete_recording(connection, run_id, first, RECORDED_CYCLES)
    if (longest_s := longest_kept_s(keep)) is not None:
        _delete_cycles(connection, run_id, number + 1 - math.ceil(longest_s / period_s), most)
    if number % LOOK_EVERY == 0:
        if keep.picture_hours > 0.0:
            _delete_pictures(connection, keep.picture_hours)
        if keep.audit_hours > 0.0:
            _delete_audit(connection, keep.audit_hours)
    return history, details


def is_limited(keep: StoreSettings) -> bool:
    """Whether anything is kept for a limited time."""
    hours = keep.history_hours, keep.details_hours, keep.event_hours, keep.recording_hours, keep.picture_hours, keep.audit_hours
    return any(hours)


def longest_kept_s(keep: StoreSettings) -> float | None:
    """For how long anything of a cycle is kept, s; None: for ever."""
    hours = [keep.history_hours, keep.details_hours, keep.event_hours, *([keep.recording_hours] if keep.recording else [])]
    return None if 0.0 in hours else max(hours) * 3600.0


def delete_before(connection: Connection, run_id: int, first: int, kind: str, most: int) -> int:
    """Delete about so many rows of a kind, of cycles before one. Args: kind: history, details or events. Returns: rows deleted."""
    if kind == "history":
        mark_cycles(connection, run_id, 0, first, {"history_from": None})
        return _delete_history(connection, run_id, first, most)
    if kind == "details":
        mark_cycles(connection, run_id, 0, first, {"associations_kept": False})
        return sum(delete_some(connection, TABLES[name], run_id, ("cycle",), first, most) for name in DETAILS)
    gaps = delete_some(connection, EVENT_GAP, run_id, ("cycle",), first, most)
    return gaps + delete_some(connection, EVENT, run_id, ("to_cycle",), first, most)


def _first_kept(number: int, period_s: float, hours: float, before: int) -> int:
    """The first cycle that is kept, at most CYCLES later than before."""
    if hours == 0.0:
        return before
    return max(min(number + 1 - math.ceil(hours * 3600.0 / period_s), before + CYCLES), before)


def mark_cycles(connection: Connection, run_id: int, low: int, high: int, values: dict[str, Any]) -> None:
    """Note in the rows of cycles what is no longer kept. Args: low, high: from the first to before the second cycle."""
    where = (CYCLE.c.run_id == run_id, CYCLE.c.number >= low, CYCLE.c.number < high)
    connection.execute(update(CYCLE).where(*where).values(values))


def _delete_history(connection: Connection, run_id: int, kept: int, most: int) -> int:
    """Delete the points that the first kept cycle does not need. Some points that it needs are in earlier cycles. Returns: rows."""
    rows = 0
    first = connection.scalar(select(CYCLE.c.history_from).where(CYCLE.c.run_id == run_id, CYCLE.c.number == kept))
    if first is not None:
        rows += delete_some(connection, HISTORY, run_id, ("cycle", "vessel_id"), first, most)
    for name in STAYS:
        rows += delete_some(connection, TABLES[name], run_id, ("to_cycle",), kept, most)
    return rows


def delete_some(connection: Connection, table: Table, run_id: int, key: tuple[str, ...], below: int, most: int) -> int:
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


def _delete_events(connection: Connection, run_id: int, number: int, period_s: float, keep: StoreSettings, most: int) -> None:
    """Delete old events with their gaps, then the acknowledgements of events that are no longer there."""
    first = number + 1 - math.ceil(max(keep.event_hours * 3600.0, keep.event_gap_s + period_s) / period_s)
    delete_some(connection, EVENT_GAP, run_id, ("cycle",), first, most)
    gone = delete_some(connection, EVENT, run_id, ("to_cycle",), first, most)
    if not gone and number % LOOK_EVERY:
        return
    newest_s = connection.scalar(select(func.max(CYCLE.c.time_s)).where(CYCLE.c.run_id == run_id)) or 0.0
    a, e = ACKNOWLEDGEMENT.c, EVENT.c
    names = ("vessel_id", "kind", "subject", "from_cycle")
    there = select(e.run_id).where(e.run_id == run_id, *(e[name] == a[name] for name in names)).exists()
    old = (a.run_id == run_id, a.acknowledged_s < newest_s - keep.event_hours * 3600.0, ~there)
    found = select(*(a[name] for name in names)).where(*old).order_by(a.acknowledged_s).limit(most)
    if keys := connection.execute(found).all():
        columns = {name: list(column) for name, column in zip(names, zip(*keys, strict=True), strict=True)}
        delete_rows(connection, ACKNOWLEDGEMENT, columns, {"run_id": run_id})


def _delete_cycles(connection: Connection, run_id: int, first: int, most: int) -> None:
    """Delete the rows of cycles before one, as far as no point and no timing is of them."""
    for table in (HISTORY, STAGE_TIMING):
        oldest = connection.scalar(select(func.min(table.c.cycle)).where(table.c.run_id == run_id))
        first = first if oldest is None else min(first, oldest)
    if first > 0:
        delete_some(connection, CYCLE, run_id, ("number",), first, most)


def _delete_audit(connection: Connection, hours: float) -> None:
    """Delete what was changed so long ago: rows of `audit`, and versions of zones that have a newer one."""
    then_s = datetime.fromisoformat(now_utc(connection, -timedelta(hours=hours))).timestamp()
    oldest = select(AUDIT.c.id, AUDIT.c.time_s).order_by(AUDIT.c.id).limit(ROWS)
    old = [row.id for row in connection.execute(oldest) if row.time_s < then_s]
    if old:
        connection.execute(delete(AUDIT).where(AUDIT.c.id <= max(old), AUDIT.c.time_s < then_s))
    newer = ZONE.alias()
    has_newer = select(newer.c.number).where(newer.c.number == ZONE.c.number, newer.c.version > ZONE.c.version).exists()
    connection.execute(delete(ZONE).where(ZONE.c.changed_s < then_s, has_newer))


def _delete_pictures(connection: Connection, hours: float) -> None:
    """Delete the picture of one run that ended too long ago, if there is one."""
    then = now_utc(connection, -timedelta(hours=hours))
    has = select(VESSEL.c.run_id).where(VESSEL.c.run_id == RUN.c.id).exists()
    old = connection.scalar(select(func.min(RUN.c.id)).where(RUN.c.status != "running", RUN.c.finished_utc < then, has))
    if old is not None:
        for name in ("vessel", "bearing_track"):
            connection.execute(delete(TABLES[name]).where(TABLES[name].c.run_id == old))
        connection.execute(update(CYCLE).where(CYCLE.c.run_id == old).values(picture_kept=False))
