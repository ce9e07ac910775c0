"""The weighted average of the tracks of each vessel. Scalar code compiled by numba, arguments as in `fusing`."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.filters.symmetric4 import put, towards
from coastwatch.kernels.fusion.covariance_intersection import alone, ask, known
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import longest

NONE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@jit
def _weights(begin, end, row, tracks, sigma, source, share, kind, weight):  # type: ignore[no-untyped-def]
    """Weights of the tracks of a vessel that add up to one, into `weight`."""
    total = 0.0
    for k in range(end - begin):
        n = row[begin + k]
        if len(share) == 0:
            c = known(tracks, n, sigma)
            weight[k] = 1.0 / (c[0] + c[2])
        else:
            alike = 0
            for m in range(begin, end):
                alike += kind[source[row[m]]] == kind[source[n]]
            weight[k] = share[source[n]] / alike
        total += weight[k]
    for k in range(end - begin):
        weight[k] = weight[k] / total if total > 0.0 else 1.0 / (end - begin)


@jit
def average(low, high, start, row, tracks, sigma, source, share, kind, out):  # type: ignore[no-untyped-def]
    """Vessels low to high as the average of their tracks about the first of them; the covariance is that of independent errors.

    Args: source: (N,) of each track; share, kind: of each source the weight that tracks of its kind have between them; no shares: every
    track weighs one over the variance of its place.
    """
    room = np.empty(longest(low, high, start))
    _average(low, high, start, row, tracks, sigma, source, share, kind, room, out)


@jit
def _average(low, high, start, row, tracks, sigma, source, share, kind, weight, out):  # type: ignore[no-untyped-def]
    """The same with room to work in, `weight`."""
    position, velocity = tracks[0], tracks[1]
    for v in range(low, high):
        begin, end = start[v], start[v + 1]
        ask(tracks, row, begin, end)
        first = row[begin]
        if end - begin == 1:
            alone(tracks, first, sigma, out, v)
            continue
        _weights(begin, end, row, tracks, sigma, source, share, kind, weight)
        lat, lon = position[first, 0], position[first, 1]
        east = north = east_rate = north_rate = 0.0
        covariance = NONE
        for k in range(end - begin):
            n, w = row[begin + k], weight[k]
            to_east, to_north = enu_offset(position[n, 0], position[n, 1], lat, lon)
            east, north = east + w * to_east, north + w * to_north
            east_rate, north_rate = east_rate + w * velocity[n, 0], north_rate + w * velocity[n, 1]
            covariance = towards(covariance, known(tracks, n, sigma), w * w)
        out[0][v, 0], out[0][v, 1] = add_enu_offset(lat, lon, east, north)
        out[1][v, 0], out[1][v, 1] = east_rate, north_rate
        put(covariance, out[2], v)
