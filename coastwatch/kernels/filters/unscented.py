"""Unscented filters of two models in course and speed, and their interaction. Scalar code, compiled by numba.

Model 0 keeps course and speed (CV): east, north, course, speed. Model 1 keeps turn rate and speed (CTRV): the same and the turn rate.
Courses are clockwise from north. The fifth row of model 0 is not used.

Sources: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, equations (1) to (9); S. J. Julier, J. K.
Uhlmann, A New Extension of the Kalman Filter to Nonlinear Systems, 1997; J. D. Glass, W. D. Blair, Y. Bar-Shalom, IMM Estimators with
Unbiased Mixing for Tracking Targets Performing Coordinated Turns, 2013.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

MODELS, SIZE, NOISES = 2, 5, 2
CENTRE = 1.0 / 3.0  # weight of the middle point
SINGULAR = 1e-13  # of a variance: what is left of it is rounding
COURSE, SPEED, RATE = 2, 3, 4


class MotionRules(NamedTuple):
    """The two models and how a vessel changes from one to the other."""

    sojourn: Floats  # (2,) s, mean time in each model
    noise: Floats  # (2, 2) variance a second: of course, rad, and speed, m/s (CV); of speed and turn rate, rad/s (CTRV)
    pads_zeros: bool  # CV has the turn rate 0 without variance where it is mixed into CTRV; else that of CTRV itself


@jit
def wrapped(angle):  # type: ignore[no-untyped-def]
    """The angle from -pi to pi. Args: angle: rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@jit
def points(mean, covariance, size, out):  # type: ignore[no-untyped-def]
    """Write the 2 L + 1 points of a Gaussian of L numbers: its mean, and L points to each side.

    A variance that is zero, or rounding, gives no spread.
    Args: mean: (L,) or more; covariance: (L, L) or more; size: L; out: (2 L + 1, L), of the units of the mean.
    """
    scale = math.sqrt(size / (1.0 - CENTRE))
    lower = np.zeros((size, size))
    for j in range(size):
        pivot = covariance[j, j]
        for k in range(j):
            pivot -= lower[j, k] * lower[j, k]
        if pivot > SINGULAR * covariance[j, j]:
            lower[j, j] = math.sqrt(pivot)
            for i in range(j + 1, size):
                value = covariance[i, j]
                for k in range(j):
                    value -= lower[i, k] * lower[j, k]
                lower[i, j] = value / lower[j, j]
    for i in range(size):
        out[0, i] = mean[i]
        for j in range(size):
            out[1 + j, i] = mean[i] + scale * lower[i, j]
            out[1 + size + j, i] = mean[i] - scale * lower[i, j]


@jit
def move(model, point, dt):  # type: ignore[no-untyped-def]
    """Move a point of state and noise by one step, in place: the functions f of equation (1).

    Args: model: 0 or 1; point: (6,) or (7,) m, m, rad, m/s, of CTRV rad/s, and the two noises of the model; dt: s.
    """
    size = 4 + model
    if model == 0:
        heading, chord = point[COURSE] + 0.5 * point[size], (point[SPEED] + 0.5 * point[size + 1]) * dt
        point[COURSE] += point[size]
        point[SPEED] += point[size + 1]
    else:
        rate = point[RATE] + 0.5 * point[size + 1]
        half = 0.5 * rate * dt
        sinc = math.sin(half) / half if abs(half) > 1e-8 else 1.0
        heading, chord = point[COURSE] + half, (point[SPEED] + 0.5 * point[size]) * dt * sinc
        point[COURSE] += rate * dt
        point[SPEED] += point[size]
        point[RATE] += point[size + 1]
    point[0] += chord * math.sin(heading)
    point[1] += chord * math.cos(heading)


@jit
def turn_round(mean, covariance, size):  # type: ignore[no-untyped-def]
    """Give a state of negative speed its positive speed and the opposite course, in place.

    Args: mean: (5,) m, m, rad, m/s, rad/s; covariance: (5, 5); size: 4 or 5 rows that the model uses.
    """
    if mean[SPEED] < 0.0:
        mean[SPEED] = -mean[SPEED]
        mean[COURSE] += math.pi
        for i in range(size):
            if i != SPEED:
                covariance[i, SPEED] = -covariance[i, SPEED]
                covariance[SPEED, i] = -covariance[SPEED, i]
    mean[COURSE] = wrapped(mean[COURSE])


@jit
def predict(model, mean, covariance, dt, noise):  # type: ignore[no-untyped-def]
    """Predict one filter, in place. A step of 0 s or less changes nothing.

    Args: model: 0 or 1; mean: (5,) m, m, rad, m/s, rad/s; covariance: (5, 5); dt: s; noise: (2,) variance a second of the two noises.
    """
    if dt <= 0.0:
        return
    size = 4 + model
    both = size + NOISES
    joined, joint = np.zeros(both), np.zeros((both, both))
    copy_into(joined, mean[:size])
    copy_into(joint, covariance[:size, :size])
    joint[size, size], joint[size + 1, size + 1] = noise[0] * dt, noise[1] * dt
    cloud = np.empty((2 * both + 1, both))
    points(joined, joint, both, cloud)
    for k in range(len(cloud)):
        move(model, cloud[k], dt)
    side, middle = (1.0 - CENTRE) / (2.0 * both), cloud[0].copy()
    shift = np.zeros(size)
    for k in range(len(cloud)):
        for i in range(size):
            cloud[k, i] -= middle[i]
        cloud[k, COURSE] = wrapped(cloud[k, COURSE])
        if k > 0:
            for i in range(size):
                shift[i] += side * cloud[k, i]
    for i in range(size):
        mean[i] = middle[i] + shift[i]
        for j in range(i + 1):
            total = CENTRE * (cloud[0, i] - shift[i]) * (cloud[0, j] - shift[j])
            for k in range(1, len(cloud)):
                total += side * (cloud[k, i] - shift[i]) * (cloud[k, j] - shift[j])
            covariance[i, j] = covariance[j, i] = total
    turn_round(mean, covariance, size)


@jit
def measured(size, mean, covariance, site, predicted, spread, cross):  # type: ignore[no-untyped-def]
    """Write range and bearing of a filter from a site, and their covariances: equation (9).

    Args: size: 4 or 5; mean: (5,) m, m, rad, m/s, rad/s; covariance: (5, 5); site: (2,) east, north, m. Written: predicted: (2,) m,
    rad; spread: (2, 2) of both; cross: (5, 2) of state and both, of which `size` rows.
    """
    cloud, side = np.empty((2 * size + 1, size)), (1.0 - CENTRE) / (2.0 * size)
    points(mean, covariance, size, cloud)
    seen = np.empty((len(cloud), 2))
    for k in range(len(cloud)):
        east, north = cloud[k, 0] - site[0], cloud[k, 1] - site[1]
        seen[k, 0], seen[k, 1] = math.hypot(east, north), math.atan2(east, north)
    first, second, shift0, shift1 = seen[0, 0], seen[0, 1], 0.0, 0.0
    for k in range(len(cloud)):
        seen[k, 0] -= first
        seen[k, 1] = wrapped(seen[k, 1] - second)
        if k > 0:
            shift0 += side * seen[k, 0]
            shift1 += side * seen[k, 1]
    predicted[0], predicted[1] = first + shift0, second + shift1
    spread[:], cross[:size] = 0.0, 0.0
    for k in range(len(cloud)):
        weight, a, b = CENTRE if k == 0 else side, seen[k, 0] - shift0, seen[k, 1] - shift1
        spread[0, 0] += weight * a * a
        spread[0, 1] += weight * a * b
        spread[1, 1] += weight * b * b
        for i in range(size):
            off = cloud[k, i] - mean[i]
            cross[i, 0] += weight * off * a
            cross[i, 1] += weight * off * b
    spread[1, 0] = spread[0, 1]


@jit
def _blend(means, covariances, weight, size, mean, covariance):  # type: ignore[no-untyped-def]
    """Write the moments of a mixture of two Gaussians.

    Args: means: (2, 5) m, m, rad, m/s, rad/s; covariances: (2, 5, 5); weight: (2,) of sum 1; size: 4 or 5. Written: mean: (5,);
    covariance: (5, 5).
    """
    off = np.empty(size)
    for i in range(size):
        off[i] = means[1, i] - means[0, i]
    off[COURSE] = wrapped(off[COURSE])
    for i in range(size):
        mean[i] = means[0, i] + weight[1] * off[i]
        for j in range(size):
            own = weight[0] * covariances[0, i, j] + weight[1] * covariances[1, i, j]
            covariance[i, j] = own + weight[0] * weight[1] * off[i] * off[j]
    mean[COURSE] = wrapped(mean[COURSE])


@jit
def predict_mixed(state, covariance, mode, dt, rules):  # type: ignore[no-untyped-def]
    """Mix the models of one track and predict each, in place.

    From CTRV to CV the turn rate is dropped. From CV to CTRV that of CTRV itself is appended with its variance, without correlation.
    Args: state: (2, 5) m, m, rad, m/s, rad/s; covariance: (2, 5, 5); mode: (2,) probability of each model; dt: s; rules: MotionRules.
    """
    if dt <= 0.0:
        return
    stay0, stay1 = math.exp(-dt / rules.sojourn[0]), math.exp(-dt / rules.sojourn[1])
    to0, to1 = np.array([stay0 * mode[0], (1.0 - stay1) * mode[1]]), np.array([(1.0 - stay0) * mode[0], stay1 * mode[1]])
    mode[0], mode[1] = to0.sum(), to1.sum()
    old, spread = state.copy(), covariance.copy()
    _blend(old, spread, to0 / mode[0], 4, state[0], covariance[0])
    old[0, RATE] = 0.0 if rules.pads_zeros else old[1, RATE]
    spread[0, RATE, :] = 0.0
    spread[0, :, RATE] = 0.0
    spread[0, RATE, RATE] = 0.0 if rules.pads_zeros else spread[1, RATE, RATE]
    _blend(old, spread, to1 / mode[1], 5, state[1], covariance[1])
    for model in range(MODELS):
        predict(model, state[model], covariance[model], dt, rules.noise[model])


@jit
def predict_tracks(tracks, rows, times, rules):  # type: ignore[no-untyped-def]
    """Predict these tracks to a time of each, in place; one that is newer stays.

    Args: tracks: time (N,) s, state (N, 2, 5) m, m, rad, m/s, rad/s, covariance (N, 2, 5, 5), mode (N, 2); rows: (B,) of N; times:
    (B,) s; rules: MotionRules.
    """
    time, state, covariance, mode = tracks
    for k in range(len(rows)):
        n = rows[k]
        predict_mixed(state[n], covariance[n], mode[n], times[k] - time[n], rules)
        time[n] = max(time[n], times[k])


@jit
def cartesian(tracks, now, rules):  # type: ignore[no-untyped-def]
    """East, north and their rates of each track at a time, over both models, and the covariance. (N, 4) m, m/s, (N, 4, 4)

    Args: tracks: as of `predict_tracks`; now: s; rules: MotionRules.
    """
    time, state, covariance, mode = tracks
    mean, spread = np.zeros((len(time), 4)), np.zeros((len(time), 4, 4))
    cloud, weights = np.empty((2 * (2 * SIZE + 1), 4)), np.empty(2 * (2 * SIZE + 1))
    for n in range(len(time)):
        own, around, share = state[n].copy(), covariance[n].copy(), mode[n].copy()
        predict_mixed(own, around, share, now - time[n], rules)
        count = 0
        for model in range(MODELS):
            size = 4 + model
            found = np.empty((2 * size + 1, size))
            points(own[model], around[model], size, found)
            side = (1.0 - CENTRE) / (2.0 * size)
            for k in range(len(found)):
                course, speed = found[k, COURSE], found[k, SPEED]
                cloud[count, 0], cloud[count, 1] = found[k, 0], found[k, 1]
                cloud[count, 2], cloud[count, 3] = speed * math.sin(course), speed * math.cos(course)
                weights[count] = share[model] * (CENTRE if k == 0 else side)
                count += 1
        for i in range(4):
            for k in range(count):
                mean[n, i] += weights[k] * cloud[k, i]
        for i in range(4):
            for j in range(4):
                for k in range(count):
                    spread[n, i, j] += weights[k] * (cloud[k, i] - mean[n, i]) * (cloud[k, j] - mean[n, j])
    return mean, spread
