"""Which runs of a server hold a time. A server that could not go on with its run has begun another one of the same scenario."""

from __future__ import annotations

from sqlalchemy import ColumnElement, Connection, and_, exists, func, or_, select

from coastwatch.store.runs import SERVER, between, is_there
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import CYCLE, EVENT, HISTORY, RECORDING, RUN

HAS_PICTURE = or_(CYCLE.c.history_from.is_not(None), CYCLE.c.recorded)
"""That the picture of a cycle is kept."""

_OF_RUN = CYCLE.c.run_id == RUN.c.id


def run_at(store: Store, run_id: int, at_s: float) -> int:
    """The newest run of the server up to this one that has a picture of an instant or before; `run_id` where none has.

    A run that no server wrote stands for itself. Raises: StoreError.
    """
    with reading(store) as connection:
        for number in _runs(connection, run_id):
            first_s = _first_instant(connection, number)
            if first_s is not None and first_s <= at_s:
                return number
    return run_id


def runs_between(store: Store, run_id: int, from_s: float | None, to_s: float | None) -> list[int]:
    """The runs of the server up to this one that have cycles or events between two instants, newest first. None: without that end.

    `run_id` where none has, and where no server wrote it. Raises: StoreError.
    """
    e = EVENT.c
    # What lasts, lasts while the run has cycles.
    lasts = [] if from_s is None else [or_(e.start_s >= from_s, and_(e.to_cycle.is_not(None), e.end_s >= from_s))]
    begins = [] if to_s is None else [e.start_s <= to_s]
    has_cycle = exists().where(_OF_RUN, *between(from_s, to_s))
    has_event = exists().where(e.run_id == RUN.c.id, *lasts, *begins)
    with reading(store) as connection:
        return _runs(connection, run_id, or_(has_cycle, has_event)) or [run_id]


def first_instant(store: Store, run_id: int) -> float | None:
    """When the oldest picture is of that the runs of the server up to this one have; None: there is none. Raises: StoreError."""
    with reading(store) as connection:
        firsts = [_first_instant(connection, number) for number in reversed(_runs(connection, run_id) or [run_id])]
    return next((first_s for first_s in firsts if first_s is not None), None)


def _first_instant(connection: Connection, run_id: int) -> float | None:
    """When the oldest picture of a run is of that is kept; None: there is none."""
    oldest = [
        connection.scalar(select(func.min(table.c.cycle)).where(table.c.run_id == run_id)) for table in (HISTORY, RECORDING)
    ]
    kept = [cycle for cycle in oldest if cycle is not None]
    if not kept:
        return None
    c = CYCLE.c  # most cycles before the oldest that is kept have no picture: they are not looked at
    first = select(c.time_s).where(c.run_id == run_id, c.number >= min(kept), HAS_PICTURE).order_by(c.number).limit(1)
    return connection.scalar(first)


def _runs(connection: Connection, run_id: int, *conditions: ColumnElement[bool]) -> list[int]:
    """The runs up to this one, newest first, that a server wrote over its scenario and that meet conditions; if one wrote it."""
    this = RUN.alias()
    same = and_(this.c.id == run_id, this.c.command == SERVER, RUN.c.command == SERVER, RUN.c.scenario == this.c.scenario)
    query = select(RUN.c.id).select_from(RUN.join(this, same)).where(RUN.c.id <= run_id, *is_there(), *conditions)
    return list(connection.scalars(query.order_by(RUN.c.id.desc())))
