"""States at constant velocity, moved from their own times to one: compiled by numba, places in vector instructions."""

import math

import numpy as np

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, sine_cosine
from coastwatch.kernels.jit import jit

ROWS = 256  # at a time
LATITUDE, LONGITUDE, EAST, NORTH = range(4)  # of a row in the scratch: where it is, and how far it goes, m


@jit
def _moved(x):  # type: ignore[no-untyped-def]
    """Every place of the scratch (4, ROWS) as far on as it says, at mid-latitude."""
    for i in range(ROWS):
        latitude = x[LATITUDE, i]
        sine, _ = sine_cosine(latitude)
        w2 = 1.0 - ECCENTRICITY2 * sine * sine
        north = DEGREE * SEMI_MAJOR * (1.0 - ECCENTRICITY2) / (w2 * math.sqrt(w2))
        x[LATITUDE, i] = latitude + x[NORTH, i] / north
        sine, cosine = sine_cosine(0.5 * (latitude + x[LATITUDE, i]))
        east = DEGREE * SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sine * sine) * cosine
        longitude = x[LONGITUDE, i] + x[EAST, i] / east
        x[LONGITUDE, i] = longitude - (360.0 if longitude > 180.0 else -360.0 if longitude <= -180.0 else 0.0)


@jit
def _spread(covariance, n, dt, shake, spread):  # type: ignore[no-untyped-def]
    """The covariance of row n after dt, with white acceleration."""
    for i in range(2):
        for j in range(2):
            own = shake if i == j else 0.0
            pv, vp, vv = covariance[n, i, j + 2], covariance[n, i + 2, j], covariance[n, i + 2, j + 2]
            spread[n, i, j] = covariance[n, i, j] + dt * (pv + vp) + dt * dt * (vv + own / 3.0)
            spread[n, i, j + 2] = pv + dt * (vv + 0.5 * own)
            spread[n, i + 2, j] = vp + dt * (vv + 0.5 * own)
            spread[n, i + 2, j + 2] = vv + own


@jit
def advance(low, high, time, now, position, velocity, covariance, noise, moved, spread):  # type: ignore[no-untyped-def]
    """Rows low to high of positions and covariances at the time `now`, into the last two arguments.

    Args:
        time: (N,) s; now: s, before or after. position: (N, 2) latitude, longitude, degrees; velocity: (N, 2) east, north, m/s.
        covariance: (N, 4, 4) of east, north, east rate, north rate, may be NaN; noise: density of the white acceleration, m2/s3.
        moved: (N, 2), spread: (N, 4, 4): written.
    The plane turns under a ship by less than 1e-4 rad in ten seconds; the covariance is not turned with it.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, eq. 6.2.2-13.
    """
    x = np.zeros((4, ROWS))
    for first in range(low, high, ROWS):
        count = min(ROWS, high - first)
        for i in range(count):
            n = first + i
            dt = now - time[n]
            x[LATITUDE, i], x[LONGITUDE, i] = position[n, 0], position[n, 1]
            x[EAST, i], x[NORTH, i] = dt * velocity[n, 0], dt * velocity[n, 1]
        _moved(x)
        for i in range(count):
            n = first + i
            dt = now - time[n]
            moved[n, 0], moved[n, 1] = x[LATITUDE, i], x[LONGITUDE, i]
            _spread(covariance, n, dt, noise * abs(dt), spread)
