"""Convex combination of the tracks of each vessel, LANES vessels side by side, compiled by numba. Arguments as in `fusing`.

Every number is a row of LANES, one a vessel, and is worked on by instructions for several vessels at once. What a vessel gets does not
depend on who is beside it. Vessels of two tracks are beside each other, and so are those of more, or few would hold up many.
"""

import math

import numpy as np

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.filters.symmetric4 import columns, determinant, dot, factor, forward, less, put, squared, towards
from coastwatch.kernels.fusion.covariance_intersection import AHEAD, alone, ask, precise_first, read
from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, sine_cosine, wrap_degrees
from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch
from coastwatch.kernels.tables.counting_sort import longest

LANES = 16
DEGREES_A_METRE = 1.0 / (SEMI_MAJOR * DEGREE)  # at the equator
LATITUDE, LONGITUDE, EAST_RATE, NORTH_RATE, COVARIANCE = range(5)  # of an estimate: degrees, m/s, the lower triangle by rows
SECOND = 14  # rows of an estimate: what is combined so far stands first, the track that comes to it second
EAST, NORTH, SCALE, LATER, SINGULAR, LANE_ROWS = range(
    28, 34
)  # metres; metres a degree north; 1 or 0: order changes, no result


@jit
def _laid(tracks, n, sigma, doubt, lane, at, k):  # type: ignore[no-untyped-def]
    """Track n into lane k, from row `at` on."""
    lane[at, k], lane[at + 1, k] = tracks[0][n, 0], tracks[0][n, 1]
    lane[at + 2, k], lane[at + 3, k] = tracks[1][n, 0], tracks[1][n, 1]
    c = read(tracks, n, sigma, doubt)
    lane[at + 4, k], lane[at + 5, k], lane[at + 6, k], lane[at + 7, k], lane[at + 8, k] = c[0], c[1], c[2], c[3], c[4]
    lane[at + 9, k], lane[at + 10, k], lane[at + 11, k], lane[at + 12, k], lane[at + 13, k] = c[5], c[6], c[7], c[8], c[9]


@jit
def _written(lane, k, out, v):  # type: ignore[no-untyped-def]
    """Lane k into the row of vessel v."""
    out[0][v, 0], out[0][v, 1] = lane[0, k], lane[1, k]
    out[1][v, 0], out[1][v, 1] = lane[2, k], lane[3, k]
    place, mixed = (lane[4, k], lane[5, k], lane[6, k]), (lane[7, k], lane[8, k])
    put((*place, *mixed, lane[9, k], lane[10, k], lane[11, k], lane[12, k], lane[13, k]), out[2], v)


@jit
def _matrix(lane, at, k):  # type: ignore[no-untyped-def]
    """The ten numbers from row `at` on."""
    return (
        lane[at, k],
        lane[at + 1, k],
        lane[at + 2, k],
        lane[at + 3, k],
        lane[at + 4, k],
        lane[at + 5, k],
        lane[at + 6, k],
        lane[at + 7, k],
        lane[at + 8, k],
        lane[at + 9, k],
    )


@jit
def _in_order(lane):  # type: ignore[no-untyped-def]
    """The estimate of the smaller determinant comes first; equal ones stay."""
    for k in range(LANES):
        one, other = _matrix(lane, COVARIANCE, k), _matrix(lane, SECOND + COVARIANCE, k)
        lane[LATER, k] = 1.0 if determinant(one) > determinant(other) else 0.0
        lane[SINGULAR, k] = 0.0
    for row in range(SECOND):
        for k in range(LANES):
            one, other = lane[row, k], lane[SECOND + row, k]
            lane[row, k] = other if lane[LATER, k] > 0.0 else one
            lane[SECOND + row, k] = one if lane[LATER, k] > 0.0 else other


@jit
def _apart(lane):  # type: ignore[no-untyped-def]
    """East and north metres from the first to the second, as `ellipsoid.enu_offset`."""
    for k in range(LANES):
        latitude, further = lane[LATITUDE, k], lane[SECOND + LATITUDE, k] - lane[LATITUDE, k]
        sine, cosine = sine_cosine(latitude + 0.5 * further)
        w2 = 1.0 - ECCENTRICITY2 * sine * sine
        parallel = SEMI_MAJOR * DEGREE / math.sqrt(w2)
        lane[SCALE, k] = parallel * (1.0 - ECCENTRICITY2) / w2
        lane[NORTH, k] = further * lane[SCALE, k]
        lane[EAST, k] = wrap_degrees(lane[SECOND + LONGITUDE, k] - lane[LONGITUDE, k]) * (parallel * cosine)


@jit
def _weighed(lane):  # type: ignore[no-untyped-def]
    """Covariance and rates of two estimates with independent errors, A - A (A + B)^-1 A; metres to the second become those to it."""
    for k in range(LANES):
        a, b = _matrix(lane, COVARIANCE, k), _matrix(lane, SECOND + COVARIANCE, k)
        f = factor(towards(a, b, 1.0))
        w0, w1, w2, w3 = columns(f, a)
        rates = lane[SECOND + EAST_RATE, k] - lane[EAST_RATE, k], lane[SECOND + NORTH_RATE, k] - lane[NORTH_RATE, k]
        u = forward(f, lane[EAST, k], lane[NORTH, k], rates[0], rates[1])
        lane[EAST, k], lane[NORTH, k] = dot(f, w0, u), dot(f, w1, u)
        lane[EAST_RATE, k] += dot(f, w2, u)
        lane[NORTH_RATE, k] += dot(f, w3, u)
        c = less(a, squared(f, w0, w1, w2, w3))
        at = COVARIANCE
        lane[at, k], lane[at + 1, k], lane[at + 2, k], lane[at + 3, k], lane[at + 4, k] = c[0], c[1], c[2], c[3], c[4]
        lane[at + 5, k], lane[at + 6, k], lane[at + 7, k], lane[at + 8, k], lane[at + 9, k] = c[5], c[6], c[7], c[8], c[9]
        largest = max(max(abs(f[6]), abs(f[7])), max(abs(f[8]), abs(f[9])))
        lane[SINGULAR, k] = 1.0 if largest == math.inf else lane[SINGULAR, k]


@jit
def _moved(lane):  # type: ignore[no-untyped-def]
    """The first by its metres, as `ellipsoid.add_enu_offset`: two rounds find the latitude to rounding up to 100 km."""
    for k in range(LANES):
        latitude, north = lane[LATITUDE, k], lane[NORTH, k]
        further = north / lane[SCALE, k]
        for _ in range(2):
            sine, _ = sine_cosine(latitude + 0.5 * further)
            w2 = 1.0 - ECCENTRICITY2 * sine * sine
            further = north * (w2 * math.sqrt(w2)) * (DEGREES_A_METRE / (1.0 - ECCENTRICITY2))
        sine, cosine = sine_cosine(latitude + 0.5 * further)
        east = lane[EAST, k] * math.sqrt(1.0 - ECCENTRICITY2 * sine * sine) * DEGREES_A_METRE / cosine
        lane[LATITUDE, k] = latitude + further
        lane[LONGITUDE, k] = wrap_degrees(lane[LONGITUDE, k] + east)


@jit
def _begun(vessel, count, start, row, tracks, sigma, doubt, order, size, lane):  # type: ignore[no-untyped-def]
    """The first two tracks of each vessel into its lane, and all of them in order into its row of `order`; those of a pair as they come.

    Returns: tracks of the vessel that has most.
    """
    most = 2
    for k in range(LANES):
        v = vessel[min(k, count - 1)]
        begin, end = start[v], start[v + 1]
        if end - begin == 2:
            order[k, 0], order[k, 1] = row[begin], row[begin + 1]
        else:
            precise_first(tracks, sigma, doubt, row, begin, end, order[k], size)
            most = max(most, end - begin)
        _laid(tracks, order[k, 0], sigma, doubt, lane, 0, k)
        _laid(tracks, order[k, 1], sigma, doubt, lane, SECOND, k)
    return most


@jit
def _combined(vessel, count, start, row, tracks, sigma, doubt, order, size, lane, out):  # type: ignore[no-untyped-def]
    """The first `count` of `vessel` (LANES,), all of several tracks; lanes behind them repeat the last."""
    most = _begun(vessel, count, start, row, tracks, sigma, doubt, order, size, lane)
    _in_order(lane)
    for r in range(1, most):
        _apart(lane)
        _weighed(lane)
        _moved(lane)
        for k in range(count):
            more = start[vessel[k] + 1] - start[vessel[k]] - 1 - r
            if more == 0:
                if lane[SINGULAR, k] > 0.0:
                    raise ZeroDivisionError("the covariances of a vessel's tracks add up to a singular matrix")
                _written(lane, k, out, vessel[k])
            elif more > 0:
                _laid(tracks, order[k, r + 1], sigma, doubt, lane, SECOND, k)


@jit
def _asked(tracks, doubt, row, begin, end):  # type: ignore[no-untyped-def]
    """As `ask`, with what says which tracks are doubted."""
    ask(tracks, row, begin, end)
    if doubt[0] > 0.0:
        for k in range(begin + AHEAD, min(end + AHEAD, len(row))):
            fetch(doubt[1], row[k])


@jit
def convex(low, high, start, row, tracks, sigma, doubt, out):  # type: ignore[no-untyped-def]
    """Vessels low to high by convex combination, the most precise track first.

    Args: doubt: share of a report's covariance that is added to a track without MMSI that is not alone, and mmsi (N,).
    Raises: ZeroDivisionError: the sum of two covariances is singular.
    """
    most = max(longest(low, high, start), 2)
    order, size, lane = np.empty((LANES, most), np.int32), np.empty(most), np.empty((LANE_ROWS, LANES))
    waiting, count = np.empty((2, LANES), np.int32), np.zeros(2, np.int64)  # vessels of two tracks, and of more
    for v in range(low, high + 2):
        which = v - high
        if v < high:
            begin, end = start[v], start[v + 1]
            _asked(tracks, doubt, row, begin, end)
            if end - begin == 1:
                alone(tracks, row[begin], sigma, out, v)
                continue
            which = 0 if end - begin == 2 else 1
            waiting[which, count[which]] = v
            count[which] += 1
        if count[which] == LANES or (v >= high and count[which] > 0):
            _combined(waiting[which], count[which], start, row, tracks, sigma, doubt, order, size, lane, out)
            count[which] = 0
