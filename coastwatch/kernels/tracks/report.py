"""What a region reports of its tracks and plots, in latitude and longitude. Scalar code, compiled by numba.

The compiled twin of `geodesy.from_plane`, `geodesy.turn` and `oracles.polar_textbook` of the tests: sines and cosines are of the
geometry, not of angles.
"""

import math

import numpy as np

from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes, from_plane
from coastwatch.kernels.jit import jit


@jit
def _rotate_block(matrix, turn, out):  # type: ignore[no-untyped-def]
    """T M T' of 2 x 2 matrices, into `out`. Args: turn: T, row by row."""
    a, b, c, d = turn
    for column in range(2):
        east, north = matrix[0, column], matrix[1, column]
        out[0, column], out[1, column] = a * east + b * north, c * east + d * north
    for row in range(2):
        east, north = out[row, 0], out[row, 1]
        out[row, 0], out[row, 1] = a * east + b * north, c * east + d * north


@jit
def geodetic_points(position, covariance, latitude, longitude):  # type: ignore[no-untyped-def]
    """Latitude and longitude (M, 2) of points of a plane, and their covariance (M, 2, 2) of east and north there.

    Args: position: (M, 2) m; covariance: (M, 2, 2); latitude, longitude: of the origin of the plane, degrees.
    """
    frame, degrees, turned = ecef_and_axes(latitude, longitude), np.empty((len(position), 2)), np.empty((len(position), 2, 2))
    for m in range(len(position)):
        degrees[m, 0], degrees[m, 1], turn = from_plane(position[m, 0], position[m, 1], frame)
        _rotate_block(covariance[m], turn, turned[m])
    return degrees, turned


@jit
def geodetic_tracks(mean, covariance, latitude, longitude):  # type: ignore[no-untyped-def]
    """Latitude and longitude (N, 2), velocity (N, 2) and covariance (N, 4, 4) of tracks, of east and north there.

    Args: mean: (N, 4) or longer, in a plane; covariance: (N, 4, 4) or larger; latitude, longitude: of its origin, degrees.
    """
    frame = ecef_and_axes(latitude, longitude)
    degrees, velocity, turned = np.empty((len(mean), 2)), np.empty((len(mean), 2)), np.empty((len(mean), 4, 4))
    for n in range(len(mean)):
        degrees[n, 0], degrees[n, 1], turn = from_plane(mean[n, 0], mean[n, 1], frame)
        velocity[n, 0] = turn[0] * mean[n, 2] + turn[1] * mean[n, 3]
        velocity[n, 1] = turn[2] * mean[n, 2] + turn[3] * mean[n, 3]
        for a in (0, 2):
            for b in (0, 2):
                _rotate_block(covariance[n, a : a + 2, b : b + 2], turn, turned[n, a : a + 2, b : b + 2])
    return degrees, velocity, turned


@jit
def plot_covariances(position, radars, range_sigma, azimuth_sigma):  # type: ignore[no-untyped-def]
    """Covariance of one plot at each position, by the most accurate radar that covers it, else by the most accurate. (N, 2, 2)

    As `oracles.polar_textbook` of the tests has it. Args: position: (N, 2); radars: RadarColumns; range_sigma, azimuth_sigma: (R,).
    """
    out, short = np.zeros((len(position), 2, 2)), np.exp(-0.5 * azimuth_sigma**2)
    loss, shorter = 1.0 / short**2 - 2.0, short**4
    for n in range(len(position)):
        best, least, covered = -1, math.inf, False
        for r in range(len(range_sigma)):
            east, north = position[n, 0] - radars.site[r, 0], position[n, 1] - radars.site[r, 1]
            square = east * east + north * north
            inside, trace = square <= radars.range[r] * radars.range[r], (loss[r] + 1.0) * square + range_sigma[r] ** 2
            if (inside and not covered) or (inside == covered and trace < least):
                best, least, covered = r, trace, inside
        if best >= 0:
            east, north = position[n, 0] - radars.site[best, 0], position[n, 1] - radars.site[best, 1]
            square = east * east + north * north
            spread = square + range_sigma[best] ** 2
            sin2 = 2.0 * east * north / square if square > 0.0 else 0.0
            cos2 = (north * north - east * east) / square if square > 0.0 else 1.0
            missed, kept = loss[best] * square, shorter[best]
            out[n, 0, 0] = 0.5 * (missed * (1.0 - cos2) + spread * (1.0 - kept * cos2))
            out[n, 1, 1] = 0.5 * (missed * (1.0 + cos2) + spread * (1.0 + kept * cos2))
            out[n, 0, 1] = out[n, 1, 0] = 0.5 * sin2 * (missed + kept * spread)
    return out


@jit
def most_frequent_origins(origins, hits, rows):  # type: ignore[no-untyped-def]
    """The vessel most frequent among the newest plots of each track; of equals the one with the newest plot. (N,)

    Args: origins: (S, K) newest first; hits: (S,) plots of a track; rows: (N,) slots.
    """
    out = np.empty(len(rows), np.int64)
    for k in range(len(rows)):
        vessels, most = origins[rows[k], : hits[rows[k]]], 0
        for vessel in vessels:
            votes = 0
            for other in vessels:
                votes += other == vessel
            if votes > most:
                out[k], most = vessel, votes
    return out
