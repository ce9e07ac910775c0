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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.filters import kalman, motion_models
from coastwatch.kernels.filters.kalman import MANOEUVRE, SIZE
from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FLOOR = 1e-12  # least mode probability, so that a model can recover and nothing is divided by 0


class Workspace(NamedTuple):
    """Memory in which the functions for one filter work; its content means nothing between two calls."""

    state: Floats  # (J, 5) the models before they are mixed
    covariance: Floats  # (J, 5, 5)
    mixing: Floats  # (J, J)
    log_weight: Floats  # (J,)
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
    before[:] = state
    before_covariance[:] = covariance
    mixing_probabilities(mode_probability, models, dt, mixing)
    for j in range(len(models)):
        moments(before, before_covariance, mixing[j], state[j], covariance[j])


@jit
def mix_renewed(state, covariance, mode_probability, models, dt, renewal, work):  # type: ignore[no-untyped-def]
    """Mix the models of a filter over dt by a renewal process: each model becomes a mixture of itself and of all models.

    The work is linear in the number of models. Args: renewal: mean time until a motion is drawn from the prior, s.
    """
    pool, spread = work.mean, work.spread
    keep = math.exp(-dt / renewal)
    moments(state, covariance, mode_probability, pool, spread)
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
        mix_renewed(state, covariance, mode_probability, models, dt, renewal, work)
    else:
        mix(state, covariance, mode_probability, models, dt, work)
    transition = work.transition
    for j in range(len(models)):
        motion_models.predict(models[j], state[j], covariance[j], dt, transition)


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
    floored = 0.0
    for j in range(len(log_weight)):
        mode_probability[j] = max(log_weight[j] / total, FLOOR)
        floored += mode_probability[j]
    for j in range(len(log_weight)):
        mode_probability[j] /= floored
    return largest + math.log(total)


@jit
def update_filter(state, covariance, mode_probability, z, noise, work):  # type: ignore[no-untyped-def]
    """Update a filter by a measurement of its first d components; the log-likelihood. Args: z: (d,); noise: R, (d, d) or larger."""
    log_weight, root, gain, residual = work.log_weight, work.root, work.gain, work.residual
    for j in range(len(mode_probability)):
        log_likelihood = kalman.update(state[j], covariance[j], z, noise, root, gain, residual)
        log_weight[j] = log_likelihood + math.log(max(mode_probability[j], FLOOR))
    return weigh_models(log_weight, mode_probability)


@jit
def update_with_jumps(state, covariance, mode_probability, models, dt, z, noise, work):  # type: ignore[no-untyped-def]
    """Update a filter of which models may have jumped in the last dt, by GPB1; the log-likelihood. Args: as of `update_filter`."""
    jumped, spread, log_weight = work.mean, work.spread, work.log_weight
    root, gain, residual = work.root, work.gain, work.residual
    for j in range(len(models)):
        probability = 1.0 - math.exp(-models[j].jump_rate * dt)
        if probability > 0.0:
            jumped[:] = state[j]
            spread[:] = covariance[j]
            motion_models.add_velocity_noise(spread, models[j].jump_variance, dt)
        steady = kalman.update(state[j], covariance[j], z, noise, root, gain, residual)
        steady += math.log(max(mode_probability[j] * (1.0 - probability), FLOOR))
        if probability > 0.0:
            jump = kalman.update(jumped, spread, z, noise, root, gain, residual)
            jump += math.log(max(mode_probability[j] * probability, FLOOR))
            merge(state[j], covariance[j], 1.0 / (1.0 + math.exp(jump - steady)), jumped, spread)
            steady = max(steady, jump) + math.log1p(math.exp(-abs(jump - steady)))
        log_weight[j] = steady
    return weigh_models(log_weight, mode_probability)


@jit
def predict_filters(
    state: Floats, covariance: Floats, mode_probability: Floats, dt_s: Floats, renewal_s: float, models: Any
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
def predicted_estimates(
    state: Floats, covariance: Floats, mode_probability: Floats, dt_s: Floats, renewal_s: float, models: Any
) -> tuple[Floats, Floats]:
    """Mean (N, 5) and covariance (N, 5, 5) over the models of filters after dt; the filters stay. Args: as of `predict_filters`."""
    mean, spread = np.empty((len(dt_s), SIZE)), np.empty((len(dt_s), SIZE, SIZE))
    one, one_spread, mode = np.empty(state.shape[1:]), np.empty(covariance.shape[1:]), np.empty(len(models))
    work = workspace(len(models))
    for n in range(len(dt_s)):
        one[:] = state[n]
        one_spread[:] = covariance[n]
        mode[:] = mode_probability[n]
        predict_filter(one, one_spread, mode, models, dt_s[n], renewal_s, work)
        moments(one, one_spread, mode, mean[n], spread[n])
    return mean, spread


@jit
def bring_forward(z, noise, late, mean, covariance):  # type: ignore[no-untyped-def]
    """Move a measured position by the velocity of an estimate over `late` seconds, and widen its noise as much. In place."""
    for a in range(2):
        z[a] += mean[a + 2] * late
        for b in range(2):
            noise[a, b] += covariance[a + 2, b + 2] * late * late


@jit
def squared_distance(z, noise, mean, covariance):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distance of a measured position from an estimate."""
    s00, s10, s11 = covariance[0, 0] + noise[0, 0], covariance[1, 0] + noise[1, 0], covariance[1, 1] + noise[1, 1]
    east, north = z[0] - mean[0], z[1] - mean[1]
    return (s11 * east * east - 2.0 * s10 * east * north + s00 * north * north) / (s00 * s11 - s10 * s10)


@jit
def updated_by_plots(
    filters: tuple[Floats, Floats, Floats],
    rows: Ints,
    dt_s: Floats,
    position: Floats,
    noise: Floats,
    renewal_s: float,
    models: Any,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Filters of pairs after prediction to a plot and update by it; log-likelihood and squared distance of the plot.

    A plot that is older than its filter (dt_s < 0) is brought forward by the velocity and is as much less certain.
    Args: filters: state (N, J, 5), covariance (N, J, 5, 5), mode probability (N, J); rows: (A,) of them; dt_s: (A,); position: (A, 2);
    noise: (A, 2, 2); else as of `predict_filters`.
    Returns: state (A, J, 5), covariance (A, J, 5, 5), mode probability (A, J), log-likelihood (A,), squared distance (A,).
    """
    state, covariance, mode = filters[0][rows], filters[1][rows], filters[2][rows]
    log_likelihood, distance = np.empty(len(rows)), np.empty(len(rows))
    work, mean, spread = workspace(len(models)), np.empty(SIZE), np.empty((SIZE, SIZE))
    z, r = np.empty(2), np.empty((2, 2))
    for k in range(len(rows)):
        z[:] = position[k]
        r[:] = noise[k]
        predict_filter(state[k], covariance[k], mode[k], models, dt_s[k], renewal_s, work)
        moments(state[k], covariance[k], mode[k], mean, spread)
        bring_forward(z, r, max(-dt_s[k], 0.0), mean, spread)
        distance[k] = squared_distance(z, r, mean, spread)
        log_likelihood[k] = update_filter(state[k], covariance[k], mode[k], z, r, work)
    return state, covariance, mode, log_likelihood, distance
