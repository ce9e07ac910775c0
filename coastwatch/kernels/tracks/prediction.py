"""The combined estimate of a track predicted at constant velocity. Scalar code, compiled by numba.

Gates and tests for duplicates need no model of the filter: between two plots of a track, the mixture moves as its mean, and white
acceleration of the models' average density widens it.
"""

from coastwatch.kernels.jit import jit


@jit
def predicted_position(estimates, n, time):  # type: ignore[no-untyped-def]
    """East and north of an estimate at a time, before or after its own."""
    dt = time - estimates.time[n]
    return estimates.mean[n, 0] + dt * estimates.mean[n, 2], estimates.mean[n, 1] + dt * estimates.mean[n, 3]


@jit
def predicted_position_covariance(estimates, n, time):  # type: ignore[no-untyped-def]
    """Variance of east, covariance, variance of north of an estimate at a time.

    At a time before its own an estimate is as uncertain as now, and by its velocity: as a late plot is brought forward in
    `filters.imm.bring_forward`.
    """
    dt, p = time - estimates.time[n], estimates.covariance[n]
    if dt < 0.0:
        return p[0, 0] + dt * dt * p[2, 2], p[1, 0] + dt * dt * p[3, 2], p[1, 1] + dt * dt * p[3, 3]
    q = estimates.noise[n] * dt * dt * dt / 3.0
    return (
        p[0, 0] + dt * (2.0 * p[2, 0] + dt * p[2, 2]) + q,
        p[1, 0] + dt * (p[2, 1] + p[3, 0] + dt * p[3, 2]),
        p[1, 1] + dt * (2.0 * p[3, 1] + dt * p[3, 3]) + q,
    )


@jit
def predicted_covariance(estimates, n, time):  # type: ignore[no-untyped-def]
    """Covariance of an estimate at a time not before its own: the lower triangle, as in `filters.symmetric4`."""
    dt, p = time - estimates.time[n], estimates.covariance[n]
    ee, ne, nn = predicted_position_covariance(estimates, n, time)
    q = estimates.noise[n] * dt
    return (
        ee,
        ne,
        nn,
        p[2, 0] + dt * p[2, 2] + 0.5 * q * dt,
        p[2, 1] + dt * p[3, 2],
        p[2, 2] + q,
        p[3, 0] + dt * p[3, 2],
        p[3, 1] + dt * p[3, 3] + 0.5 * q * dt,
        p[3, 2],
        p[3, 3] + q,
    )
