"""Who acknowledged which alarm. The row is written once and never changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import ColumnElement, Connection, and_, exists, insert, literal, select, text, update

from coastwatch.store.schema.database import Store, writing
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, EVENT

SAME_START_S = 0.0006
"""Starts of events are given to the millisecond."""


class AlarmKey(NamedTuple):
    """What tells an alarm of a run from the others."""

    vessel_id: int
    kind: str
    subject: int  # number of the zone or id of the other vessel; 0: none
    start_s: float


class Acknowledgement(NamedTuple):
    """Who acknowledged, and when."""

    at_s: float
    name: str  # of the person
    note: str
    who: str  # name of the token that was used


class Beginnings(NamedTuple):
    """Alarms by when they began."""

    kinds: Sequence[str]
    subject: int | None  # number of the zone or id of the other vessel; none: any
    first_s: float
    last_s: float


def acknowledge(store: Store, run_id: int, alarm: AlarmKey, by: Acknowledgement) -> bool:
    """Acknowledge an alarm, if nobody has. Returns: whether it is stored. Raises: StoreError."""
    e = EVENT.c
    starts = e.start_s.between(alarm.start_s - SAME_START_S, alarm.start_s + SAME_START_S)
    of = e.run_id == run_id, e.vessel_id == alarm.vessel_id, e.kind == alarm.kind, e.subject == alarm.subject, starts
    with writing(store) as connection:
        _acknowledge(connection, of, by)
        return connection.scalar(select(e.from_cycle).where(*of)) is not None


def acknowledge_all(store: Store, run_id: int, alarms: Beginnings, by: Acknowledgement) -> int:
    """Acknowledge, in one transaction, each of these alarms that nobody has. Returns: how many. Raises: StoreError."""
    e = EVENT.c
    starts = e.start_s.between(alarms.first_s - SAME_START_S, alarms.last_s + SAME_START_S)
    of = [e.run_id == run_id, e.kind.in_(alarms.kinds), starts]
    if alarms.subject is not None:
        of.append(e.subject == alarms.subject)
    with writing(store) as connection:
        return _acknowledge(connection, of, by)


def _acknowledge(connection: Connection, of: Sequence[ColumnElement[bool]], by: Acknowledgement) -> int:
    """Acknowledge the alarms of a condition that nobody has. Returns: how many."""
    e = EVENT.c
    waits = and_(*of, text("event.unacknowledged"))
    said = [literal(value) for value in (by.at_s, by.name, by.note, by.who)]
    keys = "run_id", "vessel_id", "kind", "subject", "from_cycle"
    has_one = exists().where(*(ACKNOWLEDGEMENT.c[name] == EVENT.c[name] for name in keys))  # of an alarm that was found again
    found = select(*(e[name] for name in keys), *said).where(waits, ~has_one)
    columns = *keys, "acknowledged_s", "acknowledged_by", "note", "who"
    connection.execute(insert(ACKNOWLEDGEMENT).from_select(columns, found))
    return connection.execute(update(EVENT).where(waits).values(unacknowledged=False)).rowcount
