"""What went on in a box between two instants: the points of the history there, and which vessels came close to which."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from sqlalchemy import Connection, select, text

from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import KNOT_M_S, scale_m_deg, wrap_deg
from coastwatch.store.blocks import Points, points_between
from coastwatch.store.box import FASTEST_M_S, Box, widened
from coastwatch.store.collect import collected, listed
from coastwatch.store.opening import Store, StoreError, reading
from coastwatch.store.rows import Rows, Table
from coastwatch.store.runs import run_exists
from coastwatch.store.tables import Cycle

MMSI = """
WITH {point}
SELECT h.cycle, h.vessel_id, h.mmsi FROM point p CROSS JOIN history h
WHERE h.run_id = :run AND h.cycle = p.cycle AND h.vessel_id = p.vessel
"""

SLOT_S = 20.0
CLOSE = 65_536  # pairs that there is room for at first


class Stretches(NamedTuple):
    """How vessels went on from their points, by vessel and time. P stretches."""

    points: Points
    from_s: Floats
    to_s: Floats
    rate_deg_s: Floats  # (P, 2) north, east


def traffic(store: Store, run_id: int, bbox: Box, from_s: float, to_s: float) -> Table:
    """The points of the history from which vessels were in a box at some time between two instants, by vessel and time: vessel_id,
    cycle, time_s, to_s (until when the vessel went on from there), latitude_deg, longitude_deg (to 0.2 m), sog_kn, cog_deg.

    Args: bbox: south, west, north, east in degrees; west > east crosses the antimeridian.
    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    with reading(store) as connection:
        found = _stretches(connection, store, run_id, bbox, from_s, to_s)
    came, left = _stay(found, bbox, from_s, to_s)
    rows = np.flatnonzero(came <= left)
    points, place = found.points.take(rows), found.points.position_deg[rows]
    named = {
        "vessel_id": points.vessel_id,
        "cycle": points.cycle,
        "time_s": found.from_s[rows],
        "to_s": found.to_s[rows],
        "latitude_deg": place[:, 0],
        "longitude_deg": place[:, 1],
        "sog_kn": points.sog_kn,
        "cog_deg": points.cog_deg,
    }
    return Table(tuple(named), tuple(named.values()))


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
    second_id, distance_m and time_s of the closest approach, where the first was, and speed and MMSI of both then.

    Args: bbox: as of `traffic`; within_m: of the closest approach; min_sog_kn: at least one of the two was as fast; count: how many
    at most.
    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    with reading(store) as connection:
        found = _stretches(connection, store, run_id, bbox, from_s, to_s)
        pair, metres, when = _pairs(found, bbox, from_s, to_s, within_m, min_sog_kn)
        order = np.argsort(metres, kind="stable")[:count]
        pair, metres, when = pair[order], metres[order], when[order]
        return _told(connection, run_id, found, pair, metres, when)


def _stretches(connection: Connection, store: Store, run_id: int, bbox: Box, from_s: float, to_s: float) -> Stretches:
    """Of the vessels that were in a box or near it: a stretch from each point to the next, at most as long as points are valid."""
    run_exists(connection, store, run_id)
    c = Cycle
    before = select(c.history_from).where(c.run_id == run_id, c.time_s <= from_s)
    start = int(connection.scalar(before.order_by(c.time_s.desc()).limit(1)) or 0)
    after = select(c.number).where(c.run_id == run_id, c.time_s <= to_s).order_by(c.time_s.desc()).limit(1)
    end = connection.scalar(after)
    if end is None:
        raise StoreError(f"{store.where}: run {run_id} holds nothing up to then")
    span = select(c.number, c.time_s, c.history_from).where(c.run_id == run_id, c.number.between(start, end))
    number, time_s, held = collected(connection, span, end - start + 1)
    order = np.argsort(number)
    number, time_s, held = number[order], time_s[order], held[order]
    held = np.where(held < 0, number, held)
    longest_s = float((time_s - time_s[np.clip(held - start, 0, None)]).max() + np.diff(time_s).max(initial=0.0))
    found = points_between(connection, run_id, start, int(end), widened(bbox, longest_s * FASTEST_M_S))
    order = np.lexsort((found.cycle, found.vessel_id))
    return _in_line(found.take(order), time_s, start, longest_s, to_s)


def _in_line(points: Points, time_s: Floats, start: int, longest_s: float, to_s: float) -> Stretches:
    """Args: points: by vessel and cycle; time_s: of the cycles from `start` on."""
    begun = time_s[points.cycle - start]
    ended = np.minimum(begun + longest_s, to_s)
    same = points.vessel_id[1:] == points.vessel_id[:-1]
    ended[:-1] = np.where(same, np.minimum(ended[:-1], begun[1:]), ended[:-1])
    there = np.flatnonzero(~points.closing & (ended >= begun))
    kept = points.take(there)
    north, east = scale_m_deg(kept.position_deg[:, 0])
    speed, course = np.nan_to_num(kept.sog_kn) * KNOT_M_S, np.radians(np.nan_to_num(kept.cog_deg))
    rate = np.stack([speed * np.cos(course) / north, speed * np.sin(course) / east], 1)
    return Stretches(kept, begun[there], ended[there], rate)


def _stay(found: Stretches, bbox: Box, from_s: float, to_s: float) -> tuple[Floats, Floats]:
    """From when and until when each stretch is in the box within a span of time; the end is before the beginning where it is not.

    A straight line against a rectangle, in degrees.
    """
    south, west, north, east = bbox
    low, high = np.maximum(found.from_s, from_s) - found.from_s, np.minimum(found.to_s, to_s) - found.from_s
    latitude, longitude = found.points.position_deg.T
    width = 360.0 if (west, east) == (-180.0, 180.0) else (east - west) % 360.0
    seam = 90.0 if width < 270.0 else 0.0  # degrees west of the box
    across = (longitude - west + seam) % 360.0 - seam
    for place, least, most, rate in (
        (latitude, south, north, found.rate_deg_s[:, 0]),
        (across, 0.0, width, found.rate_deg_s[:, 1]),
    ):
        still = rate == 0.0
        ends = np.stack([least - place, most - place]) / np.where(still, 1.0, rate)
        stays = (place >= least) & (place <= most)
        low = np.maximum(low, np.where(still, np.where(stays, -np.inf, np.inf), ends.min(0)))
        high = np.minimum(high, np.where(still, np.inf, ends.max(0)))
    return found.from_s + low, found.from_s + high


def _pairs(
    found: Stretches, bbox: Box, from_s: float, to_s: float, within_m: float, min_sog_kn: float
) -> tuple[Ints, Floats, Floats]:
    """Stretches of the pairs of vessels that came close, each pair once at its closest: (Q, 2), metres, time."""
    from coastwatch.kernels.geometry.encounters import encounters as near
    from coastwatch.kernels.geometry.encounters import slot_entries

    came, left = _stay(found, bbox, from_s, to_s)
    rows = np.flatnonzero(came <= left)
    came, left, rate = came[rows], left[rows], found.rate_deg_s[rows]
    moved = found.points.position_deg[rows] + rate * (came - found.from_s[rows])[:, None]
    moved[:, 1] = (moved[:, 1] - bbox[1] + 1.0) % 360.0  # the box lies a degree east of this meridian
    north, east = scale_m_deg(moved[:, 0])
    pieces = np.stack([came - from_s, left - from_s, *moved.T, *rate.T, north, east], 1)
    first, piece = slot_entries(pieces, 0.0, SLOT_S)
    moves, vessel = found.points.sog_kn[rows] >= min_sog_kn, found.points.vessel_id[rows]
    room = CLOSE
    while True:
        out, both = np.empty((room, 2)), np.empty((room, 2), np.int64)
        least = float(east.min(initial=np.inf))
        count = near(pieces, vessel, moves, first, piece, 0.0, SLOT_S, within_m, least, out, both)
        if count <= room:
            break
        room = count
    return _once(found, rows[both[:count]], out[:count, 0], out[:count, 1] + from_s)


def _once(found: Stretches, pair: Ints, metres: Floats, when: Floats) -> tuple[Ints, Floats, Floats]:
    """Each pair of vessels once, at its closest, the smaller number first."""
    vessel = found.points.vessel_id
    swap = vessel[pair[:, 0]] > vessel[pair[:, 1]]
    pair = np.where(swap[:, None], pair[:, ::-1], pair)
    one, two = vessel[pair[:, 0]], vessel[pair[:, 1]]
    order = np.lexsort((when, metres, two, one))
    fresh = np.append(True, (np.diff(one[order]) != 0) | (np.diff(two[order]) != 0))[: len(order)]
    chosen = order[fresh]
    return pair[chosen], metres[chosen], when[chosen]


def _place(found: Stretches, rows: Ints, when: Floats) -> Floats:
    out: Floats = found.points.position_deg[rows] + found.rate_deg_s[rows] * (when - found.from_s[rows])[:, None]
    return np.stack([out[:, 0], wrap_deg(out[:, 1])], 1)


def _told(connection: Connection, run_id: int, found: Stretches, pair: Ints, metres: Floats, when: Floats) -> Rows:
    names = (
        *("first_id", "second_id", "distance_m", "time_s", "latitude_deg", "longitude_deg"),
        *("first_sog_kn", "second_sog_kn", "first_mmsi", "second_mmsi"),
    )
    points = found.points
    place = _place(found, pair[:, 0], when)
    mmsi = _mmsi(connection, run_id, points.take(pair.ravel()))
    sog = points.sog_kn[pair]
    columns = (*points.vessel_id[pair].T, metres, when, place[:, 0], wrap_deg(place[:, 1]), *sog.T, *mmsi.reshape(-1, 2).T)
    return Rows(names, Table(names, tuple(columns)).rows)


def _mmsi(connection: Connection, run_id: int, points: Points) -> Ints:
    """MMSI of each point; -1 for none."""
    keys = {(int(c), int(v)) for c, v in zip(points.cycle, points.vessel_id, strict=True)}
    if not keys:
        return np.zeros(0, np.int64)
    point, given = listed(connection, "point", ("cycle", "vessel"), sorted(keys))
    rows = connection.execute(text(MMSI.format(point=point)), {"run": run_id, **given})
    known = {(row.cycle, row.vessel_id): row.mmsi for row in rows if row.mmsi is not None}
    return np.array([known.get((int(c), int(v)), -1) for c, v in zip(points.cycle, points.vessel_id, strict=True)], np.int64)
