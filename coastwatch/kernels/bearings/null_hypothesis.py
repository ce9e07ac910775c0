"""Likelihoods of windows of bearings, if they come from vessels that nobody else has seen. LANES tracks at a time, by numba.

A window is a row, oldest first, NaN before the first bearing; it is walked from the newest bearing back. What a track gets is the same to
the bit as alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks
from coastwatch.kernels.vectorised_math import WHOLE, exponential, logarithm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOG_2PI = math.log(2.0 * math.pi)
TURN = 2.0 * math.pi
LANES = 32
RANGES = 8  # at most
TIME, GAP, BEARING, VARIANCE, MOST, MIXED, SHARED = range(7)  # of a track; SHARED: how many
THETA, RATE, P00, P01, P11, TOTAL, NOISE, EACH = range(8)  # of a track at a range
ROWS = SHARED + RANGES * EACH


class Strangers(NamedTuple):
    """What is taken of vessels that nobody has seen: J ranges, as shares of a sensor's reach."""

    share: Floats  # (J,)
    weight: Floats  # (J,) sum 1
    speed: float  # m/s, standard deviation per axis
    kick: float  # m^2/s^3, variance of its changes of velocity over a second


@jit
def short_way(angle):  # type: ignore[no-untyped-def]
    """The angle in [-pi, pi]."""
    return angle - TURN * ((angle * (1.0 / TURN) + WHOLE) - WHOLE)


@jit
def _begun(first, count, row, variance, reach, strangers, x):  # type: ignore[no-untyped-def]
    """The tracks from `first` on into the lanes, before any bearing; lanes that are too many repeat the last."""
    for t in range(LANES):
        i = row[first + min(t, count - 1)]
        x[VARIANCE, t], x[TIME, t] = variance[i], 0.0
        for j in range(len(strangers.share)):
            angular, at = strangers.speed / (reach[i] * strangers.share[j]), SHARED + j * EACH
            x[at + THETA, t], x[at + RATE, t], x[at + TOTAL, t] = 0.0, 0.0, 0.0
            x[at + P00, t], x[at + P01, t], x[at + P11, t] = 0.0, 0.0, angular * angular
            x[at + NOISE, t] = angular**3 + strangers.kick * (angular / strangers.speed) ** 2


@jit
def _looked(first, count, k, row, time, bearing, x):  # type: ignore[no-untyped-def]
    """Bearing k of each track into its lane, and by how much it is older than the one before. Returns: whether there is any."""
    some = False
    for t in range(LANES):
        i = row[first + min(t, count - 1)]
        x[BEARING, t] = bearing[i, k]
        x[GAP, t] = time[i, k] - x[TIME, t]
        x[TIME, t] = time[i, k]
        some |= not math.isnan(bearing[i, k])
    return some


@jit
def _first(j, x):  # type: ignore[no-untyped-def]
    """The newest bearing: its offset is flat, with density 1."""
    at = SHARED + j * EACH
    for t in range(LANES):
        x[at + THETA, t], x[at + P00, t] = x[BEARING, t], x[VARIANCE, t]


@jit
def _next(j, x):  # type: ignore[no-untyped-def]
    """One more bearing of a vessel whose bearing has a random rate that wanders, at one range."""
    at = SHARED + j * EACH
    for t in range(LANES):
        dt, variance, noise = x[GAP, t], x[VARIANCE, t], x[at + NOISE, t]
        a = abs(dt)
        rate, p01, p11 = x[at + RATE, t], x[at + P01, t], x[at + P11, t]
        theta = x[at + THETA, t] + dt * rate
        p00 = x[at + P00, t] + (2.0 * dt * p01 + dt * dt * p11 + noise * a * a * a * (1.0 / 3.0))
        p01 += dt * p11 + 0.5 * noise * a * dt
        p11 += noise * a
        s = p00 + variance
        v = short_way(x[BEARING, t] - theta)
        shrunk = 1.0 / s
        g0, g1 = p00 * shrunk, p01 * shrunk
        density = -0.5 * (LOG_2PI + logarithm(s) + v * v * shrunk)
        x[at + TOTAL, t] += density if density == density else 0.0  # no bearing: nothing is added any more
        x[at + THETA, t] = theta + g0 * v
        x[at + RATE, t] = rate + g1 * v
        x[at + P00, t], x[at + P01, t], x[at + P11, t] = p00 - g0 * p00, p01 - g0 * p01, p11 - g1 * p01


@jit
def _mixed(strangers, x):  # type: ignore[no-untyped-def]
    """The log of the weighted sum over the ranges, into MIXED."""
    ranges = len(strangers.share)
    for t in range(LANES):
        x[MOST, t], x[MIXED, t] = x[SHARED + TOTAL, t], 0.0
    for j in range(1, ranges):
        for t in range(LANES):
            x[MOST, t] = max(x[MOST, t], x[SHARED + j * EACH + TOTAL, t])
    for j in range(ranges):
        weight = strangers.weight[j]
        for t in range(LANES):
            x[MIXED, t] += weight * exponential(x[SHARED + j * EACH + TOTAL, t] - x[MOST, t])
    for t in range(LANES):
        x[MIXED, t] = x[MOST, t] + logarithm(x[MIXED, t])


@jit
def _unknown(low, high, row, time, bearing, variance, reach, strangers, out):  # type: ignore[no-untyped-def]
    x, w = np.empty((ROWS, LANES)), time.shape[1]  # a shape that is known here: only then loops become vector instructions
    for first in range(low, high, LANES):
        count = min(LANES, high - first)
        _begun(first, count, row, variance, reach, strangers, x)
        out[first : first + count, 0] = 0.0
        for n in range(1, w + 1):
            if not _looked(first, count, w - n, row, time, bearing, x):
                for t in range(count):
                    out[first + t, n:] = out[first + t, n - 1]
                break
            for j in range(len(strangers.share)):
                if n == 1:
                    _first(j, x)
                else:
                    _next(j, x)
            _mixed(strangers, x)
            for t in range(count):
                out[first + t, n] = out[first + t, n - 1] if math.isnan(x[BEARING, t]) else x[MIXED, t]


def unknown_vessels(row: Ints, time: Floats, bearing: Floats, variance: Floats, reach: Floats, strangers: Strangers) -> Floats:
    """Log density of the newest n bearings of each track, if they come from a vessel anywhere in reach.

    The range is one of `reach * share`, with these weights; at range r the bearing rate is N(0, (speed / r)^2) and wanders,
    by the geometry of a straight course (variance (speed / r)^3 a second) and by changes of course (kick / r^2). The bearing
    itself is flat with density 1 a radian.
    Args: row: (R,) the tracks that are wanted; time, bearing: (N, W) s, rad; variance: (N,) rad^2 of a bearing; reach: (N,) m.
    Returns: (R, W + 1), column n for n bearings; where there are fewer, that of all.
    Raises: ValueError for more than RANGES ranges.
    """
    if len(strangers.share) > RANGES:
        raise ValueError(f"Strangers.share: got {len(strangers.share)} ranges, needed at most {RANGES}")
    out = np.empty((len(row), time.shape[1] + 1))
    in_blocks(_unknown, len(row), row, time, bearing, variance, reach, strangers, out, least=8 * LANES)
    return out
