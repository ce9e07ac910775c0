"""Which positions are within range of which sensors, and whether of any.

A position is within range if its distance in the tangent plane at the sensor is no more than the range, on the near half of the Earth.
Each cell of one degree lists the sensors that may reach it: a position is compared with the sensors of its cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Bools, Floats, Ints, Records
from coastwatch.kernels.geometry.ellipsoid import (
    DEGREE,
    SEMI_MAJOR,
    SHORTEST_RADIUS,
    ecef_and_axes,
    sine_cosine,
    to_ecef,
    wrap_degrees,
)
from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks

CELLS_PER_DEGREE = 1
ROWS, COLUMNS = 180 * CELLS_PER_DEGREE, 360 * CELLS_PER_DEGREE
SLACK_M = 1000.0  # a position with a greater tolerance is compared with every sensor
MARGIN = 1.001  # of the half width of a box: the ellipsoid is no sphere
SITE_NUMBERS = "latitude longitude range half_height half_width x y z sin_lat cos_lat sin_lon cos_lon"
SITE = np.dtype([(name, np.float64) for name in SITE_NUMBERS.split()])
"""A sensor: degrees and metres; half the height and width, in degrees, of the box that holds what it reaches; ECEF and plane."""


class Coverage(NamedTuple):
    """Sensors, and the sensors of each cell: row[start[c]:start[c + 1]] of cell c."""

    site: Records  # (R,) SITE
    start: Ints  # (ROWS * COLUMNS + 1,)
    row: Ints  # (L,)


@jit
def _describe(position, reach, slack, site):  # type: ignore[no-untyped-def]
    """Fills the records of sensors. Args: position: (R, 2); reach: (R,); site: (R,) SITE, written."""
    for k in range(len(site)):
        s = site[k]
        s.latitude, s.longitude, s.range = position[k, 0], position[k, 1], reach[k]
        s.x, s.y, s.z, s.sin_lat, s.cos_lat, s.sin_lon, s.cos_lon = ecef_and_axes(position[k, 0], position[k, 1])
        s.half_height = MARGIN * math.asin(min((reach[k] + slack) / SHORTEST_RADIUS, 1.0)) / DEGREE
        s.half_width = 180.0
        if abs(s.latitude) + s.half_height < 89.0:
            sine, _ = sine_cosine(s.half_height)
            s.half_width = MARGIN * math.asin(sine / s.cos_lat) / DEGREE


@jit
def _cell(lat, lon):  # type: ignore[no-untyped-def]
    """The cell of a position; -1 for none."""
    if not (abs(lat) <= 90.0 and abs(lon) <= 360.0):
        return -1
    row = min(int((lat + 90.0) * CELLS_PER_DEGREE), ROWS - 1)
    return row * COLUMNS + int((lon + 540.0) * CELLS_PER_DEGREE) % COLUMNS


@jit
def _enter(site, start, row):  # type: ignore[no-untyped-def]
    """Counts the sensors of each cell in start[cell + 1] if `row` is empty; else writes them from start[cell] on, which moves."""
    for k in range(len(site)):
        s = site[k]
        low = max(int((s.latitude - s.half_height + 90.0) * CELLS_PER_DEGREE), 0)
        high = min(int((s.latitude + s.half_height + 90.0) * CELLS_PER_DEGREE), ROWS - 1)
        first, last = 0, COLUMNS - 1
        if s.half_width < 179.0:
            first = math.floor((s.longitude - s.half_width + 180.0) * CELLS_PER_DEGREE)
            last = math.floor((s.longitude + s.half_width + 180.0) * CELLS_PER_DEGREE)
        for i in range(low, high + 1):
            for j in range(first, last + 1):
                cell = i * COLUMNS + j % COLUMNS
                if len(row) == 0:
                    start[cell + 1] += 1
                else:
                    row[start[cell]] = k
                    start[cell] += 1


def coverage_of(site_deg: Floats, range_m: Floats, slack_m: float) -> Coverage:
    """Sensors by cell. Args: site_deg: (R, 2); range_m: (R,); slack_m: how much farther away positions are compared."""
    site = np.empty(len(site_deg), SITE)
    _describe(np.ascontiguousarray(site_deg, np.float64), np.ascontiguousarray(range_m, np.float64), slack_m, site)
    count = np.zeros(ROWS * COLUMNS + 1, np.int64)
    _enter(site, count, np.empty(0, np.int64))
    start = np.cumsum(count)
    row = np.empty(start[-1], np.int64)
    if len(row):
        _enter(site, start[:-1].copy(), row)
    return Coverage(site, start, row)


@jit
def _in_box(site, lat, lon):  # type: ignore[no-untyped-def]
    """Whether a position may be within range."""
    return abs(lat - site.latitude) <= site.half_height and abs(wrap_degrees(lon - site.longitude)) <= site.half_width


@jit
def _within(site, x, y, z, tolerance):  # type: ignore[no-untyped-def]
    """Whether an ECEF position is within range and so many metres, and its east and north."""
    dx, dy, dz, most = x - site.x, y - site.y, z - site.z, site.range + tolerance
    outward = site.cos_lon * dx + site.sin_lon * dy
    east, north = site.cos_lon * dy - site.sin_lon * dx, site.cos_lat * dz - site.sin_lat * outward
    up = site.cos_lat * outward + site.sin_lat * dz
    return up > -SEMI_MAJOR and east * east + north * north <= most * most, east, north


@jit
def _in_any_range(low, high, position, coverage, out):  # type: ignore[no-untyped-def]
    site, start, row = coverage
    for v in range(low, high):
        lat, lon = position[v, 0], position[v, 1]
        cell, located = _cell(lat, lon), False
        x = y = z = 0.0
        out[v] = False
        if cell < 0:
            continue
        for k in range(start[cell], start[cell + 1]):
            s = site[row[k]]
            if not _in_box(s, lat, lon):
                continue
            if not located:
                (x, y, z), located = to_ecef(lat, lon), True
            if _within(s, x, y, z, 0.0)[0]:
                out[v] = True
                break


def in_any_range(coverage: Coverage, position_deg: Floats) -> Bools:
    """Whether each position is within range of any sensor. Args: position_deg: (V, 2). Returns: (V,)."""
    out = np.empty(len(position_deg), np.bool_)
    in_blocks(_in_any_range, len(out), np.ascontiguousarray(position_deg), coverage, out)
    return out


@jit
def _compared(low, high, position, tolerance, coverage):  # type: ignore[no-untyped-def]
    """Pairs of positions low to high and sensors that may be in range: (C,) rows, (C,) sensors."""
    site, start, row = coverage
    of, sensor, count = np.empty(high - low, np.int64), np.empty(high - low, np.int64), 0
    for v in range(low, high):
        lat, lon, every = position[v, 0], position[v, 1], tolerance[v] > SLACK_M
        cell = _cell(lat, lon)
        first, last = (0, len(site)) if every else (start[cell], start[cell + 1]) if cell >= 0 else (0, 0)
        if count + last - first > len(of):
            of, sensor = np.concatenate((of, of, of)), np.concatenate((sensor, sensor, sensor))
        for k in range(first, last):
            s = k if every else row[k]
            of[count], sensor[count] = v, s
            count += every or _in_box(site[s], lat, lon)
    return of[:count], sensor[:count]


@jit
def _pairs_in_range(low, high, position, tolerance, coverage):  # type: ignore[no-untyped-def]
    """Pairs of positions low to high: (P,) rows, (P,) sensors, (P, 2) east and north."""
    of, sensor = _compared(low, high, position, tolerance, coverage)
    site, offset, count = coverage[0], np.empty((len(of), 2)), 0
    for k in range(len(of)):
        v = of[k]
        x, y, z = to_ecef(position[v, 0], position[v, 1])
        inside, east, north = _within(site[sensor[k]], x, y, z, tolerance[v])
        of[count], sensor[count], offset[count, 0], offset[count, 1] = v, sensor[k], east, north
        count += inside
    return of[:count], sensor[:count], offset[:count]


def pairs_in_range(site_deg: Floats, range_m: Floats, position_deg: Floats, tolerance_m: Floats) -> tuple[Ints, Ints, Floats]:
    """Pairs of a position and a sensor that are no farther apart than its range and the tolerance of the position.

    Args: site_deg: (R, 2); range_m: (R,); position_deg: (V, 2); tolerance_m: (V,).
    Returns: (P,) rows of positions and (P,) sensors, sorted; (P, 2) metres east and north of the position from the sensor.
    """
    coverage = coverage_of(site_deg, range_m, SLACK_M)
    found = in_blocks(_pairs_in_range, len(position_deg), np.ascontiguousarray(position_deg), tolerance_m, coverage)
    of, sensor, offset = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return of, sensor, offset
