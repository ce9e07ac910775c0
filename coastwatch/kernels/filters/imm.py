"""Interacting multiple models: one filter holds J models, each with a state, a covariance and a probability.

A cycle of a filter mixes the models, predicts and updates each of them, and updates the mode probabilities by the likelihoods of
the measurement. There are two ways to mix, for two assumptions on how a vessel changes its motion:
    mix          a Markov chain: a model is left at the rate 1 / sojourn; all other models are equally likely next
    mix_renewed  a renewal process: at the rate 1 / renewal the model is drawn from the prior probabilities, and its manoeuvre from
                 the prior of that model; position and velocity stay
`update_with_jumps` has two hypotheses in each model: with and without a jump of the velocity since the last measurement. They are
merged at once (first-order generalised pseudo-Bayesian, GPB1). So a jump needs no model of its own, and no large process noise.

A function with "filter" in its name takes one: state (J, 5), covariance (J, 5, 5), mode_probability (J,), models (J,) MODEL, and
overwrites the first three. A function with "filters" takes N, (N, J, ...). Where dt is 0 nothing changes. Scalar code, compiled by numba:
the answer for a filter does not depend on the others.

Sources: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 11.6.6 (IMM)
and 11.6.4 (GPB1); K. Granstrom, P. Willett, Y. Bar-Shalom, Systematic approach to IMM mixing for unequal dimension states, IEEE
Trans. AES 51(4), 2015 (a component that the other model does not have is drawn from its prior).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Bools, Floats, Records
from coastwatch.kernels.filters import kalman, motion_models
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.kalman import EAST_RATE, LOG_TWO_PI, MANOEUVRE, NORTH_RATE, SIZE
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

FLOOR = 1e-12  # least mode probability, so that a model can recover and nothing is divided by 0


class Workspace(NamedTuple):
    """Memory in which the functions for one filter work; its content means nothing between two calls."""

    state: Floats  # (J, 5) the models before they are mixed
    covariance: Floats  # (J, 5, 5)
    mixing: Floats  # (J, J)
    log_weight: Floats  # (J,)
    distance: Floats  # (J,)
    mean: Floats  # (5,) of all models, or of a second hypothesis
    spread: Floats  # (5, 5) its covariance
    transition: Floats  # (5, 5) F
    root: Floats  # (4, 4) of the covariance of an innovation
    gain: Floats  # (4, 5)
    residual: Floats  # (4,)


@jit
def workspace(models):  # type: ignore[no-untyped-def]
    """A Workspace for filters of so many models."""
    return Workspace(
        np.zeros((models, SIZE)),
        np.zeros((models, SIZE, SIZE)),
        np.zeros((models, models)),
        np.zeros(models),
        np.zeros(models),
        np.zeros(SIZE),
        np.zeros((SIZE, SIZE)),
        np.zeros((SIZE, SIZE)),
        np.zeros((4, 4)),
        np.zeros((4, SIZE)),
        np.zeros(4),
    )


@jit
def moments(states, covariances, weights, mean, covariance):  # type: ignore[no-untyped-def]
    """Mean and covariance of a mixture of Gaussians, into the last two. m = sum w x; P = sum w (P + (x - m)(x - m)').

    Args: states: (J, 5); covariances: (J, 5, 5); weights: (J,), their sum is 1; mean: (5,); covariance: (5, 5).
    """
    for a in range(SIZE):
        mean[a] = 0.0
        for b in range(SIZE):
            covariance[a, b] = 0.0
    for i in range(len(weights)):
        for a in range(SIZE):
            mean[a] += weights[i] * states[i, a]
    for i in range(len(weights)):
        for a in range(SIZE):
            apart = states[i, a] - mean[a]
            for b in range(a + 1):
                covariance[a, b] += weights[i] * (covariances[i, a, b] + apart * (states[i, b] - mean[b]))
    for a in range(SIZE):
        for b in range(a):
            covariance[b, a] = covariance[a, b]


@jit
def merge(mean, covariance, weight, other_mean, other_covariance):  # type: ignore[no-untyped-def]
    """A Gaussian becomes the moments of a mixture, in which it has this weight and another Gaussian the rest."""
    rest = 1.0 - weight
    for a in range(SIZE):
        apart = mean[a] - other_mean[a]
        for b in range(a + 1):
            between = weight * rest * apart * (mean[b] - other_mean[b])
            covariance[a, b] = weight * covariance[a, b] + rest * other_covariance[a, b] + between
            covariance[b, a] = covariance[a, b]
    for a in range(SIZE):
        mean[a] = other_mean[a] + weight * (mean[a] - other_mean[a])


@jit
def mixing_probabilities(mode_probability, models, dt, mixing):  # type: ignore[no-untyped-def]
    """Predict the mode probabilities of a Markov chain in place; mixing[j, i]: probability of model i before, given model j now.

    The probability to stay in one of J models is (1 + (J - 1) exp(-dt / sojourn J / (J - 1))) / J. That is exact if all sojourns are
    equal, else to first order.
    """
    count = len(mode_probability)
    for i in range(count):
        stay = 1.0
        if count > 1:
            stay = (1.0 + (count - 1) * math.exp(-dt / models[i].sojourn * count / (count - 1))) / count
        for j in range(count):
            mixing[j, i] = mode_probability[i] * (stay if i == j else (1.0 - stay) / (count - 1))
    for j in range(count):
        total = 0.0
        for i in range(count):
            total += mixing[j, i]
        for i in range(count):
            mixing[j, i] /= total
        mode_probability[j] = total


@jit
def mix(state, covariance, mode_probability, models, dt, work):  # type: ignore[no-untyped-def]
    """Mix the models of a filter over dt as a Markov chain: each model becomes the moments of those it may have come from."""
    before, before_covariance, mixing = work.state, work.covariance, work.mixing
    copy_into(before, state)
    copy_into(before_covariance, covariance)
    mixing_probabilities(mode_probability, models, dt, mixing)
    for j in range(len(models)):
        moments(before, before_covariance, mixing[j], state[j], covariance[j])


@jit
def mix_renewed(state, covariance, mode_probability, models, dt, renewal, work):  # type: ignore[no-untyped-def]
    """Mix the models of a filter over dt by a renewal process: each model becomes a mixture of itself and of all models.

    The work is linear in the number of models. Args: renewal: mean time until a motion is drawn from the prior, s; work: its mean and
    spread are the moments over all models, of position and velocity.
    """
    pool, spread = work.mean, work.spread
    keep = math.exp(-dt / renewal)
    for j in range(len(models)):
        past = keep * mode_probability[j]
        mode_probability[j] = past + (1.0 - keep) * models[j].prior_probability
        pool[MANOEUVRE] = models[j].manoeuvre_mean
        for a in range(MANOEUVRE):
            spread[MANOEUVRE, a] = spread[a, MANOEUVRE] = 0.0
        spread[MANOEUVRE, MANOEUVRE] = models[j].manoeuvre_sigma ** 2
        merge(state[j], covariance[j], past / mode_probability[j], pool, spread)


@jit
def predict_filter(state, covariance, mode_probability, models, dt, renewal, work):  # type: ignore[no-untyped-def]
    """Predict a filter over dt: mixing, then each model by its motion. Args: renewal: s; infinite: the models are a Markov chain."""
    if dt <= 0.0:
        return
    if renewal < math.inf:
        moments(state, covariance, mode_probability, work.mean, work.spread)
    predict_from_moments(state, covariance, mode_probability, models, dt, renewal, work)


@jit
def predict_from_moments(state, covariance, mode_probability, models, dt, renewal, work):  # type: ignore[no-untyped-def]
    """As `predict_filter`, for dt > 0 and where the moments that `mix_renewed` reads are known."""
    if renewal < math.inf:
        mix_renewed(state, covariance, mode_probability, models, dt, renewal, work)
    else:
        mix(state, covariance, mode_probability, models, dt, work)
    transition = work.transition
    for j in range(len(models)):
        motion_models.predict(models[j], state[j], covariance[j], dt, transition)


@jit
def _floored(weight, total, mode_probability):  # type: ignore[no-untyped-def]
    """Mode probabilities, into the last, proportional to weights with this sum, none of them below FLOOR before they sum to 1 again."""
    floored = 0.0
    for j in range(len(weight)):
        mode_probability[j] = max(weight[j] / total, FLOOR)
        floored += mode_probability[j]
    for j in range(len(weight)):
        mode_probability[j] /= floored


@jit
def reweigh(factor, distance, mode_probability):  # type: ignore[no-untyped-def]
    """Mode probabilities, into the last, proportional to factor exp(-distance / 2); the logarithm of the sum of these weights.

    Args: factor: (J,), overwritten; distance: (J,).
    """
    least, total = math.inf, 0.0
    for j in range(len(factor)):
        least = min(least, distance[j])
    for j in range(len(factor)):
        factor[j] *= math.exp(0.5 * (least - distance[j]))
        total += factor[j]
    _floored(factor, total, mode_probability)
    return math.log(total) - 0.5 * least


@jit
def weigh_models(log_weight, mode_probability):  # type: ignore[no-untyped-def]
    """Mode probabilities, into the last, from the logarithms of weights, which are overwritten; the logarithm of the sum of weights."""
    largest = -math.inf
    for weight in log_weight:
        largest = max(largest, weight)
    total = 0.0
    for j in range(len(log_weight)):
        log_weight[j] = math.exp(log_weight[j] - largest)
        total += log_weight[j]
    _floored(log_weight, total, mode_probability)
    return largest + math.log(total)


@jit
def update_filter(state, covariance, mode_probability, z, noise, work):  # type: ignore[no-untyped-def]
    """Update a filter by a measurement of its first d components; the log-likelihood. Args: z: (d,); noise: R, (d, d) or larger."""
    factor, distance = work.log_weight, work.distance
    for j in range(len(mode_probability)):
        if len(z) == 2:
            determinant, distance[j] = kalman.update_position(state[j], covariance[j], z, noise)
        else:
            determinant, distance[j] = kalman.update(state[j], covariance[j], z, noise, work.root, work.gain, work.residual)
        factor[j] = max(mode_probability[j], FLOOR) / determinant
    return reweigh(factor, distance, mode_probability) - 0.5 * len(z) * LOG_TWO_PI


@jit
def update_with_jumps(state, covariance, mode_probability, models, dt, z, noise, work):  # type: ignore[no-untyped-def]
    """Update a filter of which models may have jumped in the last dt, by GPB1; the log-likelihood. Args: as of `update_filter`."""
    jumped, spread, log_weight = work.mean, work.spread, work.log_weight
    root, gain, residual = work.root, work.gain, work.residual
    for j in range(len(models)):
        probability = 1.0 - math.exp(-models[j].jump_rate * dt)
        if probability > 0.0:
            copy_into(jumped, state[j])
            copy_into(spread, covariance[j])
            motion_models.add_velocity_noise(spread, models[j].jump_variance, dt)
        determinant, distance = kalman.update(state[j], covariance[j], z, noise, root, gain, residual)
        steady = kalman.log_likelihood(determinant, distance, len(z))
        steady += math.log(max(mode_probability[j] * (1.0 - probability), FLOOR))
        if probability > 0.0:
            determinant, distance = kalman.update(jumped, spread, z, noise, root, gain, residual)
            jump = kalman.log_likelihood(determinant, distance, len(z))
            jump += math.log(max(mode_probability[j] * probability, FLOOR))
            merge(state[j], covariance[j], 1.0 / (1.0 + math.exp(jump - steady)), jumped, spread)
            steady = max(steady, jump) + math.log1p(math.exp(-abs(jump - steady)))
        log_weight[j] = steady
    return weigh_models(log_weight, mode_probability)


@jit
def predict_filters(
    state: Floats, covariance: Floats, mode_probability: Floats, dt_s: Floats, renewal_s: float, models: Records
) -> tuple[Floats, Floats, Floats]:
    """State (N, J, 5), covariance (N, J, 5, 5) and mode probability (N, J) of filters after dt.

    Args: state, covariance, mode_probability: as returned; dt_s: (N,), not negative; renewal_s: mean time until a motion is drawn
    from the prior, infinite: the models are a Markov chain; models: (J,) MODEL.
    """
    out = state.copy(), covariance.copy(), mode_probability.copy()
    work = workspace(len(models))
    for n in range(len(dt_s)):
        predict_filter(out[0][n], out[1][n], out[2][n], models, dt_s[n], renewal_s, work)
    return out


@jit
def update_filters(
    state: Floats, covariance: Floats, mode_probability: Floats, z: Floats, noise: Floats, has_velocity: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """State (N, J, 5), covariance (N, J, 5, 5) and mode probability (N, J) of filters after a measurement, and its log-likelihood (N,).

    Args: z: (N, 4) east, north, east rate, north rate; noise: R, (N, 4, 4); has_velocity: (N,), where False only the position is read.
    """
    after, spread, mode = state.copy(), covariance.copy(), mode_probability.copy()
    work, log_likelihood = workspace(mode.shape[1]), np.empty(len(z))
    for n in range(len(z)):
        measured = z[n] if has_velocity[n] else z[n, :2]
        log_likelihood[n] = update_filter(after[n], spread[n], mode[n], measured, noise[n], work)
    return after, spread, mode, log_likelihood


@jit
def estimate_filters(state: Floats, covariance: Floats, mode_probability: Floats) -> tuple[Floats, Floats]:
    """Mean (N, 5) and covariance (N, 5, 5) over the models of filters. Args: as of `predict_filters`."""
    mean, spread = np.empty((len(state), SIZE)), np.empty((len(state), SIZE, SIZE))
    for n in range(len(state)):
        moments(state[n], covariance[n], mode_probability[n], mean[n], spread[n])
    return mean, spread


@jit
def bring_forward(z, noise, late, mean, covariance):  # type: ignore[no-untyped-def]
    """Move a measured position by the velocity of an estimate over `late` seconds, and widen its noise as much. In place."""
    for a in range(2):
        z[a] += mean[a + 2] * late
        for b in range(2):
            noise[a, b] += covariance[a + 2, b + 2] * late * late


@jit
def initialise_filters(filters, rows, position, noise, speed_variance, models):  # type: ignore[no-untyped-def]
    """Filters that know one position and no velocity, in place.

    Args: filters: state (S, J, 5), covariance (S, J, 5, 5), mode probability (S, J); rows: (B,) of them; position: (B, 2); noise: R,
    (B, 2, 2); speed_variance: of each component of the velocity; models: (J,) MODEL.
    """
    state, covariance, mode = filters
    for k in range(len(rows)):
        n = rows[k]
        state[n] = 0.0
        covariance[n] = 0.0
        for j in range(len(models)):
            copy_into(state[n, j], position[k])
            state[n, j, MANOEUVRE] = models[j].manoeuvre_mean
            copy_into(covariance[n, j], noise[k])
            covariance[n, j, EAST_RATE, EAST_RATE] = covariance[n, j, NORTH_RATE, NORTH_RATE] = speed_variance
            covariance[n, j, MANOEUVRE, MANOEUVRE] = models[j].manoeuvre_sigma ** 2
            mode[n, j] = models[j].prior_probability


@jit
def combine(state, covariance, mode_probability, models, n, estimates):  # type: ignore[no-untyped-def]
    """Write the combined estimate of a filter into row n of `coastwatch.kernels.tracks.columns.Estimates`, but for its time."""
    mean, spread, noise = estimates.mean[n], estimates.covariance[n], 0.0
    for a in range(4):
        mean[a] = 0.0
        for j in range(len(models)):
            mean[a] += mode_probability[j] * state[j, a]
        for b in range(a + 1):
            spread[a, b] = 0.0
    for j in range(len(models)):
        noise += mode_probability[j] * models[j].noise
        for a in range(4):
            apart = state[j, a] - mean[a]
            for b in range(a + 1):
                spread[a, b] += mode_probability[j] * (covariance[j, a, b] + apart * (state[j, b] - mean[b]))
    for a in range(4):
        for b in range(a):
            spread[b, a] = spread[a, b]
    estimates.noise[n] = noise


@jit
def combine_filters(filters, estimates, rows, models):  # type: ignore[no-untyped-def]
    """Write the combined estimates of these filters, but for their times. Args: as of `update_by_plots`; rows: (B,)."""
    state, covariance, mode = filters
    for n in rows:
        combine(state[n], covariance[n], mode[n], models, n, estimates)


@jit
def update_by_plots(filters, estimates, rows, plots, columns, renewal, models):  # type: ignore[no-untyped-def]
    """Predict each filter to the time of its plot and update it, in place, one plot after the other.

    A plot that is older than its filter is brought forward by the velocity and is as much less certain.
    Args: filters: state (S, J, 5), covariance (S, J, 5, 5), mode probability (S, J); estimates: `kernels.tracks.columns.Estimates` of
    them; rows: (B,) of these, one may come again; plots: (B,) rows of columns, PlotColumns; renewal: s, as of `predict_filters`.
    """
    state, covariance, mode = filters
    work, z, noise = workspace(len(models)), np.empty(2), np.empty((2, 2))
    for k in range(len(rows)):
        n, m = rows[k], plots[k]
        dt = columns.time[m] - estimates.time[n]
        copy_into(z, columns.position[m])
        copy_into(noise, columns.covariance[m])
        if dt > 0.0:
            copy_into(work.mean, estimates.mean[n])
            copy_into(work.spread, estimates.covariance[n])
            predict_from_moments(state[n], covariance[n], mode[n], models, dt, renewal, work)
            estimates.time[n] = columns.time[m]
        else:
            bring_forward(z, noise, -dt, estimates.mean[n], estimates.covariance[n])
        update_filter(state[n], covariance[n], mode[n], z, noise, work)
        combine(state[n], covariance[n], mode[n], models, n, estimates)


@jit
def predicted_estimates(filters, estimates, rows, time, renewal, models):  # type: ignore[no-untyped-def]
    """The combined estimates of some filters, predicted to a time by all of their models; the filters stay.

    Args: as of `update_by_plots`; rows: (N,); time: a filter that was updated later is not taken back.
    Returns: `kernels.tracks.columns.Estimates` of N.
    """
    count = len(rows)
    out = Estimates(np.empty(count), np.empty((count, 4)), np.empty((count, 4, 4)), np.empty(count))
    states, covariances, probabilities = filters
    one, one_spread, mode = np.empty(states.shape[1:]), np.empty(covariances.shape[1:]), np.empty(len(models))
    work = workspace(len(models))
    for k in range(count):
        n = rows[k]
        copy_into(one, states[n])
        copy_into(one_spread, covariances[n])
        copy_into(mode, probabilities[n])
        out.time[k] = max(time, estimates.time[n])
        if time > estimates.time[n]:
            copy_into(work.mean, estimates.mean[n])
            copy_into(work.spread, estimates.covariance[n])
            predict_from_moments(one, one_spread, mode, models, time - estimates.time[n], renewal, work)
        combine(one, one_spread, mode, models, k, out)
    return out
