"""Windows of differences between pairs of tracks, laid out for LANES pairs at a time, compiled by numba.

The window of a track is a chain through the arrays of a ring (`kernels.rings`): its newest entry stands in its own row, that of `age`
cycles before in row `chain[track, age - 1]` of the array of that cycle, and `length[track]` entries there are.

What is a few numbers a pair is done for all pairs at hand by one instruction, what is a row of steps a pair for eight steps by one. The
room for that has a shape that is known when this is compiled: only then the compiler sees that what is written is not what is read.
"""

import math

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from coastwatch.kernels.compiling import arithmetic_part
from coastwatch.kernels.rings import entry, pointer

SEMI_MAJOR = 6378137.0
ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563
LANES = 8
LONGEST = 200  # window that there is room for; a multiple of LANES
EAST, NORTH, EAST_RATE, NORTH_RATE, OLDER_PLACE, OLDER_COURSE, PLACE, RAW_COURSE, COURSE, STEP_ROWS = range(10)
# lower triangles, row by row: of the summed covariance, of its factor, of the summed registration terms
SUM, FACTOR, BIAS = 0, 10, 20
SQUARE = 23  # of position, and of velocity: sums of x x, x y, y y about the mean
COUNT, DENSITY, GOOD, PLACE_0, COURSE_0, LANE_ROWS = range(29, 35)
STEP_NUMBERS = LANES * STEP_ROWS * LONGEST
ROOM = STEP_NUMBERS + LANE_ROWS * LANES  # numbers


@arithmetic_part
def scales(latitude):  # type: ignore[no-untyped-def]
    """Metres a degree north and east: the scalar twin of geodesy.scale_m_deg."""
    s = math.sin(math.radians(latitude))
    w2 = 1.0 - ECCENTRICITY2 * s * s
    north = SEMI_MAJOR * (1.0 - ECCENTRICITY2) / (w2 * math.sqrt(w2)) * math.pi / 180.0
    east = SEMI_MAJOR / math.sqrt(w2) * math.cos(math.radians(latitude)) * math.pi / 180.0
    return north, east


@arithmetic_part
def turned(longitude):  # type: ignore[no-untyped-def]
    """A difference of longitudes the short way round."""
    if longitude > 180.0:
        return longitude - 360.0
    if longitude < -180.0:
        return longitude + 360.0
    return longitude


@arithmetic_part
def steps(room):  # type: ignore[no-untyped-def]
    """What there is for each lane and step, oldest first: (LANES, STEP_ROWS, LONGEST)."""
    return carray(pointer(room), (LANES, STEP_ROWS, LONGEST), np.float64)  # type: ignore[call-arg]


@arithmetic_part
def lanes(room):  # type: ignore[no-untyped-def]
    """What there is for each lane: (LANE_ROWS, LANES)."""
    return carray(pointer(room + 8 * STEP_NUMBERS), (LANE_ROWS, LANES), np.float64)  # type: ignore[call-arg]


@arithmetic_part
def whole(n):  # type: ignore[no-untyped-def]
    """So many steps as whole vectors have; what is behind n is left over and counts for nothing."""
    return (n + LANES - 1) // LANES * LANES


@arithmetic_part
def differences(a, b, n, table, chain, k, room):  # type: ignore[no-untyped-def]
    """East, north and their rates of b less a, and summed variances, of the newest n entries, into lane k."""
    w = steps(room)
    i, j = entry(table, 0, a), entry(table, 0, b)
    north, east = scales(0.5 * (i[0] + j[0]))
    for age in range(n):
        if age > 0:
            i, j = entry(table, age, chain[a, age - 1]), entry(table, age, chain[b, age - 1])
        t = n - 1 - age
        w[k, EAST, t] = turned(j[1] - i[1]) * east
        w[k, NORTH, t] = (j[0] - i[0]) * north
        w[k, EAST_RATE, t] = j[2] - i[2]
        w[k, NORTH_RATE, t] = j[3] - i[3]
        w[k, OLDER_PLACE, t] = i[4] + j[4]
        w[k, OLDER_COURSE, t] = i[5] + j[5]


@arithmetic_part
def squares(n, k, room):  # type: ignore[no-untyped-def]
    """Sums of products about the means of lane k into SQUARE."""
    w, lane = steps(room), lanes(room)
    m0 = m1 = m2 = m3 = 0.0
    for t in range(n):
        m0 += w[k, EAST, t]
        m1 += w[k, NORTH, t]
        m2 += w[k, EAST_RATE, t]
        m3 += w[k, NORTH_RATE, t]
    m0, m1, m2, m3 = m0 / n, m1 / n, m2 / n, m3 / n
    xx = xy = yy = uu = uv = vv = 0.0
    for t in range(n):
        x, y, u, v = w[k, EAST, t] - m0, w[k, NORTH, t] - m1, w[k, EAST_RATE, t] - m2, w[k, NORTH_RATE, t] - m3
        xx += x * x
        xy += x * y
        yy += y * y
        uu += u * u
        uv += u * v
        vv += v * v
    lane[SQUARE, k], lane[SQUARE + 1, k], lane[SQUARE + 2, k] = xx, xy, yy
    lane[SQUARE + 3, k], lane[SQUARE + 4, k], lane[SQUARE + 5, k] = uu, uv, vv


@arithmetic_part
def factorise(room):  # type: ignore[no-untyped-def]
    """The matrix in FACTOR becomes its lower Cholesky factor; GOOD becomes 0 where it is not positive definite."""
    lane, f = lanes(room), FACTOR
    for k in range(LANES):
        s0 = lane[f, k]
        l00 = math.sqrt(s0)
        l10, l20, l30 = lane[f + 1, k] / l00, lane[f + 3, k] / l00, lane[f + 6, k] / l00
        s1 = lane[f + 2, k] - l10 * l10
        l11 = math.sqrt(s1)
        l21, l31 = (lane[f + 4, k] - l20 * l10) / l11, (lane[f + 7, k] - l30 * l10) / l11
        s2 = lane[f + 5, k] - l20 * l20 - l21 * l21
        l22 = math.sqrt(s2)
        l32 = (lane[f + 8, k] - l30 * l20 - l31 * l21) / l22
        s3 = lane[f + 9, k] - l30 * l30 - l31 * l31 - l32 * l32
        lane[f, k], lane[f + 1, k], lane[f + 2, k], lane[f + 3, k], lane[f + 4, k] = l00, l10, l11, l20, l21
        lane[f + 5, k], lane[f + 6, k], lane[f + 7, k], lane[f + 8, k], lane[f + 9, k] = l22, l30, l31, l32, math.sqrt(s3)
        lane[GOOD, k] = lane[GOOD, k] if (s0 > 0.0) & (s1 > 0.0) & (s2 > 0.0) & (s3 > 0.0) else 0.0
