"""What is stored, as rows of plain values. Each function sees one state of the database: whole cycles only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, Executable, Select, and_, func, or_, select
from sqlalchemy.orm import aliased

from coastwatch.store.box import Box
from coastwatch.store.opening import Store, StoreError, reading
from coastwatch.store.past import points_between, points_of
from coastwatch.store.pictures import COLUMNS, picture_now, picture_then
from coastwatch.store.rows import Rows, Table, fetched
from coastwatch.store.runs import cycle_at, run_exists
from coastwatch.store.tables import (
    Association,
    BearingAssociation,
    BearingTrack,
    Cycle,
    MemberHistory,
    Presence,
    Sensor,
    Source,
)

INSTANTS = ("time_s", "since_s", "updated_s", "start_s", "from_s", "to_s", "first_s", "last_s", "heard_s")
"""Columns that hold an instant, seconds since 1970 UTC; any other column in `_s` is a length of time."""


def sensors(store: Store, run_id: int) -> Rows:
    """The sensors of a run; `spec` is a dict."""
    columns = [c for c in Sensor.__table__.columns if c.name != "run_id"]
    return _ask(store, select(*columns).where(Sensor.run_id == run_id).order_by(Sensor.kind, Sensor.number))


def sources(store: Store, run_id: int) -> Rows:
    """Who makes tracks in a run: number, name, kind (radar, ais, bearing)."""
    return _ask(store, select(Source.number, Source.name, Source.kind).where(Source.run_id == run_id).order_by(Source.number))


def bearing_tracks(store: Store, run_id: int) -> Rows:
    """The bearing tracks of now with the sensor they are of and the vessel they were given to."""
    b = BearingTrack
    columns = (b.track_id, Source.name.label("source"), b.bearing_deg, b.rate_deg_s, b.latitude_deg, b.longitude_deg)
    same = and_(Source.run_id == b.run_id, Source.number == b.source)
    query = select(*columns, b.vessel_id, b.updated_s).join(Source, same).where(b.run_id == run_id)
    return _ask(store, query.order_by(b.source, b.track_id))


def picture(
    store: Store, run_id: int, at_s: float | None = None, bbox: Box | None = None, columns: Sequence[str] = COLUMNS
) -> Table:
    """One row a vessel, by vessel_id: now; or in the last cycle up to an instant, exactly where that cycle was recorded, else
    dead-reckoned within `store.history_error_m`.

    Args: at_s: seconds since 1970 UTC; bbox: south, west, north, east in degrees, west > east crosses the antimeridian; columns: those
    that are wanted, in this order; names, sources and `since_s` cost as much as all others.
    Raises: StoreError where there is no such run or column, or nothing is stored so early.
    """
    unknown = sorted(set(columns) - set(COLUMNS))
    if unknown:
        raise StoreError(f"columns: got {', '.join(unknown)}, needed some of {', '.join(COLUMNS)}")
    with reading(store) as connection:
        run_exists(connection, store, run_id)
        if at_s is None:
            return picture_now(connection, run_id, bbox, columns)
        kept = or_(Cycle.history_from.is_not(None), Cycle.recorded)
        cycle = cycle_at(connection, store, run_id, at_s, kept)
        return picture_then(connection, run_id, cycle, bbox, columns)


def track(store: Store, run_id: int, vessel_id: int) -> dict[str, Any]:
    """One vessel: `vessel` (its newest row as a dict), Table `history` (its points), and Rows `members`, `stays`, `associations`,
    `bearing_associations`, oldest first.

    Raises: StoreError where the run never had such a vessel.
    """
    stays = select(Presence.from_cycle, Presence.to_cycle, Presence.since_s)
    stays = stays.where(Presence.run_id == run_id, Presence.vessel_id == vessel_id).order_by(Presence.from_cycle)
    with reading(store) as connection:
        there = fetched(connection, stays)
        if not there.rows:
            run_exists(connection, store, run_id)
            raise StoreError(f"{store.where}: run {run_id} never had a vessel {vessel_id}")
        return {
            "vessel": _newest_row(connection, run_id, vessel_id, there),
            "history": points_of(connection, run_id, vessel_id),
            "members": fetched(connection, _members(run_id, vessel_id)),
            "stays": there,
            "associations": fetched(connection, _through_time(Association, run_id, vessel_id)),
            "bearing_associations": fetched(connection, _through_time(BearingAssociation, run_id, vessel_id)),
        }


def history(
    store: Store, run_id: int, from_s: float | None = None, to_s: float | None = None, vessel_id: int | None = None
) -> Table:
    """Every point between two instants, both included, of one vessel where one is given: cycle, time_s, vessel_id, position, motion,
    ellipse, updated_s, mmsi, flags. Until its next point a vessel goes on at the course and speed of the last one.
    """
    span = [Cycle.run_id == run_id]
    span += [] if from_s is None else [Cycle.time_s >= from_s]
    span += [] if to_s is None else [Cycle.time_s <= to_s]
    with reading(store) as connection:
        first, last = connection.execute(select(func.min(Cycle.number), func.max(Cycle.number)).where(*span)).one()
        if first is None:
            return points_between(connection, run_id, 0, -1)
        if vessel_id is None:
            return points_between(connection, run_id, first, last)
        found = points_of(connection, run_id, vessel_id, int(first))
    here = (found.array("cycle") >= first) & (found.array("cycle") <= last)
    return Table(found.columns, tuple(column[here] for column in found.arrays))


def _members(run_id: int, vessel_id: int) -> Select[*tuple[Any, ...]]:
    m, first, last = MemberHistory, Cycle.__table__.alias("first"), Cycle.__table__.alias("last")
    columns = (Source.name.label("source"), Source.kind, m.track_id, m.from_cycle, m.to_cycle)
    query = select(*columns, first.c.time_s.label("from_s"), last.c.time_s.label("to_s")).select_from(m)
    query = query.join(Source, and_(Source.run_id == m.run_id, Source.number == m.source))
    query = query.join(first, and_(first.c.run_id == m.run_id, first.c.number == m.from_cycle))
    query = query.outerjoin(last, and_(last.c.run_id == m.run_id, last.c.number == m.to_cycle))
    return query.where(m.run_id == run_id, m.vessel_id == vessel_id).order_by(m.from_cycle, m.source, m.track_id)


def _through_time(table: Any, run_id: int, vessel_id: int) -> Select[*tuple[Any, ...]]:
    """The rows of one vessel by seeking the key (run, cycle, vessel) in each cycle of its stays.

    The cycles are an IN list and not a join, which SQLite's planner now and then turns into a scan of the large table.
    """
    stay = and_(Presence.run_id == Cycle.run_id, Presence.vessel_id == vessel_id, Presence.from_cycle <= Cycle.number)
    lasts = or_(Presence.to_cycle.is_(None), Presence.to_cycle >= Cycle.number)
    there = select(Cycle.number).join(Presence, and_(stay, lasts)).where(Cycle.run_id == run_id, Cycle.associations_kept)
    columns = [c for c in table.__table__.columns if c.name not in ("run_id", "cycle", "vessel_id")]
    then = aliased(Cycle)
    query = select(table.cycle, then.time_s, *columns).join(then, and_(then.run_id == table.run_id, then.number == table.cycle))
    key = (table.run_id == run_id, table.cycle.in_(there), table.vessel_id == vessel_id)
    return query.where(*key).order_by(table.cycle)


def _newest_row(connection: Connection, run_id: int, vessel_id: int, stays: Rows) -> dict[str, Any]:
    """The row of the current picture, or for a vessel that has left it that of the last cycle in which it was there."""
    _, to_cycle, since_s = stays.rows[-1]
    if to_cycle is None:
        now = picture_now(connection, run_id, None, vessel_id=vessel_id)
        if len(now):
            return {**dict(zip(now.columns, now.rows[0], strict=True)), "in_picture": True}
    last = select(func.max(Cycle.number)).where(Cycle.run_id == run_id, Cycle.history_from.is_not(None))
    cycle = connection.scalar(last if to_cycle is None else last.where(Cycle.number == to_cycle))
    then = Rows((), []) if cycle is None else picture_then(connection, run_id, cycle, None, vessel_id=vessel_id)
    found = dict(zip(then.columns, then.rows[0], strict=True)) if then.rows else {"vessel_id": vessel_id, "since_s": since_s}
    return {**found, "in_picture": to_cycle is None}


def _ask(store: Store, query: Executable) -> Rows:
    with reading(store) as connection:
        return fetched(connection, query)
