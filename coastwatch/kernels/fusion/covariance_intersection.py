"""Covariance intersection of the tracks of each vessel: consistent whatever the correlation of their errors.

Scalar code, compiled by numba; arguments as in `track_states`. Let two estimates have covariances A and B, and let s be the
shift from the first to the second. The intersection has the covariance C = (w A^-1 + (1 - w) B^-1)^-1 and lies (1 - w) C B^-1 s from
the first. The weight w makes the determinant of C smallest.

Source: S. J. Julier and J. K. Uhlmann, A non-divergent estimation algorithm in the presence of unknown correlations, 1997.
"""

import math

import numpy as np

from coastwatch.kernels.filters.symmetric4 import add_scaled, determinant, inverse, load, multiply, store, subtract
from coastwatch.kernels.fusion.track_states import (
    copy_track,
    most_precise_first,
    read_covariances,
    write,
)
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import longest

GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0
FLAT = 1e-13  # of a determinant: what is left of it by rounding


@jit
def intersection(first, last, start, row, tracks, sigma, steps, out):  # type: ignore[no-untyped-def]
    """Intersect the tracks of vessels first to last, the most precise track first. Args: steps: of the search of the weight."""
    position, velocity = tracks[0], tracks[1]
    most = longest(first, last, start)
    matrices, size, order = np.empty((most, 4, 4)), np.empty(most), np.empty(most, np.int64)
    for v in range(first, last):
        begin, count = start[v], start[v + 1] - start[v]
        if count == 1:
            copy_track(tracks, sigma, row[begin], out, v)
            continue
        read_covariances(tracks, sigma, 0.0, row, begin, matrices[:count])
        most_precise_first(matrices[:count], size, order)
        n, a = row[begin + order[0]], load(matrices, order[0])
        lat, lon, east_rate, north_rate = position[n, 0], position[n, 1], velocity[n, 0], velocity[n, 1]
        for k in range(1, count):
            n = row[begin + order[k]]
            east, north = enu_offset(position[n, 0], position[n, 1], lat, lon)
            shift = east, north, velocity[n, 0] - east_rate, velocity[n, 1] - north_rate
            mean, a = _intersect(a, load(matrices, order[k]), shift, steps)
            lat, lon = add_enu_offset(lat, lon, mean[0], mean[1])
            east_rate, north_rate = east_rate + mean[2], north_rate + mean[3]
        write(lat, lon, east_rate, north_rate, out, v)
        store(a, out[2], v)


@jit
def _intersect(a, b, shift, steps):  # type: ignore[no-untyped-def]
    """Mean relative to the first, and covariance, of the intersection of two estimates."""
    first, second = inverse(a), inverse(b)
    w = _best_weight(second, subtract(first, second), steps)
    if w == 1.0:
        return (0.0, 0.0, 0.0, 0.0), a
    out = inverse(add_scaled(second, subtract(first, second), w))
    x0, x1, x2, x3 = multiply(second, shift)
    rest = 1.0 - w
    return multiply(out, (rest * x0, rest * x1, rest * x2, rest * x3)), out


@jit
def _best_weight(b, change, steps):  # type: ignore[no-untyped-def]
    """The weight w at which det(B + w (A - B)) is largest, by golden section; a half where all are alike.

    Args: b: the inverse of the second covariance; change: A - B, the inverse of the first less it.
    """
    at_none, at_half, at_all = determinant(b), determinant(add_scaled(b, change, 0.5)), determinant(add_scaled(b, change, 1.0))
    if abs(at_half - at_none) <= FLAT * at_half and abs(at_half - at_all) <= FLAT * at_half:
        return 0.5
    low, high = 0.0, 1.0
    left, right = 1.0 - GOLDEN_RATIO, GOLDEN_RATIO
    at_left, at_right = determinant(add_scaled(b, change, left)), determinant(add_scaled(b, change, right))
    for _ in range(steps):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN_RATIO * (high - low)
            at_left = determinant(add_scaled(b, change, left))
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN_RATIO * (high - low)
            at_right = determinant(add_scaled(b, change, right))
    middle = 0.5 * (low + high)
    best = determinant(add_scaled(b, change, middle))
    if at_none > best:
        return 0.0 if at_all <= at_none else 1.0
    return 1.0 if at_all > best else middle
