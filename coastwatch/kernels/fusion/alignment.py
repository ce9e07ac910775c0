"""Tracks at constant velocity, moved from their own times to one time. Scalar code, compiled by numba."""

from coastwatch.kernels.geometry.ellipsoid import add_enu_offset
from coastwatch.kernels.jit import jit


@jit
def advance(first, last, dt, tracks, noise, moved, spread):  # type: ignore[no-untyped-def]
    """Positions and covariances of tracks first to last after dt: x = x + dt v, P = F P F' + Q.

    Args:
        dt: (N,) s, may be negative. noise: density of white acceleration, m2/s3.
        tracks: a tuple of position (N, 2) latitude and longitude, degrees, velocity (N, 2) east and north, and covariance (N, 4, 4),
        which may be NaN.
        moved: (N, 2), spread: (N, 4, 4): written.
    The plane turns under a ship by less than 1e-4 rad in ten seconds; the covariance is not turned with it.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, eq. 6.2.2-13.
    """
    position, velocity, covariance = tracks
    for n in range(first, last):
        t, q = dt[n], noise * abs(dt[n])
        moved[n, 0], moved[n, 1] = add_enu_offset(position[n, 0], position[n, 1], t * velocity[n, 0], t * velocity[n, 1])
        for i in range(2):
            for j in range(2):
                pv, vp, vv = covariance[n, i, j + 2], covariance[n, i + 2, j], covariance[n, i + 2, j + 2]
                white = q if i == j else 0.0
                spread[n, i, j] = covariance[n, i, j] + t * (pv + vp) + t * t * (vv + white / 3.0)
                spread[n, i, j + 2] = pv + t * (vv + 0.5 * white)
                spread[n, i + 2, j] = vp + t * (vv + 0.5 * white)
                spread[n, i + 2, j + 2] = vv + white
