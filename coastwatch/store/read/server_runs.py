"""Which runs of a server hold a time. A server that could not go on with its run has begun another one of the same scenario."""

from __future__ import annotations

from sqlalchemy import ColumnElement, Connection, and_, exists, func, or_, select

from coastwatch.store.runs import SERVER, between, is_there
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import CYCLE, EVENT, RUN

HAS_PICTURE = or_(CYCLE.c.history_from.is_not(None), CYCLE.c.recorded)
"""That the picture of a cycle is kept."""

_OF_RUN = CYCLE.c.run_id == RUN.c.id


def run_at(store: Store, run_id: int, at_s: float) -> int:
    """The newest run of the server up to this one that has a picture of an instant or before; `run_id` where none has.

    A run that no server wrote stands for itself. Raises: StoreError.
    """
    with reading(store) as connection:
        found = _runs(connection, run_id, exists().where(_OF_RUN, HAS_PICTURE, *between(None, at_s)))
    return found[0] if found else run_id


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
        runs = _runs(connection, run_id, exists().where(_OF_RUN, HAS_PICTURE)) or [run_id]
        first_s = connection.scalar(select(func.min(CYCLE.c.time_s)).where(CYCLE.c.run_id == runs[-1], HAS_PICTURE))
    return None if first_s is None else float(first_s)


def _runs(connection: Connection, run_id: int, condition: ColumnElement[bool]) -> list[int]:
    """The runs up to this one, newest first, that a server wrote over its scenario and that meet a condition; if one wrote it."""
    this = RUN.alias()
    same = and_(this.c.id == run_id, this.c.command == SERVER, RUN.c.command == SERVER, RUN.c.scenario == this.c.scenario)
    query = select(RUN.c.id).select_from(RUN.join(this, same)).where(RUN.c.id <= run_id, *is_there(), condition)
    return list(connection.scalars(query.order_by(RUN.c.id.desc())))
