"""Pictures as they are read, column by column: of now, of the past from the points of the history, or from the full recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Connection, and_, or_, select, true

from coastwatch.batches import Array, Ints
from coastwatch.store.box import Box, inside
from coastwatch.store.boxed import newest_in_box
from coastwatch.store.collect import among, collected, loaded
from coastwatch.store.columns import motion
from coastwatch.store.history_rule import newest, reckoned
from coastwatch.store.places import vessels_near
from coastwatch.store.replay import read_cycle
from coastwatch.store.rows import Table
from coastwatch.store.tables import Cycle, History, Vessel
from coastwatch.store.told import STATIC, since_of, sources_of, statics_of

MOTION = ("latitude_deg", "longitude_deg", "sog_kn", "cog_deg")
ELLIPSE = ("major_m", "minor_m", "orientation_deg")
COLUMNS = (
    *("vessel_id", *MOTION, "mmsi", *STATIC, "flags"),
    *("time_s", "since_s", "updated_s", *ELLIPSE, "sources"),
)
"""Of every picture."""

Columns = dict[str, Array]

FEW = 5000
"""Vessels of a box that are found by their numbers; for more the rows of the whole picture are looked at."""


def picture_now(
    connection: Connection, run_id: int, bbox: Box | None, wanted: Sequence[str] = COLUMNS, vessel_id: int | None = None
) -> Table:
    """The current picture. Args: wanted: of COLUMNS; vessel_id: only this one."""
    names = [name for name in COLUMNS if name not in STATIC and (name in wanted or name in ("vessel_id", "mmsi"))]
    here = true() if vessel_id is None else Vessel.vessel_id == vessel_id
    vessels = None if bbox is None else vessels_near(connection, run_id, bbox)
    if vessels is not None and len(vessels) <= FEW:
        here = among(connection, Vessel.vessel_id, vessels)
    query = select(*(getattr(Vessel, name) for name in names)).where(Vessel.run_id == run_id, _inside(bbox), here)
    most = most_vessels(connection, run_id)
    likely = most if bbox is None and vessel_id is None else 0
    return _table(connection, run_id, None, _sorted(names, collected(connection, query, most, likely=likely)), wanted)


def most_vessels(connection: Connection, run_id: int) -> int:
    """Of the current picture."""
    written = select(Cycle.vessels).where(Cycle.run_id == run_id, Cycle.picture_kept)
    return connection.scalar(written.order_by(Cycle.number.desc()).limit(1)) or 0


def picture_then(
    connection: Connection,
    run_id: int,
    cycle: int,
    bbox: Box | None,
    wanted: Sequence[str] = COLUMNS,
    vessel_id: int | None = None,
) -> Table:
    """The picture of a cycle: as it was recorded, or each vessel where course and speed of its newest point took it.

    Args: cycle: recorded, or with a history; wanted: of COLUMNS; vessel_id: only this one, from the history.
    """
    then = select(Cycle.time_s, Cycle.history_from, Cycle.recorded).where(Cycle.run_id == run_id, Cycle.number == cycle)
    time_s, first, recorded = connection.execute(then).one()
    if recorded and vessel_id is None:
        return _table(connection, run_id, cycle, _recorded(connection, run_id, cycle, bbox), wanted)
    assert first is not None
    span = select(Cycle.time_s, Cycle.history_points).where(Cycle.run_id == run_id, Cycle.number.between(first, cycle))
    at_s, points = np.array(connection.execute(span.order_by(Cycle.number)).all(), float).T
    names = ["vessel_id", "cycle", *MOTION, "closing", "mmsi"]
    names += [name for name in ("flags", "updated_s", *ELLIPSE) if name in wanted]
    found = None if bbox is None else newest_in_box(connection, run_id, first, cycle, at_s, bbox, names)
    if found is None:
        found = _newest_points(connection, run_id, first, cycle, int(points.sum()), names, vessel_id)
    place = np.stack([found["latitude_deg"], found["longitude_deg"]], 1)
    now = reckoned(place, found["sog_kn"], found["cog_deg"], time_s - at_s[found["cycle"] - first])
    found |= {"latitude_deg": now[:, 0], "longitude_deg": now[:, 1], "time_s": np.full(len(now), time_s)}
    if bbox is not None:
        here = inside(now, bbox)
        found = {name: column[here] for name, column in found.items()}
    return _table(connection, run_id, cycle, found, wanted)


def _recorded(connection: Connection, run_id: int, cycle: int, bbox: Box | None) -> Columns:
    picture, _ = read_cycle(connection, run_id, cycle, bbox)
    moving = motion(picture.velocity_m_s, picture.covariance).moving
    own = {name: getattr(picture, name) for name in ("vessel_id", "mmsi", "flags", "time_s", "since_s", "updated_s")}
    place = dict(zip(MOTION, (*picture.position_deg.T, *moving[:, :2].T), strict=True))
    return {**own, **place, **dict(zip(ELLIPSE, moving[:, 2:].T, strict=True))}


def _newest_points(
    connection: Connection, run_id: int, first: int, cycle: int, most: int, names: Sequence[str], vessel_id: int | None
) -> Columns:
    """The newest point from one cycle to another of each vessel that is then there, by vessel. Args: most: points in these cycles."""
    cycles: Any = History.cycle.between(first, cycle)
    if vessel_id is not None:  # the key is sought in each cycle; a range of cycles would be read from end to end
        most, cycles = cycle - first + 1, and_(History.cycle.in_(range(first, cycle + 1)), History.vessel_id == vessel_id)
    query = select(*(getattr(History, name) for name in names)).where(History.run_id == run_id, cycles)
    found = dict(zip(names, collected(connection, query, most), strict=True))
    rows = _newest(found["vessel_id"], found["cycle"], found["closing"] != 0)
    return {name: column[rows] for name, column in found.items()}


def _newest(vessel: Ints, cycle: Ints, closing: Array) -> Array:
    """The same as history_rule.newest, by compiled code where that is there."""
    if not loaded():
        return newest(vessel, cycle, closing)
    from coastwatch.kernels.tables.latest_per_id import newest_rows

    rows = np.empty(len(vessel), np.int64)
    rows = rows[: newest_rows(vessel, cycle, rows)]
    rows = rows[~closing[rows]]
    in_order = (np.diff(vessel[rows]) > 0).all()
    return rows if in_order else rows[np.argsort(vessel[rows], kind="stable")]


def _inside(bbox: Box | None) -> Any:
    if bbox is None:
        return true()
    south, west, north, east = bbox
    after, before = Vessel.longitude_deg >= west, Vessel.longitude_deg <= east
    return and_(Vessel.latitude_deg.between(south, north), and_(after, before) if west <= east else or_(after, before))


def _sorted(names: Sequence[str], found: Sequence[Array]) -> Columns:
    vessel = found[0]
    if (np.diff(vessel) > 0).all():
        return dict(zip(names, found, strict=True))
    order = np.argsort(vessel, kind="stable")
    return {name: column[order] for name, column in zip(names, found, strict=True)}


def _table(connection: Connection, run_id: int, cycle: int | None, found: Columns, wanted: Sequence[str]) -> Table:
    """What is wanted of the columns, and what is told beside them. Args: cycle: None: now."""
    if set(STATIC) & set(wanted):
        found = found | statics_of(connection, run_id, found["mmsi"])
    if cycle is not None and "since_s" in wanted and "since_s" not in found:
        found = found | {"since_s": since_of(connection, run_id, cycle, found["vessel_id"])}
    if cycle is not None and "sources" in wanted:
        found = found | {"sources": sources_of(connection, run_id, cycle, found["vessel_id"])}
    return Table(tuple(wanted), tuple(found[name] for name in wanted))
