"""Boxes of latitude and longitude: what lies in one, a wider one, and the condition in SQL."""

from __future__ import annotations

import numpy as np
from sqlalchemy import ColumnElement, and_, or_

from coastwatch.batches import Bools, Floats
from coastwatch.geodesy import scale_m_deg, wrap_deg

Box = tuple[float, float, float, float]
"""South, west, north, east in degrees; west > east crosses the antimeridian."""

FASTEST_M_S = 60.0
"""The search area is the box, widened by the way of a vessel of this speed while a point is valid. A faster one may be missed."""


def inside(position_deg: Floats, bbox: Box) -> Bools:
    """Which positions are in a box, its edges included. Args: position_deg: (V, 2)."""
    (south, west, north, east), (latitude, longitude) = bbox, position_deg.T
    after, before = longitude >= west, longitude <= east
    inside_box: Bools = (latitude >= south) & (latitude <= north) & (after & before if west <= east else after | before)
    return inside_box


def widened(bbox: Box, by_m: float) -> Box:
    """The box with so many metres more on every side."""
    south, west, north, east = bbox
    south, north = max(south - by_m / 110_574.0, -90.0), min(north + by_m / 110_574.0, 90.0)
    _, a_degree_m = scale_m_deg(np.array([min(max(abs(south), abs(north)), 89.0)]))
    aside = by_m / float(a_degree_m[0])
    if (east - west) % 360.0 + 2.0 * aside >= 360.0 or (west, east) == (-180.0, 180.0):
        return south, -180.0, north, 180.0
    return south, float(wrap_deg(west - aside)), north, float(wrap_deg(east + aside))


def is_inside(latitude_deg: ColumnElement[float], longitude_deg: ColumnElement[float], bbox: Box) -> ColumnElement[bool]:
    """That a row lies in a box. Args: latitude_deg, longitude_deg: columns."""
    south, west, north, east = bbox
    after, before = longitude_deg >= west, longitude_deg <= east
    return and_(latitude_deg.between(south, north), and_(after, before) if west <= east else or_(after, before))
