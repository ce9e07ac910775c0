"""Convex combination of the tracks of each vessel: the best estimate where their errors are independent.

Scalar code, compiled by numba; arguments as in `track_states`. Let two estimates have covariances A and B, and let s be the
shift from the first to the second. The combination is A (A + B)^-1 s from the first, with covariance A - A (A + B)^-1 A.

Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 9.3.3, with no cross-covariance.
"""

import math

import numpy as np

from coastwatch.kernels.filters.symmetric4 import (
    add_scaled,
    factor,
    forward_substitution,
    load,
    quadratic_form,
    solve_lower,
    store,
    subtract,
    weighted_dot,
)
from coastwatch.kernels.fusion.track_states import (
    copy_track,
    most_precise_first,
    read_covariances,
    write,
)
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import longest


@jit
def convex(first, last, start, row, tracks, sigma, registration, out):  # type: ignore[no-untyped-def]
    """Combine the tracks of vessels first to last, the most precise track first.

    Args: registration: share of a report's covariance that is added to the position of a track without MMSI.
    Raises: ZeroDivisionError: the sum of two covariances is singular.
    """
    position, velocity = tracks[0], tracks[1]
    most = longest(first, last, start)
    matrices, size, order = np.empty((most, 4, 4)), np.empty(most), np.empty(most, np.int64)
    for v in range(first, last):
        begin, count = start[v], start[v + 1] - start[v]
        if count == 1:
            copy_track(tracks, sigma, row[begin], out, v)
            continue
        read_covariances(tracks, sigma, registration, row, begin, matrices[:count])
        most_precise_first(matrices[:count], size, order)
        n, a = row[begin + order[0]], load(matrices, order[0])
        lat, lon, east_rate, north_rate = position[n, 0], position[n, 1], velocity[n, 0], velocity[n, 1]
        for k in range(1, count):
            n = row[begin + order[k]]
            east, north = enu_offset(position[n, 0], position[n, 1], lat, lon)
            f = factor(add_scaled(a, load(matrices, order[k]), 1.0))
            if max(max(abs(f[6]), abs(f[7])), max(abs(f[8]), abs(f[9]))) == math.inf:
                raise ZeroDivisionError("the covariances of a vessel's tracks add up to a singular matrix")
            w0, w1, w2, w3 = solve_lower(f, a)
            u = forward_substitution(f, east, north, velocity[n, 0] - east_rate, velocity[n, 1] - north_rate)
            lat, lon = add_enu_offset(lat, lon, weighted_dot(f, w0, u), weighted_dot(f, w1, u))
            east_rate, north_rate = east_rate + weighted_dot(f, w2, u), north_rate + weighted_dot(f, w3, u)
            a = subtract(a, quadratic_form(f, w0, w1, w2, w3))
        write(lat, lon, east_rate, north_rate, out, v)
        store(a, out[2], v)
