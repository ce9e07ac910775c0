"""Queries of the past: points of the history, one vessel, one MMSI, and traffic and encounters in a box, over a span of time.

| asked | answered by |
|---|---|
| all points of a span of cycles | one range of the key (run, cycle, vessel) |
| one vessel through time | its chain of points: each names the cycle of the one before it; stays in `presence` say where chains end |
| a box in a span of time | index `history_box`, sought once for each cycle of the span |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import lazy_loader
import numpy as np
from sqlalchemy import ColumnElement, Connection, false, func, or_, select, text

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.errors import StoreError
from coastwatch.geodesy import scale_m_deg, wrap_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.bbox import FASTEST_M_S, Box, widened
from coastwatch.store.history_rule import rate_deg_s
from coastwatch.store.rows import Rows, Table, fetch_arrays, is_one_of
from coastwatch.store.runs import between, run_exists
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import CYCLE, HISTORY, IDENTITY, PRESENCE, VESSEL

scipy = lazy_loader.load("scipy")  # few questions need it

MOTION = ("latitude_deg", "longitude_deg", "sog_kn", "cog_deg")
ELLIPSE = ("major_m", "minor_m", "orientation_deg")
COLUMNS = ("cycle", "time_s", "vessel_id", *MOTION, *ELLIPSE, "updated_s", "mmsi", "nav_status", "flags")
"""Of a history."""

OF_MMSI = ("time_s", "vessel_id", *MOTION, "major_m", "mmsi", "flags")
"""Of the history of an MMSI."""

SLOT_S = 20.0
"""Encounters: vessels are compared where they are in the middle of slots of this length."""

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

IN_BOX = """
SELECT {columns} FROM cycle c CROSS JOIN history near CROSS JOIN history h
WHERE c.run_id = :run AND c.number BETWEEN :first AND :last
    AND near.run_id = :run AND near.cycle = c.number + 0
    AND near.latitude_deg BETWEEN :south AND :north AND (near.longitude_deg >= :west {and_or} near.longitude_deg <= :east)
    AND h.run_id = :run AND h.cycle = near.cycle AND h.vessel_id = near.vessel_id
"""
"""`near` reads the index alone; `h` is the row. The sum makes SQLite seek the index for each cycle, not read the whole span."""


def history(
    store: Store, run_id: int, from_s: float | None = None, to_s: float | None = None, vessel_id: int | None = None
) -> Table:
    """Every point between two instants, both included, of all vessels or of one: cycle, time_s, vessel_id, position, motion,
    ellipse, updated_s, mmsi, nav_status, flags. Between two points a vessel keeps the course and speed of the first.
    """
    span = select(func.min(CYCLE.c.number), func.max(CYCLE.c.number)).where(CYCLE.c.run_id == run_id, *between(from_s, to_s))
    with reading(store) as connection:
        first, last = connection.execute(span).one()
        if first is None or vessel_id is None:
            return _points(connection, run_id, false() if first is None else HISTORY.c.cycle.between(first, last))
        points = points_of(connection, run_id, vessel_id, int(first))
    return points.take((points.array("cycle") >= first) & (points.array("cycle") <= last))


def points_of(connection: Connection, run_id: int, vessel_id: int, first: int = 0) -> Table:
    """The points of one vessel from a cycle on, oldest first; no closing ones."""
    here, since = PRESENCE.c.run_id == run_id, or_(PRESENCE.c.to_cycle.is_(None), PRESENCE.c.to_cycle >= first)
    stays = select(PRESENCE.c.to_cycle).where(here, PRESENCE.c.vessel_id == vessel_id, since)
    ends = list(connection.scalars(stays))
    starts = [to + 1 for to in ends if to is not None]
    if None in ends:  # it is there now: its newest point is in one of the cycles that the newest one names
        kept = select(CYCLE.c.number, CYCLE.c.history_from).where(CYCLE.c.run_id == run_id, CYCLE.c.history_from.is_not(None))
        if (last := connection.execute(kept.order_by(CYCLE.c.number.desc()).limit(1)).first()) is not None:
            starts += range(last.history_from, last.number + 1)
    cycles = np.zeros(0, np.int64)
    if starts:
        sql = text(CHAIN.format(starts=", ".join(f"({cycle})" for cycle in starts)))
        numbers = connection.scalars(sql, {"run": run_id, "vessel": vessel_id, "first": first})
        cycles = np.array(sorted(cycle for cycle in numbers if cycle >= first), np.int64)
    return _points(connection, run_id, is_one_of(connection, HISTORY.c.cycle, cycles), HISTORY.c.vessel_id == vessel_id)


def points_in_box(
    connection: Connection, run_id: int, first: int, last: int, bbox: Box, names: Sequence[str]
) -> dict[str, Array]:
    """The points of a range of cycles in a box, closing ones included, in no order. Args: names: of columns of `history`."""
    south, west, north, east = bbox
    sql = IN_BOX.format(columns=", ".join(f"h.{name}" for name in names), and_or="AND" if west <= east else "OR")
    query = text(sql).columns(*(HISTORY.c[name] for name in names))
    query = query.bindparams(run=run_id, first=first, last=last, south=south, west=west, north=north, east=east)
    return dict(zip(names, fetch_arrays(connection, query), strict=True))


def history_of_mmsi(connection: Connection, run_id: int, values: Mapping[str, float | str]) -> Rows:
    """The answer to question `history_of_mmsi`. Args: values: its parameters."""
    mmsi, i = int(values["mmsi"]), IDENTITY.c
    latest = connection.scalar(select(func.max(CYCLE.c.time_s)).where(CYCLE.c.run_id == run_id))
    from_s = 0.0 if latest is None else latest - float(values["minutes"]) * 60.0
    first = connection.scalar(select(func.min(CYCLE.c.number)).where(CYCLE.c.run_id == run_id, CYCLE.c.time_s >= from_s))
    if first is None:
        return Rows(OF_MMSI, [])
    since = or_(i.to_cycle.is_(None), i.to_cycle >= first)
    vessels = connection.scalars(select(i.vessel_id).where(i.run_id == run_id, i.mmsi == mmsi, since).distinct())
    parts = [points_of(connection, run_id, vessel, first) for vessel in sorted(vessels)]
    if not parts:
        return Rows(OF_MMSI, [])
    points = Table(OF_MMSI, tuple(np.concatenate([part.array(name) for part in parts]) for name in OF_MMSI))
    points = points.take((points.array("mmsi") == mmsi) & (points.array("time_s") >= from_s))
    return Rows(OF_MMSI, points.take(np.lexsort((points.array("vessel_id"), points.array("time_s")))).rows)


class Legs(NamedTuple):
    """Straight legs from each point of a vessel to its next one, by vessel and time. P legs."""

    cycle: Ints
    vessel_id: Ints
    mmsi: Ints
    position_deg: Floats  # (P, 2) at its beginning
    sog_kn: Floats
    cog_deg: Floats
    from_s: Floats
    to_s: Floats
    rate_deg_s: Floats  # (P, 2) north, east
    heard_s: Floats  # (P, 2) when it had been heard last, at its beginning and at its end

    def take(self, rows: Array) -> Legs:
        """Some of them."""
        return Legs._make(column[rows] for column in self)


def traffic(store: Store, run_id: int, bbox: Box, from_s: float, to_s: float) -> Table:
    """The points of the history from which vessels were in a box at some time between two instants, by vessel and time: vessel_id,
    cycle, time_s, to_s (until when the vessel went on from there), latitude_deg, longitude_deg, sog_kn, cog_deg, mmsi.

    Args: bbox: south, west, north, east in degrees; west > east crosses the antimeridian.
    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    with reading(store) as connection:
        legs = _legs(connection, store, run_id, bbox, from_s, to_s)
    entered_s, left_s = _time_in_box(legs, bbox, from_s, to_s)
    legs = legs.take(entered_s <= left_s)
    return Table.of(
        {
            "vessel_id": legs.vessel_id,
            "cycle": legs.cycle,
            "time_s": legs.from_s,
            "to_s": legs.to_s,
            "latitude_deg": legs.position_deg[:, 0],
            "longitude_deg": legs.position_deg[:, 1],
            "sog_kn": legs.sog_kn,
            "cog_deg": legs.cog_deg,
            "mmsi": legs.mmsi,
        }
    )


def encounters(
    store: Store,
    run_id: int,
    bbox: Box,
    from_s: float,
    to_s: float,
    within_m: float = 500.0,
    min_sog_kn: float = 1.0,
    count: int = 100,
) -> Rows:
    """Pairs of vessels that came close to each other while both were in a box between two instants, the closest first: first_id,
    second_id, distance_m and time_s of the closest approach, where the first was, speed and MMSI of both then, and for how many
    seconds each had not been heard: so long its position is predicted. 0 where it was heard after that, before its next point.

    Args: bbox: as of `traffic`; within_m: of the closest approach; min_sog_kn: at least one of the two was as fast; count: how many
    at most.
    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    with reading(store) as connection:
        legs = _legs(connection, store, run_id, bbox, from_s, to_s)
    entered_s, left_s = _time_in_box(legs, bbox, from_s, to_s)
    inside = np.flatnonzero(entered_s <= left_s)
    legs, entered_s, left_s = legs.take(inside), entered_s[inside], left_s[inside]
    pair, distance_m, time_s = _close_legs(legs, entered_s, left_s, bbox[1], within_m, legs.sog_kn >= min_sog_kn)
    swap = legs.vessel_id[pair[:, 0]] > legs.vessel_id[pair[:, 1]]
    pair = np.where(swap[:, None], pair[:, ::-1], pair)
    one, two = legs.vessel_id[pair].T
    order = np.lexsort((time_s, distance_m, two, one))
    once = np.append(True, (np.diff(one[order]) != 0) | (np.diff(two[order]) != 0))[: len(order)]
    order = order[once]
    order = order[np.argsort(distance_m[order], kind="stable")][:count]
    first, second, when = legs.take(pair[order, 0]), legs.take(pair[order, 1]), time_s[order]
    position = first.position_deg + first.rate_deg_s * (when - first.from_s)[:, None]
    silent_s = [np.maximum(when - legs.heard_s.max(axis=1), 0.0) for legs in (first, second)]
    named = {
        "first_id": first.vessel_id,
        "second_id": second.vessel_id,
        "distance_m": distance_m[order],
        "time_s": when,
        "latitude_deg": position[:, 0],
        "longitude_deg": wrap_deg(position[:, 1]),
        "first_sog_kn": first.sog_kn,
        "second_sog_kn": second.sog_kn,
        "first_mmsi": first.mmsi,
        "second_mmsi": second.mmsi,
        "first_silent_s": silent_s[0],
        "second_silent_s": silent_s[1],
    }
    return Rows(tuple(named), Table.of(named).rows)


def _points(connection: Connection, run_id: int, *where: ColumnElement[bool]) -> Table:
    """Points by cycle and vessel, without closing ones."""
    names = [name for name in COLUMNS if name != "time_s"]
    query = select(*(HISTORY.c[name] for name in names)).where(HISTORY.c.run_id == run_id, *where)
    columns = dict(zip(names, fetch_arrays(connection, query.where(HISTORY.c.closing == false())), strict=True))
    cycle = columns["cycle"]
    order = np.lexsort((columns["vessel_id"], cycle))
    low, high = int(cycle.min(initial=0)), int(cycle.max(initial=-1))
    number, time_s = cycle_times(connection, run_id, min(low, high), high)
    columns["time_s"] = time_s[np.searchsorted(number, cycle)] if len(cycle) else np.zeros(0)
    return Table(COLUMNS, tuple(columns[name][order] for name in COLUMNS))


def cycle_times(connection: Connection, run_id: int, first: int, last: int) -> tuple[Ints, Floats]:
    """Numbers and times of a range of cycles."""
    query = select(CYCLE.c.number, CYCLE.c.time_s).where(CYCLE.c.run_id == run_id, CYCLE.c.number.between(first, last))
    number, time_s = fetch_arrays(connection, query.order_by(CYCLE.c.number))
    return number, time_s


def _legs(connection: Connection, store: Store, run_id: int, bbox: Box, from_s: float, to_s: float) -> Legs:
    """Legs of the vessels that were in a box or near it between two instants: to the next point, at most as long as points are valid.

    None goes beyond the newest cycle of the run.
    """
    run_exists(connection, store, run_id)
    c = CYCLE.c
    before = select(c.history_from).where(c.run_id == run_id, c.time_s <= from_s)
    start = int(connection.scalar(before.order_by(c.time_s.desc()).limit(1)) or 0)
    after = select(c.number).where(c.run_id == run_id, c.time_s <= to_s).order_by(c.time_s.desc()).limit(1)
    end = connection.scalar(after)
    if end is None:
        raise StoreError(f"{store.where}: run {run_id} holds nothing up to then")
    span = select(c.number, c.time_s, c.history_from).where(c.run_id == run_id, c.number.between(start, end))
    number, time_s, oldest = fetch_arrays(connection, span.order_by(c.number))
    start = int(number[0])  # earlier cycles may have been deleted
    oldest = np.where(oldest < 0, number, oldest)
    valid_s = float((time_s - time_s[np.clip(oldest - start, 0, None)]).max(initial=0.0) + np.diff(time_s).max(initial=0.0))
    names = ("vessel_id", "cycle", *MOTION, "mmsi", "closing", "updated_s")
    p = points_in_box(connection, run_id, start, int(end), widened(bbox, valid_s * FASTEST_M_S), names)
    order = np.lexsort((p["cycle"], p["vessel_id"]))
    p = {name: column[order] for name, column in p.items()}
    begun_s = time_s[p["cycle"] - start]
    newest_s = connection.scalar(select(func.max(c.time_s)).where(c.run_id == run_id))
    ended_s = np.minimum(begun_s + valid_s, min(to_s, float(newest_s)))
    same = p["vessel_id"][1:] == p["vessel_id"][:-1]
    ended_s[:-1] = np.where(same, np.minimum(ended_s[:-1], begun_s[1:]), ended_s[:-1])
    position = np.stack([p["latitude_deg"], p["longitude_deg"]], 1)
    rate = rate_deg_s(position, p["sog_kn"], p["cog_deg"])
    heard_s = np.stack([p["updated_s"], _heard_at_the_end(connection, run_id, p)], 1)
    legs = Legs(p["cycle"], p["vessel_id"], p["mmsi"], position, p["sog_kn"], p["cog_deg"], begun_s, ended_s, rate, heard_s)
    return legs.take((p["closing"] == 0) & (ended_s >= begun_s))


def _heard_at_the_end(connection: Connection, run_id: int, points: Mapping[str, Array]) -> Floats:
    """When the vessel of each point had been heard last, as its next point says, or as is known of it now where there is none. (P,)

    Args: points: vessel_id and updated_s, by vessel and time.
    """
    vessel, heard_s = points["vessel_id"], points["updated_s"]
    v = VESSEL.c
    ours = select(v.vessel_id, v.updated_s).where(v.run_id == run_id, is_one_of(connection, v.vessel_id, np.unique(vessel)))
    known, newest_s = fetch_arrays(connection, ours.order_by(v.vessel_id))
    row = find(known, vessel)
    out = np.where(row >= 0, np.append(newest_s, np.nan)[row], heard_s)
    out[:-1] = np.where(vessel[1:] == vessel[:-1], heard_s[1:], out[:-1])
    return out


def _time_in_box(legs: Legs, bbox: Box, from_s: float, to_s: float) -> tuple[Floats, Floats]:
    """From when and until when each leg is in the box within a span of time; the end is before the beginning where it is not.

    A straight line against a rectangle, in degrees.
    """
    south, west, north, east = bbox
    low, high = np.maximum(legs.from_s, from_s) - legs.from_s, np.minimum(legs.to_s, to_s) - legs.from_s
    latitude, longitude = legs.position_deg.T
    width = 360.0 if (west, east) == (-180.0, 180.0) else (east - west) % 360.0
    seam = 90.0 if width < 270.0 else 0.0  # degrees west of the box
    across = (longitude - west + seam) % 360.0 - seam
    for position, least, most, rate in (
        (latitude, south, north, legs.rate_deg_s[:, 0]),
        (across, 0.0, width, legs.rate_deg_s[:, 1]),
    ):
        still = rate == 0.0
        ends = np.stack([least - position, most - position]) / np.where(still, 1.0, rate)
        stays = (position >= least) & (position <= most)
        low = np.maximum(low, np.where(still, np.where(stays, -np.inf, np.inf), ends.min(0)))
        high = np.minimum(high, np.where(still, np.inf, ends.max(0)))
    return legs.from_s + low, legs.from_s + high


def _close_legs(
    legs: Legs, entered_s: Floats, left_s: Floats, west_deg: float, within_m: float, moves: Bools
) -> tuple[Ints, Floats, Floats]:
    """Pairs of legs of two vessels that come within a distance while both are in the box: (Q, 2), metres, time.

    Time is cut into slots. In each slot a k-d tree of the positions in the middle of the slot finds the candidates.
    Args: entered_s, left_s: (P,) when each leg is in the box; moves: (P,) of a pair one does.
    """
    none = np.zeros((0, 2), np.int64)
    if not len(entered_s):
        return none, np.zeros(0), np.zeros(0)
    begin_s = float(entered_s.min())
    first, last = ((entered_s - begin_s) // SLOT_S).astype(np.int64), ((left_s - begin_s) // SLOT_S).astype(np.int64)
    north, east = scale_m_deg(legs.position_deg[:, 0])
    candidates = [none]
    for slot in range(int(last.max()) + 1):
        here = np.flatnonzero((first <= slot) & (last >= slot))
        low, high = begin_s + slot * SLOT_S, begin_s + (slot + 1) * SLOT_S
        since, until = np.maximum(low, entered_s[here]), np.minimum(high, left_s[here])
        position = legs.position_deg[here] + legs.rate_deg_s[here] * (0.5 * (since + until) - legs.from_s[here])[:, None]
        speed_m_s = np.hypot(legs.rate_deg_s[here, 0] * north[here], legs.rate_deg_s[here, 1] * east[here])
        reach = within_m + float((speed_m_s * (until - since)).max(initial=0.0))
        # No two positions are farther apart in this plane than at sea: a degree has its least length everywhere.
        least_m = 110_574.0, float(east[here].min(initial=np.inf))
        plane = np.stack([position[:, 0], (position[:, 1] - west_deg + 1.0) % 360.0], 1) * least_m
        if len(here):
            pair = here[scipy.spatial.cKDTree(plane).query_pairs(reach, output_type="ndarray")]
            a, b = pair.T
            candidates.append(pair[(legs.vessel_id[a] != legs.vessel_id[b]) & (moves[a] | moves[b])])
    every = np.concatenate(candidates)
    pair = np.stack(np.divmod(np.unique(every[:, 0] * len(moves) + every[:, 1]), len(moves)), 1)
    a, b = pair.T
    since, until = np.maximum(entered_s[a], entered_s[b]), np.minimum(left_s[a], left_s[b])
    distance_m, time_s = _closest_approach(legs.take(a), legs.take(b), since, until)
    near = (since <= until) & (distance_m <= within_m)
    return pair[near], distance_m[near], time_s[near]


def _closest_approach(one: Legs, two: Legs, since_s: Floats, until_s: Floats) -> tuple[Floats, Floats]:
    """Metres and time of the closest approach of pairs of legs between two times."""
    north, east = scale_m_deg(one.position_deg[:, 0])
    scale = np.stack([north, east], 1)
    offset = two.position_deg + two.rate_deg_s * (since_s - two.from_s)[:, None]
    offset -= one.position_deg + one.rate_deg_s * (since_s - one.from_s)[:, None]
    offset[:, 1] = wrap_deg(offset[:, 1])
    offset, relative = offset * scale, (two.rate_deg_s - one.rate_deg_s) * scale
    square = (relative**2).sum(1)
    passed = -(offset * relative).sum(1) / np.where(square > 0.0, square, 1.0)
    passed = np.where(square > 0.0, np.clip(passed, 0.0, np.maximum(until_s - since_s, 0.0)), 0.0)
    return np.hypot(*(offset + relative * passed[:, None]).T), since_s + passed
