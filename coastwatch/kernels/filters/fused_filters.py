"""One IMM filter a vessel over the plots and reports of all its tracks: update by measurements, and estimate.

Filters are a tuple of state (F, J, 5), covariance (F, J, 5, 5), mode_probability (F, J), updated (F,), the time of the newest
measurement, and judged (F,), the time up to which jumps of the velocity are decided. States are in the plane at the anchor of each
filter. Scalar code, compiled by numba. The filter is that of `imm`, with jumps of the velocity. A jump is decided by a measured
velocity over all the time since the last one: a position alone tells little, and would blur what the velocity then decides.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from coastwatch.kernels.filters import imm, motion_models
from coastwatch.kernels.filters.kalman import MANOEUVRE, SIZE
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

LONGEST = 60.0  # s without a decision on jumps: then a position decides
OUTLIER = 16.0  # squared distance of a velocity that no alternative explains: it teaches nothing
LEAST_EVIDENCE = math.exp(-3.0)  # likelihood of an alternative over the best one, at least: no report decides alone


class TimedMeasurements(NamedTuple):
    """Measurements of filters, those of each filter in order of time."""

    time: Any  # (M,)
    z: Any  # (M, 4) east, north, east rate, north rate; NaN rates where none were measured
    noise: Any  # R, (M, 4, 4)
    doubt: Any  # (M,) normalised innovation squared of a position beyond which its noise grows; infinite: never
    decides: Any  # (M,) whether it decides on jumps of the velocity


class Alternatives(NamedTuple):
    """Values of the first model that are compared by the evidence of measured velocities."""

    jump_variance: Any  # (A,) m2/s2
    sojourn: Any  # (B,) s


@jit
def update(first, last, filters, measurements, begin, models, alternatives, evidence):  # type: ignore[no-untyped-def]
    """Update filters first to last by their measurements, in place.

    A measurement older than its filter is moved to the filter's time by the velocity. A replay in order would take 0.6 % off the
    error if every report is 2 s late and more (scaling/decisions/central_imm.py).
    Args: measurements: TimedMeasurements; begin: (F + 1,) those of filter f are begin[f] to begin[f + 1]; models: (J,) MODEL;
    alternatives: Alternatives; evidence: (F, A + B), to which the log-likelihood of each is added.
    """
    measured, z, noise, doubt, decides = measurements
    state, covariance, mode_probability, updated, judged = filters
    work, mean, spread = imm.workspace(len(models)), np.empty(SIZE), np.empty((SIZE, SIZE))
    local, r = np.empty(4), np.empty((4, 4))
    for f in range(first, last):
        for m in range(begin[f], begin[f + 1]):
            dt = measured[m] - updated[f]
            copy_into(local, z[m])
            copy_into(r, noise[m])
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
                _add_jumps(spread, mode_probability[f], models, updated[f] - judged[f])
                _widen_doubtful(local, r, mean, spread, doubt[m])
            known, pending = local[:2] if math.isnan(local[2]) else local, updated[f] - judged[f]
            if decides[m] or pending > LONGEST:
                steady = mode_probability[f, 0]
                if len(known) > 2 and pending > 0.0:
                    before = state[f, 0], covariance[f, 0]
                    _compare_jumps(known, r, before, steady, models[0], pending, alternatives.jump_variance, evidence[f])
                imm.update_with_jumps(state[f], covariance[f], mode_probability[f], models, pending, known, r, work)
                if len(known) > 2 and pending > 0.0:
                    _compare_sojourns(steady, mode_probability[f, 0], pending, alternatives, evidence[f])
                judged[f] = updated[f]
            else:
                imm.update_filter(state[f], covariance[f], mode_probability[f], known, r, work)


@jit
def _compare_jumps(z, noise, before, steady, model, dt, jump_variance, evidence):  # type: ignore[no-untyped-def]
    """Add to the evidence how well each variance of a jump explains a velocity, weighted with the probability of the steady model.

    A jump has come within dt with the model's rate.
    Args: before: mean (5,) and covariance (5, 5) of the steady model before the update; steady: its probability; jump_variance: (A,).
    """
    mean, covariance = before
    x, y = z[2] - mean[2], z[3] - mean[3]
    between, probability = covariance[2, 3] + noise[2, 3], 1.0 - math.exp(-model.jump_rate * dt)
    stay, best, nearest = 0.0, -math.inf, math.inf
    count = len(jump_variance)
    likelihood = np.empty(count)
    for k in range(-1, count):  # without a jump first
        more = jump_variance[k] if k >= 0 else 0.0
        east, north = covariance[2, 2] + noise[2, 2] + more, covariance[3, 3] + noise[3, 3] + more
        determinant = east * north - between * between
        distance = (x * x * north - 2.0 * x * y * between + y * y * east) / determinant
        log_likelihood = -0.5 * (distance + math.log(determinant))
        nearest = min(nearest, distance)
        if k < 0:
            stay = math.log(1.0 - probability) + log_likelihood
        else:
            jump = math.log(probability) + log_likelihood
            likelihood[k] = max(stay, jump) + math.log1p(math.exp(-abs(stay - jump)))
            best = max(best, likelihood[k])
    if nearest < OUTLIER:
        for k in range(count):
            evidence[k] += steady * math.log(math.exp(likelihood[k] - best) + LEAST_EVIDENCE)


@jit
def _compare_sojourns(before, after, dt, alternatives, evidence):  # type: ignore[no-untyped-def]
    """Add to the evidence how well each mean time in the steady model explains a measurement that changed its probability.

    Args: before, after: probability of the steady model; the ratio of its odds is the likelihood of the measurement in other models.
    """
    odds = max(1.0 - after, imm.FLOOR) / max(after, imm.FLOOR) * before / max(1.0 - before, imm.FLOOR)
    first, count = len(alternatives.jump_variance), len(alternatives.sojourn)
    likelihood, best = np.empty(count), 0.0
    for k in range(count):
        left = 1.0 - math.exp(-dt / alternatives.sojourn[k])
        likelihood[k] = 1.0 - left + left * odds
        best = max(best, likelihood[k])
    for k in range(count):
        evidence[first + k] += before * math.log(likelihood[k] / best + LEAST_EVIDENCE)


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
    states, covariances, probabilities, updated, judged = filters
    state, spread, mode = np.empty((len(models), SIZE)), np.empty((len(models), SIZE, SIZE)), np.empty(len(models))
    work = imm.workspace(len(models))
    for f in range(first, last):
        copy_into(state, states[f])
        copy_into(spread, covariances[f])
        copy_into(mode, probabilities[f])
        dt = max(time - updated[f], 0.0)
        imm.predict_filter(state, spread, mode, models, dt, math.inf, work)
        pending = max(time, updated[f]) - judged[f]
        for j in range(len(models)):
            jumped = 1.0 - math.exp(-models[j].jump_rate * pending)
            motion_models.add_velocity_noise(spread[j], jumped * models[j].jump_variance, pending)
        imm.moments(state, spread, mode, mean[f], covariance[f])
