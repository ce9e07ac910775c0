"""Pictures: now, at an instant of the past (from the recording, or dead-reckoned from the history), in a box; and one vessel's details."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import ColumnElement, Connection, Executable, Select, Table as SqlTable, and_, func, or_, select

from coastwatch.batches import Array, Floats, Ints
from coastwatch.errors import StoreError
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.bbox import FASTEST_M_S, Box, inside, is_inside, widened
from coastwatch.store.history_rule import dead_reckon, newest_rows
from coastwatch.store.read.history_queries import ELLIPSE, MOTION, cycle_times, points_in_box, points_of
from coastwatch.store.read.server_runs import HAS_PICTURE
from coastwatch.store.recording import read_recorded
from coastwatch.store.rows import Rows, Table, fetch_arrays, fetch_rows, is_one_of, motion, source_texts
from coastwatch.store.runs import cycle_at, run_exists
from coastwatch.store.schema.database import NotThere, Store, reading
from coastwatch.store.schema.tables import (
    ASSOCIATION,
    BEARING_ASSOCIATION,
    BEARING_TRACK,
    CYCLE,
    DECIDED_PATH,
    EVENT,
    EVENT_GAP,
    HISTORY,
    IDENTITY,
    MEMBER_HISTORY,
    PRESENCE,
    RUN,
    SENSOR,
    SOURCE,
    VESSEL,
    VESSEL_STATIC,
    same_event,
)

STATIC = ("name", "call_sign", "ship_type", "length_m", "beam_m")
ECHO = ("echo_length_m", "echo_width_m", "echo_axis_deg")
OWN = ("vessel_id", "mmsi", "nav_status", "flags", "time_s", "since_s", "updated_s", "existence", "alternative_m", *ECHO)
"""Of a recorded picture, as they are in it."""
COLUMNS = (
    "vessel_id",
    *MOTION,
    "mmsi",
    *STATIC,
    "nav_status",
    "flags",
    "time_s",
    "since_s",
    "updated_s",
    *ELLIPSE,
    "existence",
    "alternative_m",
    *ECHO,
    "sources",
)
"""Of every picture; `existence`, `alternative_m` and those of the echo are null in a past one that was not recorded."""

FEW = 1000
"""Up to this many vessels are looked up one by one; for more, whole tables of the run are read."""

LAST_AIS = ("last_ais_mmsi", "last_ais_name", "last_ais_until_s")
Columns = dict[str, Array]


NEWEST_DECIDED = 1000
"""States of the corrected past that `track` answers, at most: one in each look."""


class VesselTrack(NamedTuple):
    """One vessel through time, the oldest first."""

    vessel: dict[str, Any]  # its newest row, whether that is of now (`in_picture`), and its last AIS
    history: Table  # its points
    decided: Rows  # the newest states of its corrected past
    events: Rows
    members: Rows
    stays: Rows
    associations: Rows
    bearing_associations: Rows


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
            here = [] if bbox is None else [is_inside(VESSEL.c.latitude_deg, VESSEL.c.longitude_deg, bbox)]
            return _picture_now(connection, run_id, columns, *here)
        return picture_of_cycle(connection, run_id, cycle_at(connection, store, run_id, at_s, HAS_PICTURE), bbox, columns)


def picture_cycle(store: Store, run_id: int, at_s: float) -> tuple[int, float]:
    """Number and time of the cycle whose picture `picture` answers at an instant. Raises: StoreError as it does."""
    with reading(store) as connection:
        number = cycle_at(connection, store, run_id, at_s, HAS_PICTURE)
        time_s = connection.scalar(select(CYCLE.c.time_s).where(CYCLE.c.run_id == run_id, CYCLE.c.number == number))
    return number, float(time_s or 0.0)


def track(store: Store, run_id: int, vessel_id: int) -> VesselTrack:
    """One vessel of a run. Raises: StoreError where the run never had it."""
    with reading(store) as connection:
        there = _stays(connection, store, run_id, vessel_id)
        history, members = points_of(connection, run_id, vessel_id), fetch_rows(connection, _members(run_id, vessel_id))
        newest = _newest_row(connection, run_id, vessel_id, there)
        return VesselTrack(
            newest | _last_ais(connection, run_id, history, members, is_here=bool(newest["in_picture"])),
            history,
            _decided(connection, run_id, vessel_id, NEWEST_DECIDED),
            fetch_rows(connection, _events(run_id, vessel_id)),
            members,
            there,
            fetch_rows(connection, _rows_of_vessel(ASSOCIATION, run_id, vessel_id)),
            fetch_rows(connection, _rows_of_vessel(BEARING_ASSOCIATION, run_id, vessel_id)),
        )


def _stays(connection: Connection, store: Store, run_id: int, vessel_id: int) -> Rows:
    """When a vessel was in the picture. Raises: StoreError where the run never had it."""
    stays = select(PRESENCE.c.from_cycle, PRESENCE.c.to_cycle, PRESENCE.c.since_s)
    stays = stays.where(PRESENCE.c.run_id == run_id, PRESENCE.c.vessel_id == vessel_id).order_by(PRESENCE.c.from_cycle)
    there = fetch_rows(connection, stays)
    if not there.rows:
        run_exists(connection, store, run_id)
        i = IDENTITY.c
        had = select(i.vessel_id).where(i.run_id == run_id, i.mmsi == vessel_id).distinct().order_by(i.vessel_id)
        vessels = [str(vessel) for vessel in connection.scalars(had)]
        hint = f"it is the MMSI of vessel {', '.join(vessels)}: `coastwatch track {vessels[-1]}`" if vessels else ""
        hint = hint or "`coastwatch picture` lists their ids"
        raise NotThere(f"{store.where}: run {run_id} never had a vessel {vessel_id}; {hint}")
    return there


def bearing_tracks(store: Store, run_id: int) -> Rows:
    """The bearing tracks of now with the sensor they are of and the vessel they were given to."""
    b = BEARING_TRACK.c
    same = and_(SOURCE.c.run_id == b.run_id, SOURCE.c.number == b.source)
    query = select(b.track_id, SOURCE.c.name.label("source"), b.bearing_deg, b.rate_deg_s, b.latitude_deg, b.longitude_deg)
    query = query.add_columns(b.vessel_id, b.updated_s).join(SOURCE, same).where(b.run_id == run_id)
    with reading(store) as connection:
        return fetch_rows(connection, query.order_by(b.source, b.track_id))


def _picture_now(connection: Connection, run_id: int, wanted: Sequence[str], *where: ColumnElement[bool]) -> Table:
    names = [name for name in COLUMNS if name not in STATIC and (name in wanted or name in ("vessel_id", "mmsi"))]
    query = select(*(VESSEL.c[name] for name in names)).where(VESSEL.c.run_id == run_id, *where)
    columns = dict(zip(names, fetch_arrays(connection, query.order_by(VESSEL.c.vessel_id)), strict=True))
    return _with_details(connection, run_id, None, columns, wanted)


def picture_of_cycle(
    connection: Connection,
    run_id: int,
    cycle: int,
    bbox: Box | None,
    wanted: Sequence[str] = COLUMNS,
    vessel_id: int | None = None,
) -> Table:
    """The picture of a cycle: as it was recorded, or each vessel dead-reckoned from its newest point.

    Args: cycle: recorded, or with a history; wanted: of COLUMNS; vessel_id: only this one, from the history.
    """
    query = select(CYCLE.c.time_s, CYCLE.c.history_from, CYCLE.c.recorded).where(
        CYCLE.c.run_id == run_id, CYCLE.c.number == cycle
    )
    time_s, first, recorded = connection.execute(query).one()
    if recorded and vessel_id is None:
        picture, _ = read_recorded(connection, run_id, cycle, bbox)
        kept = {name: getattr(picture, name) for name in OWN}
        moved = motion(picture.velocity_m_s, picture.covariance)
        kept |= zip((*MOTION, *ELLIPSE), (*picture.position_deg.T, *moved.T), strict=True)
        return _with_details(connection, run_id, cycle, kept, wanted)
    assert first is not None
    number, at_s = cycle_times(connection, run_id, first, cycle)
    names = ["vessel_id", "cycle", *MOTION, "closing", "mmsi"]
    names += [name for name in ("nav_status", "flags", "updated_s", *ELLIPSE) if name in wanted]
    near = None if bbox is None else _newest_in_box(connection, run_id, number, at_s, bbox, names)
    columns = _newest_points(connection, run_id, number, names, vessel_id) if near is None else near
    now = dead_reckon(_position(columns), columns["sog_kn"], columns["cog_deg"], time_s - at_s[columns["cycle"] - first])
    columns |= {"latitude_deg": now[:, 0], "longitude_deg": now[:, 1], "time_s": np.full(len(now), time_s)}
    if bbox is not None:
        here = inside(now, bbox)
        columns = {name: column[here] for name, column in columns.items()}
    if "updated_s" in wanted:
        columns["updated_s"] = _heard_by(connection, run_id, cycle, time_s, columns)
    return _with_details(connection, run_id, cycle, columns, wanted)


def _heard_by(connection: Connection, run_id: int, cycle: int, time_s: float, columns: Columns) -> Floats:
    """When each vessel had been heard last by this cycle, or a little later, but not later than this cycle. (V,)

    Its newest point tells how it was up to `store.history_max_s` before. Where its next point says that it was heard after this cycle,
    it may have been heard in it too. So no vessel that was heard is said to be silent, but one that was heard again soon is not found.
    Args: columns: vessel_id and updated_s of its newest point.
    """
    own, h = columns["updated_s"], HISTORY.c
    end = connection.scalar(select(func.min(CYCLE.c.number)).where(CYCLE.c.run_id == run_id, CYCLE.c.history_from > cycle))
    number, _ = cycle_times(connection, run_id, cycle + 1, np.iinfo(np.int32).max if end is None else end)
    v = VESSEL.c
    ours = select(v.vessel_id, v.updated_s).where(v.run_id == run_id)
    if len(own) <= FEW:
        ours = ours.where(is_one_of(connection, v.vessel_id, columns["vessel_id"]))
    if not len(number):  # of the newest cycle, the table of vessels knows
        vessel, heard_s = fetch_arrays(connection, ours.order_by(v.vessel_id))
        row = find(vessel, columns["vessel_id"])
        return np.maximum(np.minimum(np.where(row >= 0, np.append(heard_s, np.nan)[row], own), time_s), own)
    cycles: list[ColumnElement[bool]] = [h.cycle.between(int(number[0]), int(number[-1]))]
    if len(own) <= FEW:
        cycles = [is_one_of(connection, h.cycle, number), is_one_of(connection, h.vessel_id, columns["vessel_id"])]
    points = fetch_arrays(connection, select(h.vessel_id, h.cycle, h.updated_s).where(h.run_id == run_id, *cycles))
    if end is None:  # the run ended, or is here: some have no further point
        now = fetch_arrays(connection, ours)
        points = [
            np.concatenate(pair) for pair in zip(points, (now[0], np.full(len(now[0]), number[-1] + 1), now[1]), strict=True)
        ]
    order = np.lexsort((points[1], points[0]))
    vessel, _, heard_s = (column[order] for column in points)
    first = np.append(True, np.diff(vessel) != 0)[: len(vessel)]
    row = find(vessel[first], columns["vessel_id"])
    then = np.where(row >= 0, np.append(heard_s[first], np.nan)[row], own)
    return np.maximum(np.minimum(then, time_s), own)


def _newest_points(connection: Connection, run_id: int, number: Ints, names: Sequence[str], vessel_id: int | None) -> Columns:
    """The newest point in some cycles of each vessel that is there in the last of them, by vessel."""
    cycles: ColumnElement[bool] = HISTORY.c.cycle.between(int(number[0]), int(number[-1]))
    if vessel_id is not None:  # the key is sought in each cycle; a range of cycles would be read from end to end
        cycles = and_(is_one_of(connection, HISTORY.c.cycle, number), HISTORY.c.vessel_id == vessel_id)
    query = select(*(HISTORY.c[name] for name in names)).where(HISTORY.c.run_id == run_id, cycles)
    return _newest_of_each(dict(zip(names, fetch_arrays(connection, query), strict=True)))


def _newest_in_box(
    connection: Connection, run_id: int, number: Ints, at_s: Floats, bbox: Box, names: Sequence[str]
) -> Columns | None:
    """As `_newest_points`, of the vessels that are in a box then, and of some beside it; None where they are too many.

    A vessel whose newest point is far from the box is not taken from an older point near it.
    """
    reach = widened(bbox, (at_s[-1] - at_s[0]) * FASTEST_M_S)
    columns = _newest_of_each(points_in_box(connection, run_id, int(number[0]), int(number[-1]), reach, names))
    now = dead_reckon(_position(columns), columns["sog_kn"], columns["cog_deg"], at_s[-1] - at_s[columns["cycle"] - number[0]])
    rows = np.flatnonzero(inside(now, bbox))
    if len(rows) > FEW:
        return None
    columns = {name: column[rows] for name, column in columns.items()}
    newest = select(HISTORY.c.vessel_id, func.max(HISTORY.c.cycle)).where(
        HISTORY.c.run_id == run_id,
        is_one_of(connection, HISTORY.c.cycle, number),
        is_one_of(connection, HISTORY.c.vessel_id, columns["vessel_id"]),
    )
    vessel, cycle = fetch_arrays(connection, newest.group_by(HISTORY.c.vessel_id).order_by(HISTORY.c.vessel_id))
    last = cycle == columns["cycle"] if len(vessel) else np.zeros(0, np.bool_)
    return {name: column[last] for name, column in columns.items()}


def _newest_of_each(points: Columns) -> Columns:
    rows = newest_rows(points["vessel_id"], points["cycle"], points["closing"] != 0)
    return {name: column[rows] for name, column in points.items()}


def _position(points: Columns) -> Floats:
    return np.stack([points["latitude_deg"], points["longitude_deg"]], 1)


def _with_details(connection: Connection, run_id: int, cycle: int | None, columns: Columns, wanted: Sequence[str]) -> Table:
    """The wanted columns, with vessel details from other tables. Args: cycle: None: now."""
    not_kept = [name for name in ("existence", "alternative_m", *ECHO) if name in wanted and name not in columns]
    columns = columns | {name: np.full(len(columns["vessel_id"]), np.nan) for name in not_kept}
    if set(STATIC) & set(wanted):
        columns = columns | _statics_of(connection, run_id, columns["mmsi"])
    if cycle is not None and "since_s" in wanted and "since_s" not in columns:
        columns = columns | {"since_s": _since_of(connection, run_id, cycle, columns["vessel_id"])}
    if cycle is not None and "sources" in wanted:
        columns = columns | {"sources": _sources_of(connection, run_id, cycle, columns["vessel_id"])}
    return Table.of({name: columns[name] for name in wanted})


def _statics_of(connection: Connection, run_id: int, mmsi: Ints) -> Columns:
    """Name, call sign, type and size for each MMSI of a row, -1 for none. Args: (V,)."""
    stored_mmsi, *columns = _of_keys(connection, VESSEL_STATIC, run_id, ("mmsi", *STATIC), mmsi)
    order = np.argsort(stored_mmsi, kind="stable")
    row = find(stored_mmsi[order], mmsi)
    absent = {"O": None, "i": -1, "f": np.nan}
    at = np.append(order, len(order))[row]
    return {
        name: np.append(column, np.array([absent[column.dtype.kind]], column.dtype))[at]
        for name, column in zip(STATIC, columns, strict=True)
    }


def newest_statics(store: Store, run_id: int, most: int) -> Table:
    """The MMSI, name, call sign, type and size of vessels, those that were heard last. Args: most: vessels. Raises: StoreError."""
    s, names = VESSEL_STATIC.c, ("mmsi", *STATIC)
    query = select(*(s[name] for name in names)).where(s.run_id == run_id).order_by(s.updated_s.desc(), s.mmsi).limit(most)
    with reading(store) as connection:
        return Table(names, tuple(fetch_arrays(connection, query)))


def _since_of(connection: Connection, run_id: int, cycle: int, vessel_id: Ints) -> Floats:
    """When the stay of each vessel began that had this cycle in it, by its own account. Args: (V,) sorted."""
    stored_id, stored_since_s = _of_keys(
        connection, PRESENCE, run_id, ("vessel_id", "since_s"), vessel_id, _includes_cycle(PRESENCE, cycle)
    )
    since_s = np.full(len(vessel_id), np.nan)
    row = find(vessel_id, stored_id)
    since_s[row[row >= 0]] = stored_since_s[row >= 0]
    return since_s


def _sources_of(connection: Connection, run_id: int, cycle: int, vessel_id: Ints) -> Array:
    """Names of the sources that each vessel had in a cycle, "guanabara,ais". Args: (V,) sorted."""
    columns, at_cycle = ("vessel_id", "source", "track_id"), _includes_cycle(MEMBER_HISTORY, cycle)
    members = np.stack(_of_keys(connection, MEMBER_HISTORY, run_id, columns, vessel_id, at_cycle), 1)
    names = {
        row.number: row.name
        for row in connection.execute(select(SOURCE.c.number, SOURCE.c.name).where(SOURCE.c.run_id == run_id))
    }
    texts = [names.get(k, "") for k in range(max(names, default=-1) + 1)]
    sources = source_texts(vessel_id, members[np.lexsort(members.T[::-1])], texts)
    return np.array([text or None for text in sources.texts], object)[sources.codes]


def _includes_cycle(stays: SqlTable, cycle: int) -> ColumnElement[bool]:
    """That a stay has a cycle in it. The sum keeps SQLite from an index by cycles, most of which are before this one.

    Args: stays: table `presence` or `member_history`.
    """
    first, last = stays.c.from_cycle, stays.c.to_cycle
    return and_(first + 0 <= cycle, or_(last.is_(None), last >= cycle))


def _of_keys(
    connection: Connection, table: SqlTable, run_id: int, names: Sequence[str], keys: Ints, *where: ColumnElement[bool]
) -> list[Array]:
    """The columns of these names of the rows of some keys, which are in the first; where they are many, of all keys."""
    columns = [table.c[name] for name in names]
    few = [is_one_of(connection, columns[0], keys)] if len(keys) <= FEW else []
    return fetch_arrays(connection, select(*columns).where(table.c.run_id == run_id, *where, *few))


def decided_path(store: Store, run_id: int, vessel_id: int, newest: int | None = None) -> Rows:
    """The corrected past of a vessel, by time; empty where its tracker decides at once. Args: newest: states, at most; none: all.

    Raises: StoreError where the run never had the vessel.
    """
    with reading(store) as connection:
        _stays(connection, store, run_id, vessel_id)
        return _decided(connection, run_id, vessel_id, newest)


def _decided(connection: Connection, run_id: int, vessel_id: int, newest: int | None) -> Rows:
    """The corrected past of a vessel, by time, by seeking the key (run, cycle, vessel) in each cycle since it was first there.

    The last states of a track are decided when it ends, which may be long after its vessel has left the picture.
    """
    d, same = DECIDED_PATH.c, and_(SENSOR.c.run_id == DECIDED_PATH.c.run_id, SENSOR.c.kind == "radar")
    columns = [d.time_s, d.latitude_deg, d.longitude_deg, d.sog_kn, d.cog_deg, d.major_m, d.minor_m, d.orientation_deg]
    query = select(*columns, d.track_id, SENSOR.c.name.label("radar"), d.cycle.label("decided_cycle"))
    query = query.select_from(DECIDED_PATH.outerjoin(SENSOR, and_(same, SENSOR.c.number == d.radar)))
    first = select(func.min(PRESENCE.c.from_cycle)).where(PRESENCE.c.run_id == run_id, PRESENCE.c.vessel_id == vessel_id)
    since = select(CYCLE.c.number).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= first.scalar_subquery())
    query = query.where(d.run_id == run_id, d.cycle.in_(since), d.vessel_id == vessel_id)
    rows = fetch_rows(connection, query.order_by(d.cycle.desc(), d.number.desc()).limit(newest))
    track = rows.columns.index("track_id")
    return Rows(rows.columns, sorted(rows.rows, key=lambda row: (row[0], row[track])))


def _cycles_with(run_id: int, vessel_id: int) -> Select[tuple[int]]:
    """The numbers of the cycles that the stays of a vessel have in them."""
    stay = and_(PRESENCE.c.run_id == CYCLE.c.run_id, PRESENCE.c.vessel_id == vessel_id, PRESENCE.c.from_cycle <= CYCLE.c.number)
    lasts = or_(PRESENCE.c.to_cycle.is_(None), PRESENCE.c.to_cycle >= CYCLE.c.number)
    return select(CYCLE.c.number).join(PRESENCE, and_(stay, lasts)).where(CYCLE.c.run_id == run_id)


def _events(run_id: int, vessel_id: int) -> Executable:
    """The events of a vessel, and of others with it; `gaps`: how often each ended and returned."""
    e = EVENT.c
    gaps = select(func.count()).where(same_event(EVENT_GAP, EVENT)).correlate(EVENT).scalar_subquery().label("gaps")
    query = select(e.kind, e.start_s, e.end_s, gaps, e.latitude_deg, e.longitude_deg, e.sog_kn, e.mmsi, e.evidence)
    with_it = and_(e.kind == "close_approach", e.subject == vessel_id)
    return query.where(e.run_id == run_id, or_(e.vessel_id == vessel_id, with_it)).order_by(e.start_s, e.kind)


def _members(run_id: int, vessel_id: int) -> Executable:
    m, first, last = MEMBER_HISTORY.c, CYCLE.alias("first"), CYCLE.alias("last")
    planned_s = RUN.c.start_s + RUN.c.period_s * (m.from_cycle + 1)  # where the row of the cycle is deleted
    from_s = func.coalesce(first.c.time_s, planned_s).label("from_s")
    query = select(SOURCE.c.name.label("source"), SOURCE.c.kind, m.track_id, m.from_cycle, m.to_cycle, from_s)
    query = query.add_columns(last.c.time_s.label("to_s")).select_from(MEMBER_HISTORY)
    query = query.join(RUN, RUN.c.id == m.run_id)
    query = query.join(SOURCE, and_(SOURCE.c.run_id == m.run_id, SOURCE.c.number == m.source))
    query = query.outerjoin(first, and_(first.c.run_id == m.run_id, first.c.number == m.from_cycle))
    query = query.outerjoin(last, and_(last.c.run_id == m.run_id, last.c.number == m.to_cycle))
    return query.where(m.run_id == run_id, m.vessel_id == vessel_id).order_by(m.from_cycle, m.source, m.track_id)


def _rows_of_vessel(table: SqlTable, run_id: int, vessel_id: int) -> Executable:
    """The rows of one vessel by seeking the key (run, cycle, vessel) in each cycle of its stays.

    The cycles are an IN list and not a join, which SQLite's planner now and then turns into a scan of the large table.
    """
    there = _cycles_with(run_id, vessel_id).where(CYCLE.c.associations_kept)
    columns = [c for c in table.c if c.name not in ("run_id", "cycle", "vessel_id")]
    here, its_cycle = table.c, CYCLE.alias()
    query = select(here.cycle, its_cycle.c.time_s, *columns).join(
        its_cycle, and_(its_cycle.c.run_id == here.run_id, its_cycle.c.number == here.cycle)
    )
    return query.where(here.run_id == run_id, here.cycle.in_(there), here.vessel_id == vessel_id).order_by(here.cycle)


def _newest_row(connection: Connection, run_id: int, vessel_id: int, stays: Rows) -> dict[str, object]:
    """The row of the current picture, or for a vessel that has left it that of the last cycle in which it was there."""
    _, to_cycle, since_s = stays.rows[-1]
    if to_cycle is None:
        now = _picture_now(connection, run_id, COLUMNS, VESSEL.c.vessel_id == vessel_id)
        if len(now):
            return {**dict(zip(now.columns, now.rows[0], strict=True)), "in_picture": True}
    last = select(func.max(CYCLE.c.number)).where(CYCLE.c.run_id == run_id, CYCLE.c.history_from.is_not(None))
    cycle = connection.scalar(last if to_cycle is None else last.where(CYCLE.c.number == to_cycle))
    last_picture = Rows((), []) if cycle is None else picture_of_cycle(connection, run_id, cycle, None, vessel_id=vessel_id)
    row = (
        dict(zip(last_picture.columns, last_picture.rows[0], strict=True))
        if last_picture.rows
        else {"vessel_id": vessel_id, "since_s": since_s}
    )
    return {**row, "in_picture": to_cycle is None}


def _last_ais(connection: Connection, run_id: int, history: Table, members: Rows, *, is_here: bool) -> dict[str, object]:
    """MMSI, name and last instant of the AIS that a vessel without AIS had last; all None where it has AIS, or never had any.

    Args: history: its points; members: as of `_members`.
    """
    none: dict[str, object] = dict.fromkeys(LAST_AIS)
    stays = [dict(zip(members.columns, row, strict=True)) for row in members.rows]
    ends = [(np.inf if stay["to_cycle"] is None else stay["to_cycle"], stay["to_s"]) for stay in stays if stay["kind"] == "ais"]
    last_cycle, until_s = max(ends, key=lambda end: end[0], default=(-np.inf, None))
    if is_here and last_cycle == np.inf:
        return none
    point = history.array("cycle") <= last_cycle
    mmsi = history.array("mmsi")[point]
    if len(mmsi) == 0 or mmsi[-1] < 0:
        return none
    name = _statics_of(connection, run_id, mmsi[-1:])["name"][0]
    return dict(zip(LAST_AIS, (int(mmsi[-1]), name, until_s), strict=True))
