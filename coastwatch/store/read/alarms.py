"""Alarms of a run: those that are asked for, and what has changed since the last look. The most urgent come first, then the newest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from sqlalchemy import CompoundSelect, Connection, Select, and_, case, func, literal_column, or_, select, text, true, union

from coastwatch.batches import ALARM_KINDS
from coastwatch.batches.kinds import PRIORITIES, SUSPICION
from coastwatch.store.acknowledgements import SAME_START_S, AlarmKey
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, CYCLE, EVENT, EVENT_GAP, RUN, VESSEL_STATIC

E, A = EVENT.c, ACKNOWLEDGEMENT.c
KEY = ("run_id", "vessel_id", "kind", "subject", "from_cycle")
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
    found = _in_keys(_select(), union(*_waiting(run_id))) if asked.state == "waiting" else _select()
    found = found.where(E.run_id == run_id, *_conditions(asked))
    with reading(store) as connection:
        total = connection.scalar(select(func.count()).select_from(found.order_by(None).subquery())) or 0
        return fetch_rows(connection, found.order_by(*_ORDER).limit(asked.limit).offset(asked.offset)), int(total)


def changed_alarms(store: Store, run_id: int, since: Cursor | None, most: int) -> tuple[Rows, Cursor]:
    """The alarms that have begun, ended, returned or been acknowledged since the last look, and up to where that is.

    Args: since: none: those that last, all of them, and those that wait for acknowledgement; most: of these, the most urgent.
    Raises: StoreError.
    """
    with reading(store) as connection:
        now = _cursor(connection, run_id)
        if since is None:
            return _lasting_and_waiting(connection, run_id, [_lasting(run_id)], E.to_cycle.is_not(None), most), now
        changed = _in_keys(_select(), union(*_changed(run_id, since, now))).where(E.kind.in_(ALARM_KINDS))
        return fetch_rows(connection, changed.order_by(E.start_s)), now


def alarms_before(store: Store, run_id: int, time_s: float, most: int) -> Rows:
    """The alarms that began up to an instant, and lasted then, all of them, or had ended and wait for acknowledgement.

    Args: most: of those that had ended, the most urgent. Raises: StoreError.
    """
    lasted = [_lasting(run_id), _keys(E, E.run_id == run_id, E.end_s >= time_s, E.to_cycle.is_not(None))]
    with reading(store) as connection:
        return _lasting_and_waiting(connection, run_id, lasted, E.end_s < time_s, most, E.start_s <= time_s)


def _lasting_and_waiting(
    connection: Connection,
    run_id: int,
    lasting: Sequence[Select[Any]],
    ended: Any,
    most: int,
    began: Any = true(),  # noqa: B008
) -> Rows:
    """All alarms that last, then the most urgent of those that have ended and wait for acknowledgement.

    Args: lasting: keys of those that last; ended, began: conditions on the others, and on both.
    """
    alarm = E.kind.in_(ALARM_KINDS), began
    columns, rows = fetch_rows(connection, _in_keys(_select(), union(*lasting)).where(*alarm).order_by(*_ORDER))
    waiting = _in_keys(_select(), union(_unacknowledged(run_id))).where(*alarm, ended).order_by(*_ORDER).limit(most)
    return Rows(columns, rows + fetch_rows(connection, waiting).rows)


def _cursor(connection: Connection, run_id: int) -> Cursor:
    c = CYCLE.c
    newest = select(c.number, c.time_s).where(c.run_id == run_id).order_by(c.number.desc()).limit(1)
    number, time_s = connection.execute(newest).first() or (-1, -1.0)
    process = connection.scalar(select(RUN.c.process).where(RUN.c.id == run_id))
    acknowledged_s = connection.scalar(select(func.max(A.acknowledged_s)).where(A.run_id == run_id))
    newest_ones = select(func.count()).where(A.run_id == run_id, A.acknowledged_s == acknowledged_s)
    return Cursor(process, number, time_s, acknowledged_s or 0.0, int(connection.scalar(newest_ones) or 0))


def _changed(run_id: int, since: Cursor, now: Cursor) -> list[Select[Any]]:
    """The keys of what has changed between two cursors, each part by an index."""
    g = EVENT_GAP.c
    out = [
        _keys(E, E.run_id == run_id, E.start_s > since.time_s),
        _keys(E, E.run_id == run_id, E.to_cycle >= since.cycle),
        _keys(g, g.run_id == run_id, g.cycle > since.cycle),
    ]
    # Acknowledgements of one instant may have been written after the last look: if there are new ones, those of its instant come again.
    if (since.acknowledged_s, since.acknowledged) != (now.acknowledged_s, now.acknowledged):
        out.append(_keys(A, A.run_id == run_id, A.acknowledged_s >= since.acknowledged_s))
    return out


def _waiting(run_id: int) -> list[Select[Any]]:
    """The keys of what lasts or nobody has acknowledged, each part by an index."""
    return [_lasting(run_id), _unacknowledged(run_id)]


def _lasting(run_id: int) -> Select[Any]:
    return _keys(E, E.run_id == run_id, E.to_cycle.is_(None))


def _unacknowledged(run_id: int) -> Select[Any]:
    return _keys(E, E.run_id == run_id, UNACKNOWLEDGED)


def _keys(of: Any, *where: Any) -> Select[Any]:
    return select(*(of[name] for name in KEY)).where(*where)


def _in_keys(query: Select[Any], keys: CompoundSelect[Any]) -> Select[Any]:
    """The events of these keys."""
    found = keys.subquery()
    return query.join(found, and_(*(E[name] == found.c[name] for name in KEY)))


def _conditions(asked: Asked) -> list[Any]:
    out: list[Any] = []
    if asked.state != "unacknowledged" or tuple(asked.kinds) != tuple(ALARM_KINDS):  # what waits is an alarm
        out.append(E.kind.in_(asked.kinds))
    if asked.state == "lasting":
        out.append(E.to_cycle.is_(None))
    elif asked.state == "unacknowledged":
        out.append(UNACKNOWLEDGED)
    if asked.from_s is not None:
        out.append(or_(E.end_s.is_(None), E.end_s >= asked.from_s))
    if asked.to_s is not None:
        out.append(E.start_s <= asked.to_s)
    if asked.key is not None:
        vessel_id, kind, subject, start_s = asked.key
        out += [E.vessel_id == vessel_id, E.kind == kind, E.subject == subject]
        out.append(E.start_s.between(start_s - SAME_START_S, start_s + SAME_START_S))
    return out


def _select() -> Select[Any]:
    """Columns of an alarm: what it is, from when until when, its vessel at its start, and who acknowledged it."""
    g, s = EVENT_GAP.c, VESSEL_STATIC.c
    gaps = select(func.count()).select_from(EVENT_GAP).where(*(E[name] == g[name] for name in KEY)).scalar_subquery()
    of_event = E.vessel_id, E.kind, E.subject, E.start_s, E.end_s, gaps.label("gaps"), E.mmsi, s.name
    of_vessel = E.latitude_deg, E.longitude_deg, E.sog_kn, E.evidence
    by = A.acknowledged_by, A.acknowledged_s, A.note
    joined = EVENT.outerjoin(VESSEL_STATIC, and_(s.run_id == E.run_id, s.mmsi == E.mmsi))
    joined = joined.outerjoin(ACKNOWLEDGEMENT, and_(*(E[name] == A[name] for name in KEY)))
    return select(*of_event, *of_vessel, *by).select_from(joined)


_PRIORITY = case(
    *((E.kind.in_([kind for kind, of in PRIORITIES.items() if of == priority]), literal_column(str(priority)))
      for priority in sorted(set(PRIORITIES.values()) - {SUSPICION})),
    else_=literal_column(str(SUSPICION)),
)  # fmt: skip
_ORDER = (_PRIORITY, E.start_s.desc(), E.vessel_id, E.kind, E.subject)
