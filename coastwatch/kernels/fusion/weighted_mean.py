"""The weighted mean of the tracks of each vessel. Scalar code, compiled by numba; arguments as in `track_states`."""

from coastwatch.kernels.filters.symmetric4 import add_scaled, store
from coastwatch.kernels.fusion.track_states import copy_track, known_covariance, write
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@jit
def weighted_mean(first, last, start, row, tracks, sigma, weight, out):  # type: ignore[no-untyped-def]
    """Average the tracks of vessels first to last; the covariance is that of independent errors, sum w^2 P.

    Args: weight: (N,) of each track, the sum over the tracks of a vessel is 1.
    """
    position, velocity, covariance, report_covariance, _ = tracks
    for v in range(first, last):
        begin, end = start[v], start[v + 1]
        n = row[begin]
        if end - begin == 1:
            copy_track(tracks, sigma, n, out, v)
            continue
        lat, lon = position[n, 0], position[n, 1]
        east = north = east_rate = north_rate = 0.0
        total = ZERO
        for k in range(begin, end):
            n, w = row[k], weight[row[k]]
            to_east, to_north = enu_offset(position[n, 0], position[n, 1], lat, lon)
            east, north = east + w * to_east, north + w * to_north
            east_rate, north_rate = east_rate + w * velocity[n, 0], north_rate + w * velocity[n, 1]
            total = add_scaled(total, known_covariance(covariance, report_covariance, sigma, n), w * w)
        lat, lon = add_enu_offset(lat, lon, east, north)
        write(lat, lon, east_rate, north_rate, out, v)
        store(total, out[2], v)
