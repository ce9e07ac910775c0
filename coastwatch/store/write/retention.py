"""Retention: old rows are deleted, a few in every cycle, so that no cycle is delayed; or all at once by `prune`. 0 hours: for ever.

| setting | deleted when older |
|---|---|
| `history_hours` | points, decided paths, and stays of vessels, their tracks and their MMSI that ended before; no pictures of so early |
| `details_hours` | associations, spots, timings, registrations, cycles of regions that were used |
| `event_hours` | events that ended before, and who acknowledged them; an event that lasts is never deleted |
| `recording_hours` | recorded cycles |
| `picture_hours` | the current picture of runs that ended so long ago by the database's clock |
| `audit_hours` | who changed what, and versions of zones that were changed since |
| the longest of history, details, events and recording | rows of `cycle`, and names of vessels that sent none since: `static_names` |

A run of a server that ended goes too, or each start would leave one for ever: its history first, then all of it. A run of `coastwatch
run` or `fuse` keeps everything. An SQLite file does not shrink: what becomes free is used again.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from sqlalchemy import Column, Connection, Table, and_, delete, exists, func, select, text, update

from coastwatch.store.deletion import OnPart, delete_part, delete_runs, left_behind, mark_deleting, no_progress
from coastwatch.store.processes import Presence, presence
from coastwatch.store.recording import delete_recording
from coastwatch.store.rows import delete_rows
from coastwatch.store.runs import is_there, runs
from coastwatch.store.schema.database import Store, now_utc, reading, writing
from coastwatch.store.schema.tables import (
    ACKNOWLEDGEMENT,
    AUDIT,
    CHECKPOINT,
    CYCLE,
    DECIDED_PATH,
    DELETING,
    EVENT,
    EVENT_GAP,
    EVENT_KEY,
    HISTORY,
    METADATA,
    RUN,
    STAGE_TIMING,
    STAYS,
    VESSEL,
    ZONE,
    same_event,
)

if TYPE_CHECKING:
    from coastwatch.scenario import StoreSettings

TABLES = METADATA.tables
DETAILS = ("association", "bearing_association", "spot", "stage_timing", "sensor_registration", "region_intake")

OF_RUNS = ("history", "details", "events", "recording")
KINDS = (*OF_RUNS, "audit")
"""What `prune` can delete; audit: who changed what."""

NOT_KEPT: dict[str, dict[Column[Any], object]] = {
    "history": {CYCLE.c.history_from: None},
    "details": {CYCLE.c.associations_kept: False},
}
"""How a row of `cycle` says that a kind is no longer kept of it."""

ROWS = 10_000
"""Rows deleted from a table in a cycle, on top of twice as many as the cycle added: the rate at which a backlog shrinks."""

RECORDED_CYCLES = 2
"""Recorded cycles that are deleted in a cycle."""

CYCLES = 1000
"""Cycles that one cycle may mark as no longer kept."""

LOOK_EVERY = 100
"""Cycles between two searches for what is old and belongs to no cycle."""

ENDED_EVERY, FEW = 10, 20
"""Cycles between two parts of a run that ended, and runs that are looked at at a time."""

PRUNED_ROWS, PRUNED_RECORDINGS = 50_000, 200
"""Rows, and recorded cycles, that `prune` deletes in a transaction: a writer waits for a second at most."""


@dataclass
class Pruned:
    """What was deleted."""

    runs: list[int] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)  # by kind; of recording: cycles


def is_limited(keep: StoreSettings) -> bool:
    """Whether anything is kept for a limited time."""
    hours = keep.history_hours, keep.details_hours, keep.event_hours, keep.recording_hours, keep.picture_hours, keep.audit_hours
    return any(hours)


def longest_kept_s(keep: StoreSettings) -> float | None:
    """For how long anything of a cycle is kept, s; None: for ever."""
    hours = [keep.history_hours, keep.details_hours, keep.event_hours, *([keep.recording_hours] if keep.recording else [])]
    return None if 0.0 in hours else max(hours) * 3600.0


def delete_old(
    connection: Connection, run_id: int, number: int, period_s: float, keep: StoreSettings, kept: tuple[int, int], written: int
) -> tuple[int, int]:
    """Delete a little of what is too old.

    Args: number: of this cycle; kept: first cycle whose history, and whose details, are kept; written: rows that this cycle added.
    Returns: the first kept cycles afterwards.
    """
    most = ROWS + 2 * written

    def first_kept(hours: float, before: int) -> int:
        """The first cycle that is kept, at most CYCLES later than before."""
        return before if hours == 0.0 else max(min(number + 1 - math.ceil(hours * 3600.0 / period_s), before + CYCLES), before)

    history, details = first_kept(keep.history_hours, kept[0]), first_kept(keep.details_hours, kept[1])
    _delete_before(connection, run_id, "history", kept[0], history, most)
    _delete_before(connection, run_id, "details", kept[1], details, most)
    if keep.event_hours > 0.0:
        first = number + 1 - math.ceil(keep.event_s(period_s) / period_s)
        gone = _delete_before(connection, run_id, "events", 0, first, most)
        if gone or number % LOOK_EVERY == 0:
            _delete_acknowledgements(connection, run_id, keep.event_hours * 3600.0, most)
    if keep.recording_hours > 0.0:
        first = number + 1 - math.ceil(keep.recording_hours * 3600.0 / period_s)
        delete_recording(connection, run_id, first, RECORDED_CYCLES)
    if (longest_s := longest_kept_s(keep)) is not None:
        first = number + 1 - math.ceil(longest_s / period_s)
        for table in (HISTORY, STAGE_TIMING):  # a cycle stays while a point or a timing is of it
            oldest = connection.scalar(select(func.min(table.c.cycle)).where(table.c.run_id == run_id))
            first = first if oldest is None else min(first, oldest)
        delete_some(connection, CYCLE, run_id, ("number",), first, most)
    if number % LOOK_EVERY == 0:
        _delete_what_is_of_no_cycle(connection, keep)
    return history, details


def _delete_before(connection: Connection, run_id: int, kind: str, low: int, first: int, most: int) -> int:
    """Delete about so many rows of a kind, of cycles before one. Returns: rows.

    Args: kind: history, details or events; low: the first cycle that may be marked as having them.
    """
    if first <= 0:
        return 0
    if kind in NOT_KEPT and first > low:
        gone = update(CYCLE).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= low, CYCLE.c.number < first)
        connection.execute(gone.values(NOT_KEPT[kind]))
    if kind == "details":
        return sum(delete_some(connection, TABLES[name], run_id, ("cycle",), first, most) for name in DETAILS)
    if kind == "events":
        gaps = delete_some(connection, EVENT_GAP, run_id, ("cycle",), first, most)
        return gaps + delete_some(connection, EVENT, run_id, ("to_cycle",), first, most)
    # Some points that the first kept cycle needs are in earlier cycles.
    needed = connection.scalar(select(CYCLE.c.history_from).where(CYCLE.c.run_id == run_id, CYCLE.c.number == first))
    rows = 0 if needed is None else delete_some(connection, HISTORY, run_id, ("cycle", "vessel_id"), needed, most)
    rows += delete_some(connection, DECIDED_PATH, run_id, ("cycle", "vessel_id"), first, most)
    return rows + sum(delete_some(connection, table, run_id, ("to_cycle",), first, most) for table in STAYS)


def delete_some(connection: Connection, table: Table, run_id: int, key: tuple[str, ...], below: int, most: int) -> int:
    """Delete about so many rows whose first key is below a cycle, the lowest first; each statement deletes one stretch of an index.

    Returns: rows deleted.
    """
    columns = [table.c[name] for name in key]
    old = and_(table.c.run_id == run_id, columns[0] < below)
    last = connection.execute(select(*columns).where(old).order_by(*columns).offset(most - 1).limit(1)).first()
    if last is None:
        return connection.execute(delete(table).where(old)).rowcount
    rows = connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] < last[0])).rowcount
    upto = [column <= value for column, value in zip(columns[1:], last[1:], strict=True)]
    return rows + connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] == last[0], *upto)).rowcount


def _delete_acknowledgements(connection: Connection, run_id: int, kept_s: float, most: int) -> None:
    """Delete old acknowledgements of events that are no longer there."""
    newest_s = connection.scalar(select(func.max(CYCLE.c.time_s)).where(CYCLE.c.run_id == run_id)) or 0.0
    a, names = ACKNOWLEDGEMENT.c, EVENT_KEY[1:]
    there = exists().where(same_event(EVENT, ACKNOWLEDGEMENT))
    query = select(*(a[name] for name in names)).where(a.run_id == run_id, a.acknowledged_s < newest_s - kept_s, ~there)
    if keys := connection.execute(query.order_by(a.acknowledged_s).limit(most)).all():
        columns = {name: list(column) for name, column in zip(names, zip(*keys, strict=True), strict=True)}
        delete_rows(connection, ACKNOWLEDGEMENT, columns, {"run_id": run_id})


def _delete_what_is_of_no_cycle(connection: Connection, keep: StoreSettings) -> None:
    """Delete the picture of one run that ended too long ago, and rows of `audit` and versions of zones that are too old."""
    if keep.picture_hours > 0.0:
        oldest_kept = now_utc(connection, -timedelta(hours=keep.picture_hours))
        has = exists().where(VESSEL.c.run_id == RUN.c.id)
        old = connection.scalar(
            select(func.min(RUN.c.id)).where(RUN.c.status != "running", RUN.c.finished_utc < oldest_kept, has)
        )
        if old is not None:
            for name in ("vessel", "bearing_track"):
                connection.execute(delete(TABLES[name]).where(TABLES[name].c.run_id == old))
            connection.execute(update(CYCLE).where(CYCLE.c.run_id == old).values(picture_kept=False))
    if keep.audit_hours > 0.0:
        oldest_kept_s = _ago_s(connection, keep.audit_hours * 3600.0)
        oldest = select(AUDIT.c.id, AUDIT.c.time_s).order_by(AUDIT.c.id).limit(ROWS)
        changes = [row.id for row in connection.execute(oldest) if row.time_s < oldest_kept_s]
        connection.execute(delete(AUDIT).where(AUDIT.c.id <= max(changes, default=-1), AUDIT.c.time_s < oldest_kept_s))
        newer = ZONE.alias()
        has_newer = exists().where(newer.c.number == ZONE.c.number, newer.c.version > ZONE.c.version)
        connection.execute(delete(ZONE).where(ZONE.c.changed_s < oldest_kept_s, has_newer))


def _ago_s(connection: Connection, seconds: float) -> float:
    """So many seconds before now, by the clock of the database."""
    return datetime.fromisoformat(now_utc(connection, -timedelta(seconds=seconds))).timestamp()


def delete_ended(connection: Connection, run_id: int, keep: StoreSettings) -> int:
    """Delete a part of the oldest run that has ended: of its history after `history_hours`, of all of it when nothing is to be kept.

    Only runs whose own settings had a retention go. A run with an alarm that lasts and that nobody has acknowledged stays, without its
    history. Args: run_id: of the run that goes on, and keep: its settings. Returns: rows deleted.
    """
    if behind := left_behind(connection):
        return delete_part(connection, behind[0])[0]
    has_cycle = exists().where(CYCLE.c.run_id == RUN.c.id)
    has_alarm = exists().where(EVENT.c.run_id == RUN.c.id, EVENT.c.to_cycle.is_(None), text("event.unacknowledged"))
    limited = RUN.c.settings[("store", "history_hours")].as_float() > 0.0
    ended_utc = func.coalesce(RUN.c.finished_utc, RUN.c.written_utc, RUN.c.started_utc)
    for kept_s, condition, part in (
        (keep.history_hours * 3600.0 or None, has_cycle, _delete_ended_history),
        (longest_kept_s(keep), ~has_alarm, _delete_ended_run),
    ):
        if kept_s is not None:
            silent = ended_utc < now_utc(connection, -timedelta(seconds=kept_s))
            query = select(RUN.c.id, RUN.c.status, RUN.c.machine, RUN.c.process).where(
                RUN.c.id != run_id, *is_there(), silent, limited, condition
            )
            for row in connection.execute(query.order_by(RUN.c.id).limit(FEW)).all():
                if row.status != "running" or presence(row.machine, row.process) is not Presence.HERE:
                    return part(connection, row.id)
    return 0


def _delete_ended_history(connection: Connection, run_id: int) -> int:
    """Delete the rows of the oldest cycles of a run, then the rows of `cycle`. Returns: rows."""
    low = connection.scalar(select(func.min(CYCLE.c.number)).where(CYCLE.c.run_id == run_id)) or 0
    high = low + CYCLES
    connection.execute(delete(CHECKPOINT).where(CHECKPOINT.c.run_id == run_id))
    gone = update(CYCLE).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= low, CYCLE.c.number < high)
    connection.execute(gone.values(NOT_KEPT["history"] | NOT_KEPT["details"]))
    paths = HISTORY, DECIDED_PATH
    rows = [delete_some(connection, table, run_id, ("cycle", "vessel_id"), high, ROWS) for table in paths]
    rows += [delete_some(connection, TABLES[name], run_id, ("cycle",), high, ROWS) for name in (*DETAILS, "track_journal")]
    rows += [delete_some(connection, table, run_id, ("to_cycle",), high, ROWS) for table in STAYS]
    recorded = delete_recording(connection, run_id, high, RECORDED_CYCLES)
    if max(rows) < ROWS and not recorded:
        rows.append(delete_some(connection, CYCLE, run_id, ("number",), high, ROWS))
    return sum(rows)


def _delete_ended_run(connection: Connection, run_id: int) -> int:
    """Mark a run as being deleted, and delete a part of it. Returns: rows."""
    mark_deleting(connection, RUN.c.id == run_id)
    return delete_part(connection, run_id)[0]


def prune(store: Store, older_s: float, kinds: Collection[str] = (), on_part: OnPart = no_progress) -> Pruned:
    """Delete at once what is older than so many seconds, beside a run that goes on.

    Args: kinds: of KINDS; none: runs that ended so long ago, by the clock of the database, and OF_RUNS of all others. The age of
    what is in a run is counted from its newest cycle. on_part: called while runs are deleted.
    Raises: StoreError.
    """
    pruned = Pruned()
    if not kinds:
        with reading(store) as connection:
            oldest_kept = now_utc(connection, -timedelta(seconds=older_s))
        listed = runs(store)
        names = ("id", "status", "finished_utc", "written_utc", "started_utc")
        for number, status, *instants in zip(*(listed.column(name) for name in names), strict=True):
            if status not in ("running", DELETING) and next(filter(None, instants)) < oldest_kept:
                pruned.runs.append(number)
        delete_runs(store, pruned.runs, on_part)
    wanted = kinds or OF_RUNS
    listed = runs(store)
    for run_id in (
        number for number, status in zip(listed.column("id"), listed.column("status"), strict=True) if status != DELETING
    ):
        of_run = CYCLE.c.run_id == run_id
        with reading(store) as connection:
            newest_s = connection.scalar(select(func.max(CYCLE.c.time_s)).where(of_run)) or 0.0
            first = connection.scalar(select(func.min(CYCLE.c.number)).where(of_run, CYCLE.c.time_s >= newest_s - older_s)) or 0
        for kind in (one for one in OF_RUNS if one in wanted):
            pruned.rows[kind] = pruned.rows.get(kind, 0) + _prune_run(store, run_id, first, kind)
    if "audit" in wanted:
        with writing(store) as connection:
            pruned.rows["audit"] = connection.execute(
                delete(AUDIT).where(AUDIT.c.time_s < _ago_s(connection, older_s))
            ).rowcount
    return pruned


def _prune_run(store: Store, run_id: int, first: int, kind: str) -> int:
    """Delete one kind before a cycle, in transactions of a second or less. Returns: rows, of a recording cycles."""
    total, last = 0, -1
    while first > 0 and last != 0:
        with writing(store) as connection:
            if kind == "recording":
                last = delete_recording(connection, run_id, first, PRUNED_RECORDINGS)
            else:
                last = _delete_before(connection, run_id, kind, 0, first, PRUNED_ROWS)
            if kind == "events" and not last:
                gone = ~exists().where(same_event(EVENT, ACKNOWLEDGEMENT))
                connection.execute(delete(ACKNOWLEDGEMENT).where(ACKNOWLEDGEMENT.c.run_id == run_id, gone))
        total += last
    return total
