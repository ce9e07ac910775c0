"""Pairs of vessels of the current picture that are close to each other, or soon will be: candidates from a k-d tree.

Distances are of a sphere of 60 nautical miles a degree, as in every question of `db/operator`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import lazy_loader
import numpy as np
from sqlalchemy import Connection, select

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M
from coastwatch.store.rows import Rows, Table, fetch_arrays
from coastwatch.store.schema.tables import VESSEL

scipy = lazy_loader.load("scipy")  # few questions need it

DEGREE_M = 60.0 * NAUTICAL_MILE_M
RADIUS_M = np.degrees(DEGREE_M)
ROUNDING_M = 0.01  # of positions on the sphere


class Vessels(NamedTuple):
    """The current picture, by vessel. N vessels."""

    vessel_id: Ints
    position_deg: Floats  # (N, 2)
    sog_kn: Floats
    velocity_m_s: Floats  # (N, 2) east, north
    mmsi: Ints

    def take(self, rows: Array) -> Vessels:
        """Some of them."""
        return Vessels._make(column[rows] for column in self)


def closest_pairs(connection: Connection, run_id: int, values: Mapping[str, float | str]) -> Rows:
    """The answer to question `closest_pairs`. Args: values: its parameters."""
    within_m, least_kn = float(values["within_m"]), float(values["min_sog_kn"])
    vessels = _current_vessels(connection, run_id)
    vessels = vessels._replace(sog_kn=np.nan_to_num(vessels.sog_kn))
    first, second = _pairs_within(vessels, within_m)
    distance_m = np.hypot(*_offset_m(first, second).T)
    near = (distance_m <= within_m) & ((first.sog_kn >= least_kn) | (second.sog_kn >= least_kn))
    columns = {"distance_m": distance_m, "first_sog_kn": first.sog_kn, "second_sog_kn": second.sog_kn}
    return _least(near, distance_m, first, second, int(values["count"]), columns)


def closest_approach(connection: Connection, run_id: int, values: Mapping[str, float | str]) -> Rows:
    """The answer to question `closest_approach`. Args: values: its parameters."""
    vessels = _current_vessels(connection, run_id)
    vessels = vessels.take(np.flatnonzero(~np.isnan(vessels.sog_kn)))
    search_m, within_m = float(values["search_nm"]) * NAUTICAL_MILE_M, float(values["within_m"])
    horizon_s = float(values["minutes"]) * 60.0
    farthest_m = within_m + 2.0 * horizon_s * float(np.hypot(*vessels.velocity_m_s.T).max(initial=0.0))
    first, second = _pairs_within(vessels, min(search_m, farthest_m))
    offset_m, velocity_m_s = _offset_m(first, second), second.velocity_m_s - first.velocity_m_s
    square = (velocity_m_s**2).sum(1)
    after_s = -(offset_m * velocity_m_s).sum(1) / np.where(square > 0.0, square, 1.0)
    passing_m = np.hypot(*(offset_m + velocity_m_s * after_s[:, None]).T)
    distance_m = np.hypot(*offset_m.T)
    chosen = (distance_m <= search_m) & (square > 0.01) & (after_s >= 0.0) & (after_s <= horizon_s) & (passing_m <= within_m)
    columns = {"passing_in_s": after_s, "passing_m": passing_m, "distance_m": distance_m}
    return _least(chosen, after_s, first, second, int(values["count"]), columns)


def _current_vessels(connection: Connection, run_id: int) -> Vessels:
    v = VESSEL.c
    query = select(v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi).where(v.run_id == run_id)
    vessel, latitude, longitude, sog, cog, mmsi = fetch_arrays(connection, query)
    speed, course = np.nan_to_num(sog) * KNOT_M_S, np.radians(np.nan_to_num(cog))
    velocity = np.stack([speed * np.sin(course), speed * np.cos(course)], 1)
    return Vessels(vessel, np.stack([latitude, longitude], 1), sog, velocity, mmsi)


def _pairs_within(vessels: Vessels, radius_m: float) -> tuple[Vessels, Vessels]:
    """Every pair within a distance, and some more, the smaller number first.

    The chord between two points of a sphere is never longer than the distance of `_offset_m`.
    """
    latitude, longitude = np.radians(vessels.position_deg).T
    east, north = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    on_sphere = RADIUS_M * np.stack([east, north, np.sin(latitude)], 1)
    pair = scipy.spatial.cKDTree(on_sphere).query_pairs(radius_m + ROUNDING_M, output_type="ndarray")
    swap = vessels.vessel_id[pair[:, 0]] > vessels.vessel_id[pair[:, 1]]
    pair = np.where(swap[:, None], pair[:, ::-1], pair)
    return vessels.take(pair[:, 0]), vessels.take(pair[:, 1])


def _offset_m(first: Vessels, second: Vessels) -> Floats:
    """Metres east and north from the first to the second, at their mean latitude. Returns: (Q, 2)."""
    step = second.position_deg - first.position_deg
    turn = np.where(step[:, 1] > 180.0, step[:, 1] - 360.0, np.where(step[:, 1] < -180.0, step[:, 1] + 360.0, step[:, 1]))
    middle = np.radians((first.position_deg[:, 0] + second.position_deg[:, 0]) / 2.0)
    return np.stack([turn * DEGREE_M * np.cos(middle), step[:, 0] * DEGREE_M], 1)


def _least(chosen: Bools, by: Floats, first: Vessels, second: Vessels, count: int, columns: Mapping[str, Array]) -> Rows:
    """The chosen pairs with the least values, in order; at most so many. Args: columns: (Q,) of all pairs, behind the two ids."""
    rows = np.flatnonzero(chosen)
    rows = rows[np.lexsort((second.vessel_id[rows], first.vessel_id[rows], by[rows]))][:count]
    first, second = first.take(rows), second.take(rows)
    every: dict[str, Array] = {"first_id": first.vessel_id, "second_id": second.vessel_id}
    every |= {name: column[rows] for name, column in columns.items()}
    every |= {"first_mmsi": first.mmsi, "second_mmsi": second.mmsi}
    every |= zip(("latitude_deg", "longitude_deg"), first.position_deg.T, strict=True)
    return Rows(tuple(every), Table.of(every).rows)
