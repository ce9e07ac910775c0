"""Who acknowledged which alarm. The row is written once and never changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import ColumnElement, Connection, and_, exists, func, insert, literal, select, text, update

from coastwatch.store.schema.database import Store, reading, writing
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, EVENT, EVENT_KEY, same_event

SAME_START_S = 0.0006
"""Starts of events are given to the millisecond."""

CLOCKS_APART_S = 300.0
"""How far the clocks of servers on one database may differ: acknowledgements that are so much older than the newest may be new."""


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


class Seen(NamedTuple):
    """Up to where the acknowledgements of a run were read."""

    from_s: float = 0.0  # Unix time; those of before are known
    known: int = 0  # how many there were of that time or later


class Beginnings(NamedTuple):
    """Alarms by when they began."""

    kinds: Sequence[str]
    subject: int | None  # number of the zone or id of the other vessel; none: any
    first_s: float
    last_s: float


def acknowledge(store: Store, run_id: int, alarm: AlarmKey, by: Acknowledgement) -> bool:
    """Acknowledge an alarm, if nobody has. Returns: whether it is stored. Raises: StoreError."""
    condition = and_(EVENT.c.run_id == run_id, is_alarm(alarm))
    with writing(store) as connection:
        _acknowledge(connection, condition, by)
        return connection.scalar(select(EVENT.c.from_cycle).where(condition)) is not None


def is_alarm(key: AlarmKey) -> ColumnElement[bool]:
    """That an event is this alarm of its run."""
    e = EVENT.c
    starts = e.start_s.between(key.start_s - SAME_START_S, key.start_s + SAME_START_S)
    return and_(e.vessel_id == key.vessel_id, e.kind == key.kind, e.subject == key.subject, starts)


def acknowledge_all(store: Store, run_id: int, alarms: Beginnings, by: Acknowledgement) -> int:
    """Acknowledge, in one transaction, each of these alarms that nobody has. Returns: how many. Raises: StoreError."""
    e = EVENT.c
    starts = e.start_s.between(alarms.first_s - SAME_START_S, alarms.last_s + SAME_START_S)
    conditions = [e.run_id == run_id, e.kind.in_(alarms.kinds), starts]
    if alarms.subject is not None:
        conditions.append(e.subject == alarms.subject)
    with writing(store) as connection:
        return _acknowledge(connection, and_(*conditions), by)


def acknowledged_since(store: Store, run_id: int, seen: Seen) -> tuple[list[tuple[AlarmKey, Acknowledgement]], Seen]:
    """The acknowledgements of a run that may be new since the last look, by any server, and up to where that is. Raises: StoreError."""
    a, e = ACKNOWLEDGEMENT.c, EVENT.c
    since = and_(a.run_id == run_id, a.acknowledged_s >= seen.from_s)
    with reading(store) as connection:
        count = connection.scalar(select(func.count()).select_from(ACKNOWLEDGEMENT).where(since)) or 0
        if count == seen.known:  # most looks: of the index alone
            return [], seen
        columns = [e.vessel_id, e.kind, e.subject, e.start_s, a.acknowledged_s, a.acknowledged_by, a.note, a.who]
        joined = ACKNOWLEDGEMENT.join(EVENT, same_event(ACKNOWLEDGEMENT, EVENT))
        rows = connection.execute(select(*columns).select_from(joined).where(since)).all()
        newest_s = connection.scalar(select(func.max(a.acknowledged_s)).where(since)) or 0.0
        from_s = max(seen.from_s, newest_s - CLOCKS_APART_S)
        known = connection.scalar(select(func.count()).where(a.run_id == run_id, a.acknowledged_s >= from_s)) or 0
    return [(AlarmKey(*row[:4]), Acknowledgement(*row[4:])) for row in rows], Seen(from_s, known)


def _acknowledge(connection: Connection, condition: ColumnElement[bool], by: Acknowledgement) -> int:
    """Acknowledge the alarms of a condition that nobody has. Returns: how many."""
    e = EVENT.c
    waits = and_(condition, text("event.unacknowledged"))
    values = [literal(value) for value in (by.at_s, by.name, by.note, by.who)]
    has_one = exists().where(same_event(ACKNOWLEDGEMENT, EVENT))  # of an alarm that was found again
    events = select(*(e[name] for name in EVENT_KEY), *values).where(waits, ~has_one)
    columns = *EVENT_KEY, "acknowledged_s", "acknowledged_by", "note", "who"
    connection.execute(insert(ACKNOWLEDGEMENT).from_select(columns, events))
    return connection.execute(update(EVENT).where(waits).values(unacknowledged=False)).rowcount
