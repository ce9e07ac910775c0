"""One IMM filter a vessel over the plots and reports of all its tracks: update by measurements, and estimate.

Filters are a tuple of state (F, J, 5), covariance (F, J, 5, 5), mode_probability (F, J), and updated (F,), the time of the newest
measurement. States are in the plane at the anchor of each filter. Scalar code, compiled by numba. The filter is that of `imm`, with
jumps of the velocity.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from coastwatch.kernels.filters import imm, motion_models
from coastwatch.kernels.filters.kalman import MANOEUVRE, SIZE
from coastwatch.kernels.jit import jit


class TimedMeasurements(NamedTuple):
    """Measurements of filters, those of each filter in order of time."""

    time: Any  # (M,)
    z: Any  # (M, 4) east, north, east rate, north rate; NaN rates where none were measured
    noise: Any  # R, (M, 4, 4)
    doubt: Any  # (M,) normalised innovation squared of a position beyond which its noise grows; infinite: never


@jit
def update(first, last, filters, measurements, begin, models):  # type: ignore[no-untyped-def]
    """Update filters first to last by their measurements, in place.

    A measurement older than its filter is moved to the filter's time by the velocity. A replay in order would take 0.6 % off the
    error if every report is 2 s late and more (scaling/decisions/central_imm.py).
    Args: measurements: TimedMeasurements; begin: (F + 1,) those of filter f are begin[f] to begin[f + 1]; models: (J,) MODEL.
    """
    measured, z, noise, doubt = measurements
    state, covariance, mode_probability, updated = filters
    work, mean, spread = imm.workspace(len(models)), np.empty(SIZE), np.empty((SIZE, SIZE))
    local, r = np.empty(4), np.empty((4, 4))
    for f in range(first, last):
        for m in range(begin[f], begin[f + 1]):
            dt = measured[m] - updated[f]
            local[:] = z[m]
            r[:] = noise[m]
            if dt > 0.0:
                imm.predict_filter(state[f], covariance[f], mode_probability[f], models, dt, math.inf, work)
                updated[f] = measured[m]
            else:
                imm.moments(state[f], covariance[f], mode_probability[f], mean, spread)
                imm.bring_forward(local, r, -dt, mean, spread)
                sin, cos = math.sin(-dt * mean[MANOEUVRE]), math.cos(-dt * mean[MANOEUVRE])  # to port
                local[2], local[3] = cos * local[2] - sin * local[3], sin * local[2] + cos * local[3]
            if doubt[m] < math.inf:
                imm.moments(state[f], covariance[f], mode_probability[f], mean, spread)
                _add_jumps(spread, mode_probability[f], models, max(dt, 0.0))
                _widen_doubtful(local, r, mean, spread, doubt[m])
            known = local[:2] if math.isnan(local[2]) else local
            imm.update_with_jumps(state[f], covariance[f], mode_probability[f], models, max(dt, 0.0), known, r, work)


@jit
def _add_jumps(covariance, mode_probability, models, dt):  # type: ignore[no-untyped-def]
    """Add what jumps of the velocity within dt may have done to the estimate over all models, in place."""
    for j in range(len(models)):
        jumped = mode_probability[j] * (1.0 - math.exp(-models[j].jump_rate * dt))
        motion_models.add_velocity_noise(covariance, jumped * models[j].jump_variance, dt)


@jit
def _widen_doubtful(z, noise, mean, covariance, doubt):  # type: ignore[no-untyped-def]
    """Multiply the noise of a position by (NIS / doubt)^2 where its normalised innovation squared exceeds `doubt`, in place.

    So an echo of another vessel hardly moves the filter, and no jump is made where the test changes its mind.
    Source: P. J. Huber, Robust Statistics, 1981, section 4.8 (descending M-estimates).
    """
    east, between, north = covariance[0, 0] + noise[0, 0], covariance[0, 1] + noise[0, 1], covariance[1, 1] + noise[1, 1]
    x, y = z[0] - mean[0], z[1] - mean[1]
    distance = (x * x * north - 2.0 * x * y * between + y * y * east) / (east * north - between * between)
    if distance > doubt:
        for a in range(2):
            for b in range(2):
                noise[a, b] *= (distance / doubt) ** 2


@jit
def estimate(first, last, filters, time, models, mean, covariance):  # type: ignore[no-untyped-def]
    """Predict filters first to last to a time, and average over their models; the filters stay.

    A filter that was updated later is not taken back. Args: models: (J,) MODEL; mean: (F, 5) and covariance: (F, 5, 5): written.
    """
    states, covariances, probabilities, updated = filters
    state, spread, mode = np.empty((len(models), SIZE)), np.empty((len(models), SIZE, SIZE)), np.empty(len(models))
    work = imm.workspace(len(models))
    for f in range(first, last):
        state[:] = states[f]
        spread[:] = covariances[f]
        mode[:] = probabilities[f]
        dt = max(time - updated[f], 0.0)
        imm.predict_filter(state, spread, mode, models, dt, math.inf, work)
        for j in range(len(models)):
            jumped = 1.0 - math.exp(-models[j].jump_rate * dt)
            motion_models.add_velocity_noise(spread[j], jumped * models[j].jump_variance, dt)
        imm.moments(state, spread, mode, mean[f], covariance[f])
