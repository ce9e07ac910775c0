"""What is older than it is to be kept, deleted a little in every cycle, so that no cycle is held up. 0 hours: kept for ever.

| setting | forgotten |
|---|---|
| `history_hours` | points, and stays of vessels, their tracks and their MMSI that ended before; no pictures of so early |
| `details_hours` | associations, spots, timings and registrations |
| `recording_hours` | recorded cycles, whole key cycles at a time |
| `picture_hours` | the current picture of runs that ended so long ago by the database's clock |

Rows of `cycle` and `run` stay. An SQLite file does not shrink: what becomes free is used again.
"""

from __future__ import annotations

import math
from datetime import timedelta
from typing import TYPE_CHECKING, Any, NamedTuple

from sqlalchemy import Connection, Table, delete, func, select, update

from coastwatch.store.blocks import forget_blocks
from coastwatch.store.chunks_table import forget_chunks
from coastwatch.store.tables import Base, Cycle, Run
from coastwatch.store.utc import utc

if TYPE_CHECKING:
    from coastwatch.scenario import StoreSettings

TABLES = Base.metadata.tables
STAYS = ("presence", "member_history", "identity")
DETAILS = ("association", "bearing_association", "spot", "stage_timing", "sensor_registration")

ROWS = 10_000
"""Deleted of a table in a cycle beside twice as many as it got: what was kept too long is worked off at that rate."""

RECORDED_CYCLES = 2
"""Recorded cycles that are deleted in a cycle."""

CYCLES = 1000
"""Cycles that one cycle may mark as forgotten."""

LOOK_EVERY = 100
"""Cycles between two looks for runs that ended long ago."""


class Forgotten(NamedTuple):
    """The first cycle of which something is kept."""

    history: int
    details: int


def known(connection: Connection, run_id: int) -> Forgotten:
    """What the database says."""
    first = func.coalesce(func.min(Cycle.number), 0)
    history = connection.scalar(select(first).where(Cycle.run_id == run_id, Cycle.history_from.is_not(None)))
    timed = TABLES["stage_timing"].c
    details = connection.scalar(select(func.coalesce(func.min(timed.cycle), 0)).where(timed.run_id == run_id))
    return Forgotten(int(history or 0), int(details or 0))


def forget(
    connection: Connection, run_id: int, number: int, period_s: float, keep: StoreSettings, before: Forgotten, written: int
) -> Forgotten:
    """Delete a little of what is too old. Args: number: of this cycle; written: rows that it added."""
    most = ROWS + 2 * written
    history = _first_kept(number, period_s, keep.history_hours, before.history)
    if history > before.history:
        _mark(connection, run_id, before.history, history, {"history_from": None})
    if history > 0:
        _forget_history(connection, run_id, history, most)
    details = _first_kept(number, period_s, keep.details_hours, before.details)
    if details > before.details:
        _mark(connection, run_id, before.details, details, {"associations_kept": False})
    if details > 0:
        for name in DETAILS:
            _some(connection, TABLES[name], run_id, ("cycle",), details, most)
    if keep.recording_hours > 0.0:
        forget_chunks(connection, run_id, number + 1 - math.ceil(keep.recording_hours * 3600.0 / period_s), RECORDED_CYCLES)
    if keep.picture_hours > 0.0 and number % LOOK_EVERY == 0:
        _forget_pictures(connection, keep.picture_hours)
    return Forgotten(history, details)


def _first_kept(number: int, period_s: float, hours: float, before: int) -> int:
    """The first cycle that is kept: not many more are forgotten than were."""
    if hours == 0.0:
        return before
    return max(min(number + 1 - math.ceil(hours * 3600.0 / period_s), before + CYCLES), before)


def _mark(connection: Connection, run_id: int, low: int, high: int, values: dict[str, Any]) -> None:
    where = (Cycle.run_id == run_id, Cycle.number >= low, Cycle.number < high)
    connection.execute(update(Cycle).where(*where).values(values))


def _forget_history(connection: Connection, run_id: int, kept: int, most: int) -> None:
    """The points before those of the first kept cycle: some of these stand before it."""
    first = connection.scalar(select(Cycle.history_from).where(Cycle.run_id == run_id, Cycle.number == kept))
    if first is not None:
        _some(connection, TABLES["history"], run_id, ("cycle", "vessel_id"), first, most)
        forget_blocks(connection, run_id, before_cycle=first)
    for name in STAYS:
        _some(connection, TABLES[name], run_id, ("to_cycle",), kept, most)


def _some(connection: Connection, table: Table, run_id: int, key: tuple[str, ...], below: int, most: int) -> None:
    """Delete about so many rows whose first key is below a cycle, the lowest first; each statement deletes one stretch of an index."""
    columns = [table.c[name] for name in key]
    old = (table.c.run_id == run_id, columns[0] < below)
    last = connection.execute(select(*columns).where(*old).order_by(*columns).offset(most - 1).limit(1)).first()
    if last is None:
        connection.execute(delete(table).where(*old))
        return
    connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] < last[0]))
    upto = [column <= value for column, value in zip(columns[1:], last[1:], strict=True)]
    connection.execute(delete(table).where(table.c.run_id == run_id, columns[0] == last[0], *upto))


def _forget_pictures(connection: Connection, hours: float) -> None:
    """One run whose picture is too old, if there is one."""
    then = utc(connection, -timedelta(hours=hours))
    vessel = TABLES["vessel"]
    has = select(vessel.c.run_id).where(vessel.c.run_id == Run.id).exists()
    old = connection.scalar(select(func.min(Run.id)).where(Run.status != "running", Run.finished_utc < then, has))
    if old is not None:
        for name in ("vessel", "vessel_place", "bearing_track"):
            connection.execute(delete(TABLES[name]).where(TABLES[name].c.run_id == old))
        connection.execute(update(Cycle).where(Cycle.run_id == old).values(picture_kept=False))
