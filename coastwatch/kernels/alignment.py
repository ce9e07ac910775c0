"""States at constant velocity, moved from their own times to one: scalar code a row, compiled by numba."""

import math

from numba import njit

SEMI_MAJOR = 6378137.0
ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563


@njit(cache=True, nogil=True)
def advance(low, high, time, now, position, velocity, covariance, noise, moved, spread):  # type: ignore[no-untyped-def]
    """Rows low to high of positions and covariances at the time `now`, into the last two arguments.

    Args:
        time: (N,) s; now: s, before or after. position: (N, 2) latitude, longitude, degrees; velocity: (N, 2) east, north, m/s.
        covariance: (N, 4, 4) of east, north, east rate, north rate, may be NaN; noise: density of the white acceleration, m2/s3.
        moved: (N, 2), spread: (N, 4, 4): written.
    The plane turns under a ship by less than 1e-4 rad in ten seconds; the covariance is not turned with it.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, eq. 6.2.2-13.
    """
    for n in range(low, high):
        dt = now - time[n]
        sine = math.sin(math.radians(position[n, 0]))
        w2 = 1.0 - ECCENTRICITY2 * sine * sine
        north = math.radians(SEMI_MAJOR * (1.0 - ECCENTRICITY2) / (w2 * math.sqrt(w2)))
        moved[n, 0] = position[n, 0] + dt * velocity[n, 1] / north
        sine = math.sin(math.radians(0.5 * (position[n, 0] + moved[n, 0])))
        w2 = 1.0 - ECCENTRICITY2 * sine * sine
        east = math.radians(SEMI_MAJOR / math.sqrt(w2)) * math.cos(math.radians(0.5 * (position[n, 0] + moved[n, 0])))
        longitude = position[n, 1] + dt * velocity[n, 0] / east
        if longitude > 180.0:
            longitude -= 360.0
        elif longitude <= -180.0:
            longitude += 360.0
        moved[n, 1] = longitude
        shake = noise * abs(dt)
        for i in range(2):
            for j in range(2):
                own = shake if i == j else 0.0
                pv, vp, vv = covariance[n, i, j + 2], covariance[n, i + 2, j], covariance[n, i + 2, j + 2]
                spread[n, i, j] = covariance[n, i, j] + dt * (pv + vp) + dt * dt * (vv + own / 3.0)
                spread[n, i, j + 2] = pv + dt * (vv + 0.5 * own)
                spread[n, i + 2, j] = vp + dt * (vv + 0.5 * own)
                spread[n, i + 2, j + 2] = vv + own
