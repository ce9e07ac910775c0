"""Where a vessel would be had it kept its course and speed since its last point, and whether that is still good enough.

A point's position goes on at the constant rates, in degrees a second, that its speed and course are at its own latitude.
"""

import math

from coastwatch.kernels.geometry.ellipsoid import DEGREE, metres_per_degree
from coastwatch.kernels.jit import jit

KNOT = 1852.0 / 3600.0

VESSEL, CYCLE, MMSI, FLAGS, FIRST = range(5)
TIME, LATITUDE, LONGITUDE, SPEED, COURSE, NORTH_RATE, EAST_RATE = 0, 1, 2, 3, 4, 9, 10
WHOLE, REAL = 5, 11
"""Columns of a table of points: whole numbers, of which FIRST is 1 for the first point of a stay; and real ones: TIME, then latitude,
longitude, knots, course, half axes and direction of the ellipse, newest report, then degrees a second north and east."""

HASH, SPAN = 2654435761, 1 << 32
MOST_M_DEG = 111_695.0
"""More than a degree of latitude or longitude has anywhere."""


@jit
def distance(latitude, longitude, other_latitude, other_longitude):  # type: ignore[no-untyped-def]
    """Metres between two points that are close: as geodesy.difference_m has them."""
    north, east = metres_per_degree(0.5 * (latitude + other_latitude))
    turn = (other_longitude - longitude + 180.0) % 360.0 - 180.0
    return math.hypot(turn * east, (other_latitude - latitude) * north)


@jit
def set_rates(real):  # type: ignore[no-untyped-def]
    """Fills the rates of (P, REAL) points from speed and course; what has none stands still."""
    for p in range(real.shape[0]):
        real[p, NORTH_RATE], real[p, EAST_RATE] = 0.0, 0.0
        speed, course = real[p, SPEED] * KNOT, real[p, COURSE] * DEGREE
        if speed > 0.0 and not math.isnan(course):
            north, east = metres_per_degree(real[p, LATITUDE])
            real[p, NORTH_RATE] = speed * math.cos(course) / north
            real[p, EAST_RATE] = speed * math.sin(course) / east


@jit
def _due(whole, real, p, time, longest):  # type: ignore[no-untyped-def]
    """Whether a point has stood for as long as it may: less after the first one of a stay, by the vessel's number, so that vessels
    that came together do not have all their points together."""
    may = longest
    if whole[p, FIRST] == 1:
        may = longest * float(whole[p, VESSEL] * HASH % SPAN) / float(SPAN)
    return time - real[p, TIME] >= may


@jit
def _close(real, p, latitude, longitude, time, bound):  # type: ignore[no-untyped-def]
    """Whether a point has gone on to within some metres of a place: of most that is plain without the length of a degree there."""
    passed = time - real[p, TIME]
    north, east = real[p, LATITUDE] + real[p, NORTH_RATE] * passed, real[p, LONGITUDE] + real[p, EAST_RATE] * passed
    if MOST_M_DEG * (abs(north - latitude) + abs(east - longitude)) < bound:
        return True
    return distance(north, east, latitude, longitude) <= bound


@jit
def decide(whole, real, vessel, place, mmsi, flags, time, bound, longest, former, write, gone):  # type: ignore[no-untyped-def]
    """Which vessels of a picture need a point.

    Args: whole, real: (P, ...) the newest point of each vessel of the cycle before, sorted by vessel; vessel: (V,) sorted; place:
    (V, 2) degrees; mmsi, flags: (V,); time: of this cycle; bound: metres that a place may be off; longest: seconds between points.
    former: (V,) row of the vessel's point, -1: it has none. write: (V,). gone: (P,) points of vessels that are no longer there.
    """
    p = 0
    for v in range(len(vessel)):
        while p < whole.shape[0] and whole[p, VESSEL] < vessel[v]:
            gone[p] = True
            p += 1
        if p == whole.shape[0] or whole[p, VESSEL] > vessel[v]:
            former[v], write[v] = -1, True
            continue
        gone[p] = False
        same = whole[p, MMSI] == mmsi[v] and whole[p, FLAGS] == flags[v]
        close = _close(real, p, place[v, 0], place[v, 1], time, bound)
        former[v], write[v] = p, not (same and close) or _due(whole, real, p, time, longest)
        p += 1
    gone[p:] = True


@jit
def _put_row(whole, real, p, out_whole, out_real, v):  # type: ignore[no-untyped-def]
    """Copy one point."""
    for k in range(WHOLE):
        out_whole[v, k] = whole[p, k]
    for k in range(REAL):
        out_real[v, k] = real[p, k]


@jit
def carry_on(whole, real, former, write, fresh_whole, fresh_real, out_whole, out_real):  # type: ignore[no-untyped-def]
    """The newest point of each vessel after a cycle. Args: fresh: one row for each that is written, in order; out: (V, ...)."""
    k = 0
    for v in range(len(former)):
        if write[v]:
            _put_row(fresh_whole, fresh_real, k, out_whole, out_real, v)
            k += 1
        else:
            _put_row(whole, real, former[v], out_whole, out_real, v)
