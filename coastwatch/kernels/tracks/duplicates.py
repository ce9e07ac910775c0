"""Pairs of tracks that may be one vessel, by the combined estimates. Scalar code, compiled by numba."""

import math

import numpy as np

from coastwatch.kernels.filters import symmetric4
from coastwatch.kernels.geometry import grid
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tracks.prediction import predicted_covariance, predicted_position


@jit
def possible_duplicates(estimates, rows, time, limit, correlation):  # type: ignore[no-untyped-def]
    """Pairs of tracks whose difference in position and velocity may be zero: first (A,), second (A,), places in rows, first < second.

    Args: estimates: Estimates; rows: (N,) slots; time: at which they are compared, not before their own; limit: squared Mahalanobis
    distance of four dimensions; correlation: of their errors, below 0.5, as a share of the smaller covariance.
    """
    count = len(rows)
    position, covariance = np.empty((count, 2)), np.empty((count, 2, 2))
    sigma, still = np.empty(count), np.zeros(count)
    for k in range(count):
        position[k, 0], position[k, 1] = predicted_position(estimates, rows[k], time)
        p = predicted_covariance(estimates, rows[k], time)
        covariance[k, 0, 0], covariance[k, 1, 1] = p[0], p[2]
        covariance[k, 0, 1] = covariance[k, 1, 0] = p[1]
        sigma[k] = math.sqrt(p[0] + p[2])
    first, second = np.empty(0, np.int32), np.empty(0, np.int32)
    if count > 1:
        low, high = (position[:, 0].min(), position[:, 1].min()), (position[:, 0].max(), position[:, 1].max())
        start, point = grid.near(grid.build(position, sigma, still, low, high), position, covariance, limit)
        first, second, found = np.empty(len(point), np.int32), np.empty(len(point), np.int32), 0
        for k in range(count):
            for other in np.sort(point[start[k] : start[k + 1]]):
                if k < other and _distance2(estimates, rows[k], rows[other], time, correlation) <= limit:
                    first[found], second[found] = k, other
                    found += 1
        first, second = first[:found], second[:found]
    return first, second


@jit
def _distance2(estimates, n, other, time, correlation):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distance of two tracks, in position and velocity, by P + P' - 2 correlation times the smaller of both."""
    east, north = predicted_position(estimates, n, time)
    other_east, other_north = predicted_position(estimates, other, time)
    rate_e = estimates.mean[n, 2] - estimates.mean[other, 2]
    rate_n = estimates.mean[n, 3] - estimates.mean[other, 3]
    one, another = predicted_covariance(estimates, n, time), predicted_covariance(estimates, other, time)
    smaller = one if one[0] + one[2] < another[0] + another[2] else another
    both = symmetric4.add_scaled(symmetric4.add_scaled(one, another, 1.0), smaller, -2.0 * correlation)
    factor = symmetric4.factor(both)
    whitened = symmetric4.forward_substitution(factor, east - other_east, north - other_north, rate_e, rate_n)
    return symmetric4.weighted_dot(factor, whitened, whitened)
