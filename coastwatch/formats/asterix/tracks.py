"""Tracks of other systems as ASTERIX CAT 062 and 010 to reports of a track source.

Source: EUROCONTROL Specification for Surveillance Data Exchange, Part 9 (CAT 062, edition 1.20) and Part 7 (CAT 010, edition 1.1).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Floats, TrackReports
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.formats.decoding import track_reports
from coastwatch.formats.intake.faults import SET_ASIDE
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg

NO_NUMBER = "track without number or position"
ENDED = SET_ASIDE + "last report of a track"


class Track(NamedTuple):
    """The state of a track, NaN where it is not given."""

    number: int
    time_s: float
    latitude_deg: float
    longitude_deg: float
    east_m_s: float
    north_m_s: float
    sigma_east_m: float
    sigma_north_m: float
    covariance_m2: float  # of east and north
    sigma_east_m_s: float
    sigma_north_m_s: float


def quantity_of(item: Any, name: str, unit: str) -> float:
    """The value of a part of an item in a unit. NaN: it is not there."""
    part = None if item is None else item.variation.get_item(name)
    return math.nan if part is None else float(part.variation.content.as_quantity(unit))


def uint_of(item: Any, name: str) -> int:
    """The bits of a part of an item as a number. 0: it is not there."""
    part = item.variation.get_item(name)
    return 0 if part is None else int(part.as_uint())


def track_of(record: Any, category: int, time_s: float, site_deg: Floats) -> Track | str:
    """The track that a record of CAT 062 or 010 holds, or why it has none. Args: site_deg: (2,) of its radar, NaN: not known."""
    if category not in (10, 62):
        return NO_NUMBER
    status = record.get_item("080") if category == 62 else None
    if status is not None and uint_of(status, "TSE"):
        return ENDED
    number = record.get_item("040" if category == 62 else "161")
    position = _position(record, category, site_deg)
    if number is None or not (abs(position[0]) < HIGHEST_LATITUDE_DEG and abs(position[1]) <= 180.0):
        return NO_NUMBER
    name = int(number.as_uint()) if category == 62 else uint_of(number, "TRK")
    return Track(name, time_s, *position, *_velocity(record, category), *_sigmas(record, category))


def _position(record: Any, category: int, site_deg: Floats) -> tuple[float, float]:
    """Latitude and longitude: WGS 84, else metres from the site, else, of CAT 010, range and azimuth from it."""
    item = record.get_item("105" if category == 62 else "041")
    if item is not None:
        return quantity_of(item, "LAT", "°"), quantity_of(item, "LON", "°")
    item = record.get_item("100" if category == 62 else "042")
    east, north = quantity_of(item, "X", "m"), quantity_of(item, "Y", "m")
    if item is None and category == 10:
        item = record.get_item("040")
        range_m, azimuth = quantity_of(item, "RHO", "m"), math.radians(quantity_of(item, "TH", "°"))
        east, north = range_m * math.sin(azimuth), range_m * math.cos(azimuth)
    position = offset_deg(site_deg, np.array([east, north]))
    return float(position[0]), float(position[1])


def _velocity(record: Any, category: int) -> tuple[float, float]:
    item = record.get_item("185" if category == 62 else "202")
    if item is not None or category == 62:
        return quantity_of(item, "VX", "m/s"), quantity_of(item, "VY", "m/s")
    item = record.get_item("200")
    speed, course = quantity_of(item, "GSP", "NM/s") * NAUTICAL_MILE_M, math.radians(quantity_of(item, "TRA", "°"))
    return speed * math.sin(course), speed * math.cos(course)


def _sigmas(record: Any, category: int) -> tuple[float, float, float, float, float]:
    """Deviations of position, the covariance, deviations of velocity. A covariance is sent as its root with its sign."""
    item = record.get_item("500")
    if item is None:
        return (math.nan,) * 5
    if category == 10:
        return quantity_of(item, "DEVX", "m"), quantity_of(item, "DEVY", "m"), 0.0, math.nan, math.nan
    position, velocity = item.variation.get_item("APC"), item.variation.get_item("ATV")
    root = item.variation.get_item("COV")
    root_m = 0.0 if root is None else float(root.variation.content.as_quantity("m"))
    sigmas = quantity_of(position, "X", "m"), quantity_of(position, "Y", "m")
    return *sigmas, math.copysign(root_m**2, root_m), quantity_of(velocity, "X", "m/s"), quantity_of(velocity, "Y", "m/s")


def reports_of(source: int, tracks: list[Track]) -> TrackReports:
    """The tracks as reports of a track source. A position covariance that is not positive definite is not used."""
    table = np.array([track[1:] for track in tracks], np.float64)
    number = np.array([track.number for track in tracks], np.int64)
    covariance = np.full((len(table), 4, 4), np.nan)
    east, north, cross = table[:, 5], table[:, 6], table[:, 7]
    good = (east > 0.0) & (north > 0.0) & (np.abs(cross) < east * north)
    position = np.stack([np.stack([east**2, cross], 1), np.stack([cross, north**2], 1)], 1)
    covariance[good, :2, :2] = position[good]
    moving = good & (table[:, 8] > 0.0) & (table[:, 9] > 0.0)
    covariance[moving, :2, 2:] = covariance[moving, 2:, :2] = 0.0
    covariance[moving, 2:, 2:] = 0.0
    covariance[moving, 2, 2], covariance[moving, 3, 3] = table[moving, 8] ** 2, table[moving, 9] ** 2
    return track_reports(source, number, table[:, 0].copy(), table[:, 1:3], table[:, 3:5], covariance)
