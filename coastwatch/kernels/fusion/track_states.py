"""How the methods of fusion read the tracks of a vessel and write its estimate. Scalar code, compiled by numba.

Arguments that recur:
    start, row: the tracks of vessel v are row[start[v]:start[v + 1]].
    tracks: a tuple of position (N, 2) degrees, velocity (N, 2), covariance (N, 4, 4), report_covariance (N, 2, 2) and mmsi (N,), -1
        where unknown. The lower triangle of a covariance is read. If it is not finite, report_covariance is used instead.
    sigma: standard deviation of a velocity whose covariance is not known, m/s.
    out: a tuple of position (V, 2), velocity (V, 2) and covariance (V, 4, 4), of which a call writes the rows of its vessels.
Matrices are tuples, see `symmetric4`.
"""

from coastwatch.kernels.filters.symmetric4 import determinant, load, store
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into


@jit
def is_finite(covariance, n):  # type: ignore[no-untyped-def]
    """Whether every number of matrix n of (N, 4, 4) is finite."""
    total = 0.0
    for a in range(4):
        for b in range(4):
            total += covariance[n, a, b]
    return 0.0 * total == 0.0


@jit
def known_covariance(covariance, report_covariance, sigma, n):  # type: ignore[no-untyped-def]
    """Covariance of track n; where the source gives none, the covariance of one report, and of a velocity known to sigma."""
    if is_finite(covariance, n):
        return load(covariance, n)
    report, variance = report_covariance[n], sigma * sigma
    return report[0, 0], report[1, 0], report[1, 1], 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance


@jit
def copy_track(tracks, sigma, n, out, v):  # type: ignore[no-untyped-def]
    """Write track n as vessel v, to the bit where it has a covariance."""
    position, velocity, covariance, report_covariance, _ = tracks
    write(position[n, 0], position[n, 1], velocity[n, 0], velocity[n, 1], out, v)
    if is_finite(covariance, n):
        copy_into(out[2][v], covariance[n])
    else:
        store(known_covariance(covariance, report_covariance, sigma, n), out[2], v)


@jit
def write(lat, lon, east_rate, north_rate, out, v):  # type: ignore[no-untyped-def]
    """Write position and velocity of vessel v."""
    out[0][v, 0], out[0][v, 1] = lat, lon
    out[1][v, 0], out[1][v, 1] = east_rate, north_rate


@jit
def read_covariances(tracks, sigma, registration, row, begin, matrices):  # type: ignore[no-untyped-def]
    """Write the covariances with which the tracks row[begin:begin + len(matrices)] count, (n, 4, 4).

    Args: registration: share of a report's covariance that is added to the position of a track without MMSI.
    """
    _, _, covariance, report_covariance, mmsi = tracks
    for k in range(len(matrices)):
        n = row[begin + k]
        store(known_covariance(covariance, report_covariance, sigma, n), matrices, k)
        if registration > 0.0 and mmsi[n] < 0:
            for a in range(2):
                for b in range(2):
                    matrices[k, a, b] += registration * report_covariance[n, max(a, b), min(a, b)]


@jit
def most_precise_first(matrices, size, order):  # type: ignore[no-untyped-def]
    """Write the indices of matrices, the smallest determinant first, equal ones as they come. Args: size: (n,) to work in."""
    for k in range(len(matrices)):
        size[k] = determinant(load(matrices, k))
        at = k
        while at > 0 and size[order[at - 1]] > size[k]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = k
