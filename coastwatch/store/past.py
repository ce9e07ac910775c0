"""The points of the history: all between two instants, those of one vessel, and the newest of each vessel up to a cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Connection, Subquery, and_, false, func, or_, select, text

from coastwatch.batches import Array
from coastwatch.store.collect import among, collected
from coastwatch.store.rows import Table
from coastwatch.store.tables import Cycle, History, Presence

MOVED = (
    "latitude_deg",
    "longitude_deg",
    "sog_kn",
    "cog_deg",
    "major_m",
    "minor_m",
    "orientation_deg",
    "updated_s",
    "mmsi",
    "flags",
)
COLUMNS = ("cycle", "time_s", "vessel_id", *MOVED)
"""Of a history."""

CHAIN = """
WITH RECURSIVE start (cycle) AS (VALUES {starts}), back (cycle) AS (
    SELECT CAST(s.cycle AS BIGINT) FROM start s
    UNION
    SELECT h.previous_cycle
    FROM back b CROSS JOIN history h
    WHERE h.run_id = :run AND h.cycle = b.cycle AND h.vessel_id = :vessel AND h.previous_cycle >= :first
)
SELECT cycle FROM back
"""


def points_between(connection: Connection, run_id: int, first: int, last: int) -> Table:
    """The points of a range of cycles, by cycle and vessel; no closing ones."""
    of_run = and_(Cycle.run_id == run_id, Cycle.number.between(first, last))
    points = connection.scalar(select(func.coalesce(func.sum(Cycle.history_points), 0)).where(of_run))
    where = (History.run_id == run_id, History.cycle.between(first, last))
    return _table(connection, run_id, where, int(points or 0))


def points_of(connection: Connection, run_id: int, vessel_id: int, first: int = 0) -> Table:
    """The points of one vessel from a cycle on, oldest first; no closing ones.

    Each point names the cycle of the one before it: the key (run, cycle, vessel) is sought once a point, from the newest one of each
    stay back to its first. Rows of schema 0003 and older name none, there it is sought in every cycle of the stay.
    """
    here, since = Presence.run_id == run_id, or_(Presence.to_cycle.is_(None), Presence.to_cycle >= first)
    stays = select(Presence.from_cycle, Presence.to_cycle).where(here, Presence.vessel_id == vessel_id, since)
    spans = [(max(row.from_cycle, first), row.to_cycle) for row in connection.execute(stays.order_by(Presence.from_cycle))]
    starts = [to + 1 for _, to in spans if to is not None]
    if spans and spans[-1][1] is None:
        starts += _last_cycles(connection, run_id)
    chain = _chain(connection, run_id, vessel_id, starts, first)
    cycles = sorted({*chain, *_unnamed(connection, run_id, spans, chain)})
    where = (History.run_id == run_id, among(connection, History.cycle, np.array(cycles, np.int64)))
    return _table(connection, run_id, (*where, History.vessel_id == vessel_id), len(cycles))


def newest_points(run_id: int, first: int, cycle: int) -> Subquery:
    """Vessel and cycle of the newest point of each vessel in a range of cycles, closing ones included."""
    here = select(History.vessel_id, func.max(History.cycle).label("cycle"))
    return here.where(History.run_id == run_id, History.cycle.between(first, cycle)).group_by(History.vessel_id).subquery()


def of_newest(run_id: int, newest: Subquery) -> Any:
    """What joins the rows of `history` to `newest_points`: of vessels that have not left."""
    same = and_(History.cycle == newest.c.cycle, History.vessel_id == newest.c.vessel_id)
    return and_(History.run_id == run_id, same, History.closing == false())


def _table(connection: Connection, run_id: int, where: Sequence[Any], most: int) -> Table:
    names = ("cycle", "vessel_id", *MOVED)
    query = select(*(getattr(History, name) for name in names)).where(*where, History.closing == false())
    found: dict[str, Array] = dict(zip(names, collected(connection, query, most), strict=True))
    order = np.lexsort((found["vessel_id"], found["cycle"]))
    found = {name: column[order] for name, column in found.items()}
    number = found["cycle"]
    found["time_s"] = np.zeros(0)
    if len(number):
        first, last = int(number[0]), int(number[-1])
        span = select(Cycle.number, Cycle.time_s).where(Cycle.run_id == run_id, Cycle.number.between(first, last))
        known, time_s = collected(connection, span, last - first + 1)
        order = np.argsort(known)
        found["time_s"] = time_s[order][np.searchsorted(known[order], number)]
    return Table(COLUMNS, tuple(found[name] for name in COLUMNS))


def _last_cycles(connection: Connection, run_id: int) -> list[int]:
    """In one of these a vessel that is there now has its newest point."""
    kept = select(Cycle.number, Cycle.history_from).where(Cycle.run_id == run_id, Cycle.history_from.is_not(None))
    last = connection.execute(kept.order_by(Cycle.number.desc()).limit(1)).first()
    return [] if last is None else list(range(last.history_from, last.number + 1))


def _chain(connection: Connection, run_id: int, vessel_id: int, starts: Sequence[int], first: int) -> set[int]:
    """The cycles from one on that are reached from others."""
    if not starts:
        return set()
    sql = CHAIN.format(starts=", ".join(f"({cycle})" for cycle in starts))
    return set(connection.scalars(text(sql), {"run": run_id, "vessel": vessel_id, "first": first}))


def _unnamed(connection: Connection, run_id: int, spans: Sequence[Any], chain: set[int]) -> set[int]:
    """The cycles of stays that lie before the first point that is reached."""
    reached = np.array(sorted(chain), np.int64)
    out: set[int] = set()
    for first, last in spans:
        here = reached[(reached >= first) & (reached <= (np.inf if last is None else last + 1))]
        if len(here) and here[0] == first:
            continue
        kept = select(Cycle.number).where(Cycle.run_id == run_id, Cycle.history_from.is_not(None), Cycle.number >= first)
        kept = kept if last is None else kept.where(Cycle.number <= last)
        out |= set(connection.scalars(kept.where(Cycle.number < int(here[0])) if len(here) else kept))
    return out
