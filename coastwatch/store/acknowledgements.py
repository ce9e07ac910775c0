"""Who acknowledged which alarm. The row is written once and never changed."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import and_, exists, insert, select

from coastwatch.store.read.rows import Rows, fetch_rows
from coastwatch.store.schema.database import Store, reading, writing
from coastwatch.store.schema.tables import ACKNOWLEDGEMENT, EVENT

SAME_START_S = 0.0006
"""Starts of events are given to the millisecond."""


def acknowledge(
    store: Store, run_id: int, event: tuple[int, str, int, float], *, at_s: float, name: str, note: str, who: str
) -> bool:
    """Acknowledge an event, if nobody has. Returns: whether there is such an event.

    Args: event: vessel, kind, subject and start, s; at_s: now; name: of the person; who: of the token.
    Raises: StoreError.
    """
    vessel_id, kind, subject, start_s = event
    e, a = EVENT.c, ACKNOWLEDGEMENT.c
    which = select(e.from_cycle).where(e.run_id == run_id, e.vessel_id == vessel_id, e.kind == kind, e.subject == subject)
    which = which.where(e.start_s.between(start_s - SAME_START_S, start_s + SAME_START_S))
    with writing(store) as connection:
        from_cycle = connection.scalar(which)
        if from_cycle is None:
            return False
        key = {"run_id": run_id, "vessel_id": vessel_id, "kind": kind, "subject": subject, "from_cycle": from_cycle}
        known = select(a.acknowledged_s).where(*(a[column] == value for column, value in key.items()))
        if connection.scalar(known) is None:
            row = {**key, "acknowledged_s": at_s, "acknowledged_by": name, "note": note, "who": who}
            connection.execute(insert(ACKNOWLEDGEMENT).values(row))
    return True


def acknowledge_all(
    store: Store,
    run_id: int,
    kinds: Sequence[str],
    subject: int | None,
    began_s: tuple[float, float],
    *,
    at_s: float,
    name: str,
    note: str,
    who: str,
) -> int:
    """Acknowledge, in one transaction, every event of these kinds that nobody has acknowledged. Returns: how many.

    Args: subject: number of the zone or id of the other vessel; none: any; began_s: first and last start; the others as of `acknowledge`.
    Raises: StoreError.
    """
    e, a = EVENT.c, ACKNOWLEDGEMENT.c
    same = [e[column] == a[column] for column in ("run_id", "vessel_id", "kind", "subject", "from_cycle")]
    query = select(e.vessel_id, e.kind, e.subject, e.from_cycle).where(
        e.run_id == run_id, e.kind.in_(kinds), ~exists().where(*same)
    )
    query = query.where(e.start_s.between(began_s[0] - SAME_START_S, began_s[1] + SAME_START_S))
    if subject is not None:
        query = query.where(e.subject == subject)
    said = {"run_id": run_id, "acknowledged_s": at_s, "acknowledged_by": name, "note": note, "who": who}
    with writing(store) as connection:
        rows = [{**row._mapping, **said} for row in connection.execute(query)]
        if rows:
            connection.execute(insert(ACKNOWLEDGEMENT), rows)
    return len(rows)


def acknowledgements(store: Store, run_id: int) -> Rows:
    """The acknowledged events of a run: vessel_id, kind, subject, start_s, acknowledged_by, acknowledged_s, note, who."""
    e, a = EVENT.c, ACKNOWLEDGEMENT.c
    same = and_(*(e[name] == a[name] for name in ("run_id", "vessel_id", "kind", "subject", "from_cycle")))
    query = select(a.vessel_id, a.kind, a.subject, e.start_s, a.acknowledged_by, a.acknowledged_s, a.note, a.who)
    query = query.join(EVENT, same)
    with reading(store) as connection:
        return fetch_rows(connection, query.where(a.run_id == run_id).order_by(a.acknowledged_s))
