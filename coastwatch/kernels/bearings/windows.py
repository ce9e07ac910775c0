"""Windows of bearings and of positions, and the samples of a window: what a bearing is compared with, whichever vessel it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes
from coastwatch.kernels.jit import jit

AHEAD_S = 5.0  # by which a bearing may be later than the newest positions


class BearingWindows(NamedTuple):
    """The newest W bearings of N tracks, and what is known of the sensor of each track."""

    time: Floats  # (N, W) s, oldest first, NaN before the first bearing
    bearing: Floats  # (N, W) rad
    site: Floats  # (N, W, 2) degrees, where the sensor was
    log_density: Floats  # (N,) of unknown vessels by bearing, 1 / rad
    outside: Floats  # (N,) probability that a vessel outside the coverage is detected
    range: Floats  # (N,) m, of the coverage
    arc_from: Floats  # (N,) rad
    arc_width: Floats  # (N,) rad, 2 pi: all round
    bias: Floats  # (N,) rad
    bias_variance: Floats  # (N,)
    variance: Floats  # (N, W) of each bearing


class PositionWindows(NamedTuple):
    """Where vessels were at T instants. Each vessel has a slot."""

    time: Floats  # (T,) s, oldest first
    column: Ints  # (T,) where the values of each instant stand
    value: Floats  # (S, any, 4) ECEF position and its standard deviation per axis, m; NaN: absent


SAMPLE_NUMBERS = "weight bearing variance correlation log_density x y z sin_lat cos_lat sin_lon cos_lon"
SAMPLE = np.dtype([("before", np.int64), ("after", np.int64), *((name, np.float64) for name in SAMPLE_NUMBERS.split())])
"""One bearing of a window: columns of the instants before and after it, and the weight of the one after; the bearing without bias,
and its variance; correlation of position errors with those at the next newer bearing; log density of this and the newer bearings
under the null hypothesis; ECEF position and plane of the sensor."""


@jit
def sample_window(i, windows, positions, memory, null, out):  # type: ignore[no-untyped-def]
    """The bearings of track i, newest first, as long as there are positions before and after them.

    The clock of a sensor may be ahead: after the newest positions vessels go on as between the last two, for AHEAD_S at most.
    Args: memory: correlation time of position errors, s; null: (W + 1,) of `unknown_log_density`; out: (W,) SAMPLE, written.
    Returns: how many there are.
    """
    time, bearing, site, instant = windows.time, windows.bearing, windows.site, positions.time
    window, after = time.shape[1], len(instant) - 1
    for n in range(window):
        k, s = window - 1 - n, out[n]
        if math.isnan(time[i, k] + bearing[i, k] + site[i, k, 0] + site[i, k, 1]) or after < 1:
            return n
        while after > 1 and instant[after - 1] >= time[i, k]:
            after -= 1
        while after < len(instant) - 1 and instant[after] < time[i, k]:
            after += 1
        s.weight = (time[i, k] - instant[after - 1]) / (instant[after] - instant[after - 1])
        if not s.weight >= 0.0 or time[i, k] > instant[after] + AHEAD_S:
            return n
        s.before, s.after = positions.column[after - 1], positions.column[after]
        s.bearing, s.variance, s.log_density = bearing[i, k] - windows.bias[i], windows.variance[i, k], null[n + 1]
        s.correlation = math.exp(-abs(time[i, k + 1] - time[i, k]) / memory) if n > 0 else 1.0
        if n > 0 and site[i, k, 0] == site[i, k + 1, 0] and site[i, k, 1] == site[i, k + 1, 1]:
            newer = out[n - 1]
            s.x, s.y, s.z = newer.x, newer.y, newer.z
            s.sin_lat, s.cos_lat, s.sin_lon, s.cos_lon = newer.sin_lat, newer.cos_lat, newer.sin_lon, newer.cos_lon
        else:
            s.x, s.y, s.z, s.sin_lat, s.cos_lat, s.sin_lon, s.cos_lon = ecef_and_axes(site[i, k, 0], site[i, k, 1])
    return window


@jit
def relative_position(sample, value, slot):  # type: ignore[no-untyped-def]
    """East and north of a vessel from the sensor at the time of a bearing, and its standard deviation; NaN where it was absent.

    Args: value: of PositionWindows; slot: of the vessel.
    """
    b, a, share, rest = sample.before, sample.after, sample.weight, 1.0 - sample.weight
    dx = rest * value[slot, b, 0] + share * value[slot, a, 0] - sample.x
    dy = rest * value[slot, b, 1] + share * value[slot, a, 1] - sample.y
    dz = rest * value[slot, b, 2] + share * value[slot, a, 2] - sample.z
    outward = sample.cos_lon * dx + sample.sin_lon * dy
    east, north = sample.cos_lon * dy - sample.sin_lon * dx, sample.cos_lat * dz - sample.sin_lat * outward
    return east, north, rest * value[slot, b, 3] + share * value[slot, a, 3]
