"""Pictures of the past: the newest points up to a cycle, dead-reckoned to it (history_rule)."""

from __future__ import annotations

from typing import Any

import numpy as np
from sqlalchemy import Connection, Select, Subquery, and_, false, func, or_, select, true

from coastwatch.batches import Floats
from coastwatch.store.history_rule import reckoned
from coastwatch.store.rows import Box, Rows, fetched, picture_columns, same_mmsi
from coastwatch.store.tables import Cycle, History, MemberHistory, Presence, Source, VesselStatic


def picture_then(connection: Connection, run_id: int, cycle: int, bbox: Box | None, vessel_id: int | None = None) -> Rows:
    """One row a vessel as it was in a cycle of which the history is kept: at its newest point's course and speed from there.

    Args: vessel_id: only this one.
    """
    there = select(Cycle.history_from, Cycle.time_s).where(Cycle.run_id == run_id, Cycle.number == cycle)
    first, time_s = connection.execute(there).one()
    assert first is not None
    points = _with_sources(connection, run_id, cycle, fetched(connection, _query(run_id, first, cycle, vessel_id)))
    place = np.array([points.column(name) for name in ("latitude_deg", "longitude_deg")], float).reshape(2, -1).T
    speed, course, at_s = (np.array(points.column(name), float) for name in ("sog_kn", "cog_deg", "time_s"))
    now = reckoned(place, speed, course, time_s - at_s)
    names, kept = points.columns, np.flatnonzero(_inside(now, bbox)).tolist()
    column = {name: k for k, name in enumerate(names)}
    made = []
    for k in kept:
        row = list(points.rows[k])
        row[column["latitude_deg"]], row[column["longitude_deg"]] = now[k].tolist()
        row[column["time_s"]] = time_s
        made.append(tuple(row))
    return Rows(names, made)


def newest_points(run_id: int, first: int, cycle: int) -> Subquery:
    """Vessel and cycle of the newest point of each vessel in a range of cycles, closing ones included."""
    here = select(History.vessel_id, func.max(History.cycle).label("cycle"))
    return here.where(History.run_id == run_id, History.cycle.between(first, cycle)).group_by(History.vessel_id).subquery()


def of_newest(run_id: int, newest: Subquery) -> Any:
    """What joins the rows of `history` to `newest_points`: of vessels that have not left."""
    same = and_(History.cycle == newest.c.cycle, History.vessel_id == newest.c.vessel_id)
    return and_(History.run_id == run_id, same, History.closing == false())


def _query(run_id: int, first: int, cycle: int, vessel_id: int | None) -> Select[*tuple[Any, ...]]:
    newest = newest_points(run_id, first, cycle)
    then = and_(Cycle.run_id == run_id, Cycle.number == History.cycle)
    there = and_(Presence.run_id == run_id, Presence.vessel_id == History.vessel_id, holds(Presence, cycle))
    ellipse = (History.major_m, History.minor_m, History.orientation_deg)
    columns = (*picture_columns(History), Cycle.time_s, Presence.since_s, History.updated_s, *ellipse)
    query = select(*columns).select_from(newest).join(History, of_newest(run_id, newest)).join(Cycle, then)
    query = query.outerjoin(Presence, there).outerjoin(VesselStatic, same_mmsi(History))
    return query.where(true() if vessel_id is None else newest.c.vessel_id == vessel_id).order_by(History.vessel_id)


def holds(stay: type[Presence] | type[MemberHistory], cycle: int) -> Any:
    """Whether a stay has a cycle in it."""
    return and_(stay.from_cycle <= cycle, or_(stay.to_cycle.is_(None), stay.to_cycle >= cycle))


def _inside(position_deg: Floats, bbox: Box | None) -> Any:
    if bbox is None:
        return np.ones(len(position_deg), np.bool_)
    south, west, north, east = bbox
    latitude, longitude = position_deg.T
    after, before = longitude >= west, longitude <= east
    return (latitude >= south) & (latitude <= north) & (after & before if west <= east else after | before)


def _with_sources(connection: Connection, run_id: int, cycle: int, rows: Rows) -> Rows:
    """The rows with a last column: names of the sources that each vessel had in a cycle, as `vessel.sources` has them now."""
    same = and_(Source.run_id == MemberHistory.run_id, Source.number == MemberHistory.source)
    query = select(MemberHistory.vessel_id, Source.name).join(Source, same)
    query = query.where(MemberHistory.run_id == run_id, holds(MemberHistory, cycle))
    names: dict[int, dict[str, None]] = {}
    for vessel, name in connection.execute(query.order_by(MemberHistory.vessel_id, Source.number)):
        names.setdefault(vessel, {})[name] = None
    return Rows((*rows.columns, "sources"), [(*row, ",".join(names.get(row[0], ()))) for row in rows.rows])
