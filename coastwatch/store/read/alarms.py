"""Alarms of a run: those that are asked for, and what has changed since the last look. The most urgent come first, then the newest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Connection,
    Select,
    SelectBase,
    Table,
    and_,
    case,
    func,
    literal_column,
    or_,
    select,
    text,
    union,
)

from coastwatch.batches import ALARM_KINDS
from coastwatch.batches.kinds import PRIORITIES, SUSPICION
from coastwatch.store.acknowledgements import AlarmKey, is_alarm
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.runs import is_there, newest_cycle
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, EVENT, EVENT_GAP, EVENT_KEY, RUN, VESSEL_STATIC, same_event

E, A = EVENT.c, ACKNOWLEDGEMENT.c
UNACKNOWLEDGED = and_(text("event.unacknowledged"), E.start_s >= 0.0)
"""As the index of such events has it: with a parameter, or without the time, SQLite would not use it."""

State = Literal["all", "lasting", "unacknowledged", "waiting"]


@dataclass(frozen=True)
class Asked:
    """Which alarms are asked for."""

    state: State = "all"  # waiting: lasting or not acknowledged
    kinds: Sequence[str] = ALARM_KINDS
    from_s: float | None = None  # that held then or later; none: any
    to_s: float | None = None  # that began then or earlier; none: any
    key: AlarmKey | None = None  # this one alone
    limit: int = 1000
    offset: int = 0


class Cursor(NamedTuple):
    """Up to where changes of alarms were read."""

    process: int | None  # that wrote the run: another one may have begun at an older cycle
    cycle: int  # the newest one
    time_s: float  # of that cycle
    acknowledged_s: float  # of the newest acknowledgement
    acknowledged: int  # how many are of that instant: 200,000 may be, of one change


def alarms(store: Store, run_id: int, asked: Asked) -> tuple[Rows, int]:
    """Some alarms of a run, and how many there are. Raises: StoreError."""
    query = _select(_waiting(run_id) if asked.state == "waiting" else ())
    query = query.where(E.run_id == run_id, *_conditions(asked))
    with reading(store) as connection:
        total = connection.scalar(select(func.count()).select_from(query.order_by(None).subquery())) or 0
        return fetch_rows(connection, query.order_by(*_ORDER).limit(asked.limit).offset(asked.offset)), int(total)


def changed_alarms(store: Store, run_id: int, since: Cursor | None, most: int) -> tuple[Rows, Cursor]:
    """The alarms that have begun, ended, returned or been acknowledged since the last look, and up to where that is.

    Args: since: none: those that last, all of them, and those that wait for acknowledgement; most: of these, the most urgent.
    Raises: StoreError.
    """
    with reading(store) as connection:
        now = _cursor(connection, run_id)
        if since is None:
            return _lasting_and_waiting(connection, run_id, _waiting(run_id)[:1], E.to_cycle.is_not(None), most), now
        if now == since:  # most looks of a server that follows a database
            return Rows((), []), now
        changed = _select(_changed(run_id, since, now)).where(E.kind.in_(ALARM_KINDS))
        return fetch_rows(connection, changed.order_by(E.start_s)), now


def alarms_before(store: Store, run_id: int, time_s: float, most: int) -> Rows:
    """The alarms that began up to an instant, and lasted then, all of them, or had ended and wait for acknowledgement.

    Args: most: of those that had ended, the most urgent. Raises: StoreError.
    """
    lasted = [*_waiting(run_id)[:1], _keys(EVENT, run_id, and_(E.end_s >= time_s, E.to_cycle.is_not(None)))]
    with reading(store) as connection:
        return _lasting_and_waiting(connection, run_id, lasted, E.end_s < time_s, most, E.start_s <= time_s)


def _lasting_and_waiting(
    connection: Connection,
    run_id: int,
    lasting: Sequence[SelectBase],
    ended: ColumnElement[bool],
    most: int,
    *began: ColumnElement[bool],
) -> Rows:
    """All alarms that last, then the most urgent of those that have ended and wait for acknowledgement.

    Args: lasting: keys of those that last; ended, began: conditions on the others, and on both.
    """
    alarm = and_(E.kind.in_(ALARM_KINDS), *began)
    columns, rows = fetch_rows(connection, _select(lasting).where(alarm).order_by(*_ORDER))
    waiting = _select(_waiting(run_id)[1:]).where(alarm, ended).order_by(*_ORDER).limit(most)
    return Rows(columns, rows + fetch_rows(connection, waiting).rows)


def _cursor(connection: Connection, run_id: int) -> Cursor:
    number, time_s = newest_cycle(connection, run_id) or (-1, -1.0)
    process = connection.scalar(select(RUN.c.process).where(RUN.c.id == run_id))
    acknowledged_s = connection.scalar(select(func.max(A.acknowledged_s)).where(A.run_id == run_id))
    newest_ones = select(func.count()).where(A.run_id == run_id, A.acknowledged_s == acknowledged_s)
    return Cursor(process, number, time_s, acknowledged_s or 0.0, int(connection.scalar(newest_ones) or 0))


def _changed(run_id: int, since: Cursor, now: Cursor) -> list[SelectBase]:
    """The keys of what has changed between two cursors, each part by an index."""
    keys = [
        _keys(EVENT, run_id, E.start_s > since.time_s),
        _keys(EVENT, run_id, E.to_cycle >= since.cycle),
        _keys(EVENT_GAP, run_id, EVENT_GAP.c.cycle > since.cycle),
    ]
    # Acknowledgements of one instant may have been written after the last look: if there are new ones, those of its instant come again.
    if (since.acknowledged_s, since.acknowledged) != (now.acknowledged_s, now.acknowledged):
        keys.append(_keys(ACKNOWLEDGEMENT, run_id, A.acknowledged_s >= since.acknowledged_s))
    return keys


def left_unacknowledged(store: Store, run_id: int) -> tuple[int, int] | None:
    """The run before this one of its scenario, and how many of its alarms nobody has acknowledged; none: there is none with any.

    Raises: StoreError.
    """
    scenario = select(RUN.c.scenario).where(RUN.c.id == run_id).scalar_subquery()
    with reading(store) as connection:
        of_before = RUN.c.id < run_id, RUN.c.scenario == scenario, *is_there()
        before = connection.scalar(select(func.max(RUN.c.id)).where(*of_before))
        count = 0
        if before is not None:
            count = connection.scalar(select(func.count()).select_from(EVENT).where(E.run_id == before, UNACKNOWLEDGED)) or 0
    return (before, count) if count else None


def _waiting(run_id: int) -> list[SelectBase]:
    """The keys of what lasts, and of what nobody has acknowledged, each part by an index."""
    return [_keys(EVENT, run_id, E.to_cycle.is_(None)), _keys(EVENT, run_id, UNACKNOWLEDGED)]


def _keys(table: Table, run_id: int, where: ColumnElement[bool]) -> SelectBase:
    return select(*(table.c[name] for name in EVENT_KEY)).where(table.c.run_id == run_id, where)


def _conditions(asked: Asked) -> list[ColumnElement[bool]]:
    conditions: list[ColumnElement[bool]] = []
    if asked.state != "unacknowledged" or tuple(asked.kinds) != tuple(ALARM_KINDS):  # what waits is an alarm
        conditions.append(E.kind.in_(asked.kinds))
    if asked.state == "lasting":
        conditions.append(E.to_cycle.is_(None))
    elif asked.state == "unacknowledged":
        conditions.append(UNACKNOWLEDGED)
    if asked.from_s is not None:
        conditions.append(or_(E.end_s.is_(None), E.end_s >= asked.from_s))
    if asked.to_s is not None:
        conditions.append(E.start_s <= asked.to_s)
    if asked.key is not None:
        conditions.append(is_alarm(asked.key))
    return conditions


def _select(parts: Sequence[SelectBase] = ()) -> Select[*tuple[Any, ...]]:
    """Columns of an alarm: what it is, from when until when, its vessel at its start, and who acknowledged it.

    Args: parts: keys of the alarms that are wanted; none: of every one.
    """
    s = VESSEL_STATIC.c
    gaps = select(func.count()).select_from(EVENT_GAP).where(same_event(EVENT, EVENT_GAP)).scalar_subquery()
    query = select(E.vessel_id, E.kind, E.subject, E.start_s, E.end_s, gaps.label("gaps"), E.mmsi, s.name, E.latitude_deg)
    query = query.add_columns(E.longitude_deg, E.sog_kn, E.evidence, A.acknowledged_by, A.acknowledged_s, A.note)
    joined = EVENT.outerjoin(VESSEL_STATIC, and_(s.run_id == E.run_id, s.mmsi == E.mmsi))
    query = query.select_from(joined.outerjoin(ACKNOWLEDGEMENT, same_event(EVENT, ACKNOWLEDGEMENT)))
    if not parts:
        return query
    keys = union(*parts).subquery()
    return query.join(keys, same_event(EVENT, keys))


_PRIORITY = case(
    *((E.kind.in_([kind for kind, of in PRIORITIES.items() if of == priority]), literal_column(str(priority)))
      for priority in sorted(set(PRIORITIES.values()) - {SUSPICION})),
    else_=literal_column(str(SUSPICION)),
)  # fmt: skip
_ORDER = (_PRIORITY, E.start_s.desc(), E.vessel_id, E.kind, E.subject)
