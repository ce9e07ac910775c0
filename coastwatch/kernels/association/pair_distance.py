"""Distances of candidate pairs: in metres, and of the whole states in units of their covariance. Scalar code, compiled by numba."""

import math

from coastwatch.kernels.filters.symmetric4 import add_scaled, factor, forward_substitution, load, weighted_dot
from coastwatch.kernels.fusion.track_states import is_finite
from coastwatch.kernels.geometry.ellipsoid import enu_offset
from coastwatch.kernels.jit import jit


@jit
def pair_distances(pair, row, tracks, tested, out):  # type: ignore[no-untyped-def]
    """Write the distance of the positions of each pair, m, and D = d' T^-1 d of their states, T the sum of their covariances.

    D is infinite where a covariance is not known, and where `tested` is false.
    Args: pair: (A,) PAIR; row: (N,) row of a track for each place; tracks: position (N, 2) degrees, velocity (N, 2), covariance
    (N, 4, 4); out: (A, 2), written.
    """
    position, velocity, covariance = tracks
    for k in range(len(pair)):
        a, b = row[pair[k].first], row[pair[k].second]
        east, north = enu_offset(position[b, 0], position[b, 1], position[a, 0], position[a, 1])
        out[k, 0], out[k, 1] = math.sqrt(east * east + north * north), math.inf
        if tested and is_finite(covariance, a) and is_finite(covariance, b):
            f = factor(add_scaled(load(covariance, a), load(covariance, b), 1.0))
            u = forward_substitution(f, east, north, velocity[b, 0] - velocity[a, 0], velocity[b, 1] - velocity[a, 1])
            out[k, 1] = weighted_dot(f, u, u)
