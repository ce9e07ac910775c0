"""What is stored, as rows of plain values. Each function sees one state of the database: whole cycles only."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import Connection, Executable, Select, and_, false, func, or_, select, true
from sqlalchemy.orm import aliased

from coastwatch.store.opening import Store, StoreError, reading
from coastwatch.store.past import picture_then
from coastwatch.store.rows import Box, Rows, fetched, picture_columns, same_mmsi
from coastwatch.store.tables import (
    Association,
    BearingAssociation,
    BearingTrack,
    Cycle,
    History,
    MemberHistory,
    Presence,
    Run,
    Sensor,
    Source,
    StageTiming,
    Vessel,
    VesselStatic,
)

INSTANTS = ("time_s", "since_s", "updated_s", "start_s", "from_s", "to_s", "first_s", "last_s", "heard_s")
"""Columns that hold an instant, seconds since 1970 UTC; any other column in `_s` is a length of time."""

OF_THE_RULE = ("previous_cycle", "closing")
"""Columns of `history` by which points are found."""


def runs(store: Store) -> Rows:
    """Every run, newest first, without its settings and scores."""
    stored = select(Cycle.run_id, func.count().label("done")).group_by(Cycle.run_id).subquery()
    columns = (
        Run.id,
        Run.scenario,
        Run.title,
        Run.seed,
        Run.version,
        Run.status,
        Run.started_utc,
        Run.finished_utc,
        Run.workers,
    )
    query = select(*columns, func.coalesce(stored.c.done, 0).label("cycles_stored"), Run.cycles, Run.period_s, Run.start_s)
    return _ask(store, query.outerjoin(stored, stored.c.run_id == Run.id).order_by(Run.id.desc()))


def run(store: Store, run_id: int) -> dict[str, Any]:
    """One run with settings, scores and faults. Raises: StoreError where there is none."""
    found = _ask(store, select(*Run.__table__.columns).where(Run.id == run_id))
    if not found.rows:
        raise StoreError(f"{store.where}: there is no run {run_id}")
    return dict(zip(found.columns, found.rows[0], strict=True))


def latest_run(store: Store, scenario: str | None = None) -> int:
    """The number of the newest run (of a scenario). Raises: StoreError where there is none."""
    query = select(func.max(Run.id))
    found = _ask(store, query if scenario is None else query.where(Run.scenario == scenario)).rows[0][0]
    if found is None:
        raise StoreError(f"{store.where}: holds no run" + (f" of {scenario}" if scenario else ""))
    return int(found)


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


def picture(store: Store, run_id: int, at_s: float | None = None, bbox: Box | None = None) -> Rows:
    """One row a vessel: now, or in the last cycle up to an instant, then dead-reckoned within `store.history_error_m`.

    Args: at_s: seconds since 1970 UTC; bbox: south, west, north, east in degrees, west > east crosses the antimeridian.
    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    with reading(store) as connection:
        _run_exists(connection, store, run_id)
        if at_s is None:
            return fetched(connection, _current(run_id, bbox))
        cycle = cycle_at(connection, store, run_id, at_s, Cycle.history_from.is_not(None))
        return picture_then(connection, run_id, cycle, bbox)


def track(store: Store, run_id: int, vessel_id: int) -> dict[str, Any]:
    """One vessel: `vessel` (its newest row as a dict), and Rows `history` (its points), `members`, `stays`, `associations`,
    `bearing_associations`, oldest first.

    Raises: StoreError where the run never had such a vessel.
    """
    stays = select(Presence.from_cycle, Presence.to_cycle, Presence.since_s)
    stays = stays.where(Presence.run_id == run_id, Presence.vessel_id == vessel_id).order_by(Presence.from_cycle)
    with reading(store) as connection:
        there = fetched(connection, stays)
        if not there.rows:
            _run_exists(connection, store, run_id)
            raise StoreError(f"{store.where}: run {run_id} never had a vessel {vessel_id}")
        past = fetched(connection, _through_time(History, run_id, vessel_id).where(History.closing == false()))
        now = fetched(connection, _current(run_id, None).where(Vessel.vessel_id == vessel_id))
        return {
            "vessel": _newest_row(connection, run_id, vessel_id, now, there),
            "history": past,
            "members": fetched(connection, _members(run_id, vessel_id)),
            "stays": there,
            "associations": fetched(connection, _through_time(Association, run_id, vessel_id)),
            "bearing_associations": fetched(connection, _through_time(BearingAssociation, run_id, vessel_id)),
        }


def history(store: Store, run_id: int, from_s: float | None = None, to_s: float | None = None) -> Rows:
    """Every point between two instants, both included: cycle, time_s, vessel_id, position, motion, flags."""
    columns = [c for c in History.__table__.columns if c.name not in ("run_id", "cycle", *OF_THE_RULE)]
    span = [Cycle.run_id == run_id]
    span += [] if from_s is None else [Cycle.time_s >= from_s]
    span += [] if to_s is None else [Cycle.time_s <= to_s]
    same = and_(History.run_id == Cycle.run_id, History.cycle == Cycle.number)
    query = select(Cycle.number.label("cycle"), Cycle.time_s, *columns).join(History, same)
    return _ask(store, query.where(*span, History.closing == false()).order_by(Cycle.number, History.vessel_id))


def timings(store: Store, run_id: int) -> Rows:
    """For each stage, in the order in which they ran: cycles, milliseconds (median, p99, longest, total), share and rows a cycle."""
    query = select(StageTiming.stage, StageTiming.number, StageTiming.seconds, StageTiming.rows)
    stored = _ask(store, query.where(StageTiming.run_id == run_id).order_by(StageTiming.cycle, StageTiming.number)).rows
    by_stage: dict[str, list[tuple[Any, ...]]] = {}
    for row in stored:
        by_stage.setdefault(row[0], []).append(row)
    everything = sum(row[2] for row in stored) or 1.0
    out = []
    for stage, rows in sorted(by_stage.items(), key=lambda item: max(row[1] for row in item[1])):
        ms = np.array([row[2] for row in rows]) * 1e3
        yielded = [row[3] for row in rows if row[3] is not None]
        figures = (np.median(ms), np.percentile(ms, 99), ms.max(), ms.sum(), ms.sum() / 1e3 / everything)
        out.append((stage, len(rows), *(float(x) for x in figures), sum(yielded) / len(yielded) if yielded else None))
    return Rows(("stage", "cycles", "median_ms", "p99_ms", "longest_ms", "total_ms", "share", "rows"), out)


def cycle_at(connection: Connection, store: Store, run_id: int, at_s: float | None, kept: Any = true()) -> int:  # noqa: B008
    """The newest cycle (of those that are kept) up to an instant; -1 where no instant is asked and there is none.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    _run_exists(connection, store, run_id)
    before = true() if at_s is None else Cycle.time_s <= at_s
    cycle = connection.scalar(select(func.max(Cycle.number)).where(Cycle.run_id == run_id, kept, before))
    if cycle is None and at_s is not None:
        first_s = connection.scalar(select(func.min(Cycle.time_s)).where(Cycle.run_id == run_id, kept))
        has = "it has no cycle yet" if first_s is None else f"its first kept cycle is at {_utc(first_s)}"
        raise StoreError(f"{store.where}: run {run_id} holds nothing up to {_utc(at_s)}, {has}")
    return -1 if cycle is None else int(cycle)


def _utc(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")


def _run_exists(connection: Connection, store: Store, run_id: int) -> None:
    if connection.scalar(select(Run.id).where(Run.id == run_id)) is None:
        raise StoreError(f"{store.where}: there is no run {run_id}")


def _inside(bbox: Box | None) -> Any:
    if bbox is None:
        return true()
    south, west, north, east = bbox
    after, before = Vessel.longitude_deg >= west, Vessel.longitude_deg <= east
    return and_(Vessel.latitude_deg.between(south, north), and_(after, before) if west <= east else or_(after, before))


def _current(run_id: int, bbox: Box | None) -> Select[*tuple[Any, ...]]:
    ellipse = (Vessel.major_m, Vessel.minor_m, Vessel.orientation_deg)
    columns = (*picture_columns(Vessel), Vessel.time_s, Vessel.since_s, Vessel.updated_s, *ellipse, Vessel.sources)
    query = select(*columns).outerjoin(VesselStatic, same_mmsi(Vessel))
    return query.where(Vessel.run_id == run_id, _inside(bbox)).order_by(Vessel.vessel_id)


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
    there = select(Cycle.number).join(Presence, and_(stay, lasts)).where(Cycle.run_id == run_id)
    columns = [c for c in table.__table__.columns if c.name not in ("run_id", "cycle", "vessel_id", *OF_THE_RULE)]
    then = aliased(Cycle)
    query = select(table.cycle, then.time_s, *columns).join(then, and_(then.run_id == table.run_id, then.number == table.cycle))
    key = (table.run_id == run_id, table.cycle.in_(there), table.vessel_id == vessel_id)
    return query.where(*key).order_by(table.cycle)


def _newest_row(connection: Connection, run_id: int, vessel_id: int, now: Rows, stays: Rows) -> dict[str, Any]:
    """The row of the current picture, or for a vessel that has left it that of the last cycle in which it was there."""
    _, to_cycle, since_s = stays.rows[-1]
    if now.rows and to_cycle is None:
        return {**dict(zip(now.columns, now.rows[0], strict=True)), "in_picture": True}
    last = select(func.max(Cycle.number)).where(Cycle.run_id == run_id, Cycle.history_from.is_not(None))
    cycle = connection.scalar(last if to_cycle is None else last.where(Cycle.number == to_cycle))
    then = Rows((), []) if cycle is None else picture_then(connection, run_id, cycle, None, vessel_id)
    found = dict(zip(then.columns, then.rows[0], strict=True)) if then.rows else {"vessel_id": vessel_id, "since_s": since_s}
    return {**found, "in_picture": to_cycle is None}


def _ask(store: Store, query: Executable) -> Rows:
    with reading(store) as connection:
        return fetched(connection, query)
