"""Windows of differences between pairs of tracks, LANES pairs side by side, compiled by numba.

The window of a track is a chain through the arrays of a ring (`kernels.rings`): its newest entry stands in its own row, that of `age`
cycles before in row `chain[track, age - 1]` of the array of that cycle, and `length[track]` entries there are.

Every number is a row of LANES, one a pair, and is worked on by instructions for several pairs at once. What a pair gets does not depend on
who is beside it.
"""

import math

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.association.history import entry
from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, sine_cosine
from coastwatch.kernels.jit import jit

LANES = 16
LONGEST = 200  # window that there is room for
# of a step: differences, summed variances
EAST, NORTH, EAST_RATE, NORTH_RATE, VARIANCE, RATE_VARIANCE, STEP_ROWS = range(7)
# of a pair; lower triangles, row by row: of the summed covariance, of its factor, of the summed registration terms
SUM, FACTOR, BIAS = 0, 10, 20
SQUARE = 23  # of position, and of velocity: sums of x x, x y, y y about the mean
MEAN, NEWEST = 29, 33  # of the four differences: sums of what they differ from the newest by, and that
COUNT, ABSENT, DENSITY, GOOD, LATITUDE, SCALE_EAST, SCALE_NORTH, NEWEST_VARIANCE, NEWEST_RATE_VARIANCE = range(37, 46)
PLACE, COURSE, STEP_PLACE, STEP_COURSE, SHARE, RATE_SHARE, TOTAL, LANE_ROWS = range(46, 54)


@jit
def turned(longitude):  # type: ignore[no-untyped-def]
    """A difference of longitudes the short way round."""
    return longitude - 360.0 if longitude > 180.0 else longitude + 360.0 if longitude < -180.0 else longitude


@jit
def differences(a, b, n, most, table, chain, k, lane, step):  # type: ignore[no-untyped-def]
    """Degrees and rates of b less a, and summed variances, of the newest n entries, into the last n of `most` steps of lane k.

    Steps are oldest first: whoever goes through them counts up from 0, or the compiler would allow for negative rows.
    """
    for age in range(n):
        if age > 0:
            i, j = entry(table, age, chain[a, age - 1]), entry(table, age, chain[b, age - 1])
        else:
            i, j = entry(table, 0, a), entry(table, 0, b)
            lane[LATITUDE, k], lane[NEWEST_VARIANCE, k], lane[NEWEST_RATE_VARIANCE, k] = (
                0.5 * (i[0] + j[0]),
                i[4] + j[4],
                i[5] + j[5],
            )
        at = (most - 1 - age) * STEP_ROWS
        step[at + NORTH, k] = j[0] - i[0]
        step[at + EAST, k] = j[1] - i[1]
        step[at + EAST_RATE, k] = j[2] - i[2]
        step[at + NORTH_RATE, k] = j[3] - i[3]
        step[at + VARIANCE, k] = i[4] + j[4]
        step[at + RATE_VARIANCE, k] = i[5] + j[5]
    for row in range((most - n) * STEP_ROWS):
        step[row, k] = 0.0
    lane[COUNT, k], lane[ABSENT, k] = n, most - n


@jit
def in_metres(most, lane, step):  # type: ignore[no-untyped-def]
    """Differences of degrees become metres, by the metres a degree halfway between the newest entries (geodesy.scale_m_deg)."""
    for k in range(LANES):
        s, c = sine_cosine(lane[LATITUDE, k])
        w2 = 1.0 - ECCENTRICITY2 * s * s
        across = SEMI_MAJOR / math.sqrt(w2)
        lane[SCALE_NORTH, k] = across * (1.0 - ECCENTRICITY2) / w2 * DEGREE
        lane[SCALE_EAST, k] = across * c * DEGREE
    for t in range(most):
        at = t * STEP_ROWS
        for k in range(LANES):
            step[at + EAST, k] = turned(step[at + EAST, k]) * lane[SCALE_EAST, k]
            step[at + NORTH, k] *= lane[SCALE_NORTH, k]


@jit
def squares(most, lane, step):  # type: ignore[no-untyped-def]
    """Sums of products of the four differences about their means into SQUARE.

    One pass: sums of what they differ from the newest by, less what the means of that account for.
    """
    for row in range(4):
        for k in range(LANES):
            lane[NEWEST + row, k] = step[(most - 1) * STEP_ROWS + row, k]
    for row in range(SQUARE, NEWEST):
        for k in range(LANES):
            lane[row, k] = 0.0
    for t in range(most):
        at = t * STEP_ROWS
        for k in range(LANES):
            there = 1.0 if t >= lane[ABSENT, k] else 0.0
            x, y = there * (step[at + EAST, k] - lane[NEWEST, k]), there * (step[at + NORTH, k] - lane[NEWEST + 1, k])
            u, v = (
                there * (step[at + EAST_RATE, k] - lane[NEWEST + 2, k]),
                there * (step[at + NORTH_RATE, k] - lane[NEWEST + 3, k]),
            )
            lane[MEAN, k] += x
            lane[MEAN + 1, k] += y
            lane[MEAN + 2, k] += u
            lane[MEAN + 3, k] += v
            lane[SQUARE, k] += x * x
            lane[SQUARE + 1, k] += x * y
            lane[SQUARE + 2, k] += y * y
            lane[SQUARE + 3, k] += u * u
            lane[SQUARE + 4, k] += u * v
            lane[SQUARE + 5, k] += v * v
    for k in range(LANES):
        x, y, u, v, n = lane[MEAN, k], lane[MEAN + 1, k], lane[MEAN + 2, k], lane[MEAN + 3, k], lane[COUNT, k]
        lane[SQUARE, k] -= x * x / n
        lane[SQUARE + 1, k] -= x * y / n
        lane[SQUARE + 2, k] -= y * y / n
        lane[SQUARE + 3, k] -= u * u / n
        lane[SQUARE + 4, k] -= u * v / n
        lane[SQUARE + 5, k] -= v * v / n


@jit
def factorise(lane):  # type: ignore[no-untyped-def]
    """The matrix in FACTOR becomes its lower Cholesky factor; GOOD becomes 0 where it is not positive definite."""
    f = FACTOR
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
