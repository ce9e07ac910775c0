"""Which vessels of the current picture are close to each other, or soon will be: from arrays, by cells, never by joining rows.

Distances are of a sphere of 60 nautical miles a degree, as in every question of `db/operator`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Connection, select

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M
from coastwatch.store.collect import collected, loaded
from coastwatch.store.pictures import most_vessels
from coastwatch.store.rows import Rows, Table
from coastwatch.store.tables import Vessel

DEGREE_M = 60.0 * NAUTICAL_MILE_M
FEW = 1000
"""Vessels of which all pairs are compared rather than that compiled code is loaded."""

ROOM = 65_536  # pairs that there is room for at first
LEAST_M = 1.0  # of a cell


class Vessels(NamedTuple):
    """The current picture, by vessel."""

    vessel_id: Ints
    position_deg: Floats  # (N, 2)
    sog_kn: Floats
    velocity_m_s: Floats  # (N, 2) east, north
    mmsi: Ints

    def take(self, rows: Array) -> Vessels:
        """Some of them."""
        return Vessels._make(column[rows] for column in self)


def closest_pairs(connection: Connection, values: Mapping[str, Any]) -> Rows:
    """The answer to question `closest_pairs`. Args: values: its parameters, `run` too."""
    found = _vessels(connection, values["run"])
    found = found._replace(sog_kn=np.nan_to_num(found.sog_kn))
    within = float(values["within_m"])
    moves = found.sog_kn >= values["min_sog_kn"]
    first, second = _pairs(found, moves, within, within, 0.0)
    apart = np.sqrt((_apart(first, second) ** 2).sum(1))
    near = (apart <= within) & ((first.sog_kn >= values["min_sog_kn"]) | (second.sog_kn >= values["min_sog_kn"]))
    rows = _soonest(near, apart, first, second, values["count"])
    first, second = first.take(rows), second.take(rows)
    named = {
        "first_id": first.vessel_id,
        "second_id": second.vessel_id,
        "distance_m": apart[rows],
        "first_sog_kn": first.sog_kn,
        "second_sog_kn": second.sog_kn,
    }
    return _rows(named, first, second)


def closest_approach(connection: Connection, values: Mapping[str, Any]) -> Rows:
    """The answer to question `closest_approach`. Args: values: its parameters, `run` too."""
    found = _vessels(connection, values["run"])
    found = found.take(np.flatnonzero(~np.isnan(found.sog_kn)))
    search, within, horizon = values["search_nm"] * NAUTICAL_MILE_M, float(values["within_m"]), values["minutes"] * 60.0
    first, second = _pairs(found, np.ones(len(found.mmsi), np.bool_), search, within, max(horizon, 1e-9))
    apart, moves = _apart(first, second), second.velocity_m_s - first.velocity_m_s
    square = (moves**2).sum(1)
    after = -(apart * moves).sum(1) / np.where(square > 0.0, square, 1.0)
    passing = np.sqrt(((apart + moves * after[:, None]) ** 2).sum(1))
    distance = np.sqrt((apart**2).sum(1))
    chosen = (distance <= search) & (square > 0.01) & (after >= 0.0) & (after <= horizon) & (passing <= within)
    rows = _soonest(chosen, after, first, second, values["count"])
    first, second = first.take(rows), second.take(rows)
    named = {
        "first_id": first.vessel_id,
        "second_id": second.vessel_id,
        "passing_in_s": after[rows],
        "passing_m": passing[rows],
        "distance_m": distance[rows],
    }
    return _rows(named, first, second)


def _vessels(connection: Connection, run_id: int) -> Vessels:
    v = Vessel
    query = select(v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi).where(v.run_id == run_id)
    vessel, latitude, longitude, sog, cog, mmsi = collected(connection, query, most_vessels(connection, run_id))
    speed, course = np.nan_to_num(sog) * KNOT_M_S, np.radians(np.nan_to_num(cog))
    velocity = np.stack([speed * np.sin(course), speed * np.cos(course)], 1)
    return Vessels(vessel, np.stack([latitude, longitude], 1), sog, velocity, mmsi)


def _pairs(found: Vessels, moves: Bools, search_m: float, within_m: float, horizon_s: float) -> tuple[Vessels, Vessels]:
    """Every pair that may be asked for, and some more, the smaller number first."""
    if len(moves) <= FEW and not loaded():
        rows = np.stack(np.triu_indices(len(moves), 1), 1)
    else:
        rows = _by_cells(found, moves, search_m, within_m, horizon_s)
    swap = found.vessel_id[rows[:, 0]] > found.vessel_id[rows[:, 1]]
    rows = np.where(swap[:, None], rows[:, ::-1], rows)
    return found.take(rows[:, 0]), found.take(rows[:, 1])


def _by_cells(found: Vessels, moves: Bools, search_m: float, within_m: float, horizon_s: float) -> Ints:
    """(Q, 2) rows. Cells are of the size of the search radius; columns are counted where the Earth is narrowest."""
    from coastwatch.kernels.geometry.closest_approach import passing_pairs

    latitude, longitude = found.position_deg.T
    size = max(search_m, LEAST_M)
    widest = np.cos(np.radians(np.abs(latitude).max(initial=0.0)))
    columns = max(int(360.0 * DEGREE_M * widest / size), 3)
    row, column = np.floor((latitude + 90.0) * DEGREE_M / size), np.floor((longitude + 180.0) / 360.0 * columns)
    key = row.astype(np.int64) * columns + column.astype(np.int64) % columns
    order = np.argsort(key, kind="stable")
    reach = np.hypot(*found.velocity_m_s.T) * horizon_s
    table = np.stack([latitude, longitude, *found.velocity_m_s.T, np.cos(np.radians(latitude)), reach], 1)[order]
    room = ROOM
    while True:
        out = np.empty((room, 2), np.int64)
        count = passing_pairs(key[order], table, moves[order], columns, search_m, within_m, horizon_s, out)
        if count <= room:
            chosen: Ints = order[out[:count]]
            return chosen
        room = count


def _apart(first: Vessels, second: Vessels) -> Floats:
    """Metres east and north from the first to the second. Returns: (Q, 2)."""
    step = second.position_deg - first.position_deg
    turn = np.where(step[:, 1] > 180.0, step[:, 1] - 360.0, np.where(step[:, 1] < -180.0, step[:, 1] + 360.0, step[:, 1]))
    middle = np.radians((first.position_deg[:, 0] + second.position_deg[:, 0]) / 2.0)
    return np.stack([turn * DEGREE_M * np.cos(middle), step[:, 0] * DEGREE_M], 1)


def _soonest(chosen: Bools, by: Floats, first: Vessels, second: Vessels, count: int) -> Ints:
    """So many of the chosen pairs at most, in order."""
    rows = np.flatnonzero(chosen)
    out: Ints = rows[np.lexsort((second.vessel_id[rows], first.vessel_id[rows], by[rows]))][:count]
    return out


def _rows(named: Mapping[str, Array], first: Vessels, second: Vessels) -> Rows:
    place = dict(zip(("latitude_deg", "longitude_deg"), first.position_deg.T, strict=True))
    all_of = {**named, "first_mmsi": first.mmsi, "second_mmsi": second.mmsi, **place}
    return Rows(tuple(all_of), Table(tuple(all_of), tuple(all_of.values())).rows)
