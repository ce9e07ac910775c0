"""Interacting multiple models with a turn to each side and a change of speed: scalar code compiled by numba, a row a track.

States, models and mixing: coastwatch.kernels.filters.manoeuvre_models. Measurements are positions, or positions with velocity.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.6.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.filters.imm import FLOOR, LOG_TWO_PI, SIZE, _correct
from coastwatch.kernels.filters.manoeuvre_models import pool, predict_in_place, predict_row
from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@jit
def _fix(x, p, row, m, z, r, at, gain):  # type: ignore[no-untyped-def]
    """One Kalman update by the position in row `at` of z and r, in place; returns the log-likelihood. gain: (4, 5), room to work in."""
    ee, en, nn = p[row, m, 0, 0] + r[at, 0, 0], p[row, m, 1, 0] + r[at, 1, 0], p[row, m, 1, 1] + r[at, 1, 1]
    det = ee * nn - en * en
    ie, ix, io = nn / det, -en / det, ee / det
    east, north = z[at, 0] - x[row, m, 0], z[at, 1] - x[row, m, 1]
    for a in range(SIZE):
        pe, pn = p[row, m, a, 0], p[row, m, a, 1]
        gain[0, a], gain[1, a] = pe * ie + pn * ix, pe * ix + pn * io
        gain[2, a], gain[3, a] = pe, pn
        x[row, m, a] += gain[0, a] * east + gain[1, a] * north
    for a in range(SIZE):
        for b in range(a + 1):
            t = p[row, m, a, b] - (gain[0, a] * gain[2, b] + gain[1, a] * gain[3, b])
            p[row, m, a, b] = t
            p[row, m, b, a] = t
    square = ie * east * east + 2.0 * ix * east * north + io * north * north
    return -0.5 * (square + math.log(det)) - LOG_TWO_PI


@jit
def _weigh(mode, row, fit):  # type: ignore[no-untyped-def]
    """Model probabilities of a row after log-likelihoods `fit` (J,), which is overwritten; returns that of all models."""
    best = -np.inf
    for m in range(len(fit)):
        best = max(best, fit[m])
    total = 0.0
    for m in range(len(fit)):
        fit[m] = max(mode[row, m], FLOOR) * math.exp(fit[m] - best)
        total += fit[m]
    floored = 0.0
    for m in range(len(fit)):
        mode[row, m] = max(fit[m] / total, FLOOR)
        floored += mode[row, m]
    for m in range(len(fit)):
        mode[row, m] /= floored
    return best + math.log(total)


@jit
def update_in_place(x, p, mode, z, r, has_velocity, log_likelihood):  # type: ignore[no-untyped-def]
    """As sided_update, but x, p, mode and log_likelihood are overwritten."""
    fit, two, white, low, four = (
        np.empty(mode.shape[1]),
        np.empty((4, SIZE)),
        np.empty(4),
        np.empty((4, 4)),
        np.empty((SIZE, 4)),
    )
    for row in range(len(mode)):
        for m in range(mode.shape[1]):
            if has_velocity[row]:
                fit[m] = _correct(x[row, m], p[row, m], z[row], r[row], 4, white, low, four, x[row, m], p[row, m])
            else:
                fit[m] = _fix(x, p, row, m, z, r, row, two)
        log_likelihood[row] = _weigh(mode, row, fit)


@jit
def _copy_row(x, p, mode, row, x_out, p_out, mode_out, to):  # type: ignore[no-untyped-def]
    """One row to the row `to` of others."""
    for m in range(mode.shape[1]):
        mode_out[to, m] = mode[row, m]
        for a in range(SIZE):
            x_out[to, m, a] = x[row, m, a]
            for b in range(SIZE):
                p_out[to, m, a, b] = p[row, m, a, b]


@jit
def sided_predict(
    state: Floats, covariance: Floats, mode: Floats, dt_s: Floats, renewal_s: float, models: Floats
) -> tuple[Floats, Floats, Floats]:
    """State, covariance and probability of every model after dt: what takes up a motion anew, then each model's own motion.

    Args:
        state: (N, J, 5); covariance: (N, J, 5, 5); mode: (N, J) probabilities, positive, rows sum to 1.
        dt_s: (N,) not negative; 0 changes nothing. renewal_s: mean time before a motion is taken up anew.
        models: (J, 6), see coastwatch.kernels.filters.manoeuvre_models.
    Returns: state (N, J, 5), covariance (N, J, 5, 5), mode (N, J).
    """
    out = state.copy(), covariance.copy(), mode.copy()
    predict_in_place(out[0], out[1], out[2], dt_s, renewal_s, models)
    return out


@jit
def sided_update(
    state: Floats, covariance: Floats, mode: Floats, z: Floats, noise: Floats, has_velocity: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """State, covariance and probability of every model after a measurement, and how likely the measurement was.

    Args, Returns: as of coastwatch.kernels.filters.imm.imm_update.
    """
    out = state.copy(), covariance.copy(), mode.copy(), np.empty(len(mode))
    update_in_place(out[0], out[1], out[2], z, noise, has_velocity, out[3])
    return out


@jit
def sided_foresee(
    state: Floats, covariance: Floats, mode: Floats, dt_s: Floats, renewal_s: float, models: Floats
) -> tuple[Floats, Floats]:
    """Mean and covariance of position and velocity after dt, over the models; what they know apart is not kept.

    Args: as of sided_predict. Returns: (N, 4) and (N, 4, 4).
    """
    rows, j = mode.shape
    mean, cov = np.empty((rows, 4)), np.empty((rows, 4, 4))
    one = np.empty((1, j, SIZE)), np.empty((1, j, SIZE, SIZE)), np.empty((1, j))
    room = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty((4, 3)), np.empty((4, 3))
    for row in range(rows):
        _copy_row(state, covariance, mode, row, one[0], one[1], one[2], 0)
        if dt_s[row] > 0.0:
            predict_row(one[0], one[1], one[2], 0, dt_s[row], renewal_s, models, room[0], room[1], room[2], room[3], room[4])
        pool(one[0], one[1], one[2], 0, room[0], room[1])
        for a in range(4):
            mean[row, a] = room[0][a]
            for b in range(a + 1):
                cov[row, a, b] = room[1][a, b]
                cov[row, b, a] = room[1][a, b]
    return mean, cov


@jit
def _measure(z, r, mean, cov, late, z_out, r_out):  # type: ignore[no-untyped-def]
    """A plot brought forward by `late` seconds (not positive: back in time) into the last two (1, 2), (1, 2, 2); its squared distance."""
    for a in range(2):
        z_out[0, a] = z[a] - mean[a + 2] * late
        for b in range(2):
            r_out[0, a, b] = r[a, b] + cov[max(a, b) + 2, min(a, b) + 2] * late * late
    ee, en, nn = cov[0, 0] + r_out[0, 0, 0], cov[1, 0] + r_out[0, 1, 0], cov[1, 1] + r_out[0, 1, 1]
    east, north = z_out[0, 0] - mean[0], z_out[0, 1] - mean[1]
    return (nn * east * east - 2.0 * en * east * north + ee * north * north) / (ee * nn - en * en)


@jit
def _absorb_rows(state, covariance, mode, rows, dt_s, position, noise, renewal_s, models, x, p, weight, fit, square):  # type: ignore[no-untyped-def]
    j = mode.shape[1]
    mean, cov, d, f, n = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty((4, 3)), np.empty((4, 3))
    each, gain, z, r = np.empty(j), np.empty((4, SIZE)), np.empty((1, 2)), np.empty((1, 2, 2))
    for k in range(len(rows)):
        _copy_row(state, covariance, mode, rows[k], x, p, weight, k)
        if dt_s[k] > 0.0:
            predict_row(x, p, weight, k, dt_s[k], renewal_s, models, mean, cov, d, f, n)
        pool(x, p, weight, k, mean, cov)
        square[k] = _measure(position[k], noise[k], mean, cov, min(dt_s[k], 0.0), z, r)
        for m in range(j):
            each[m] = _fix(x, p, k, m, z, r, 0, gain)
        fit[k] = _weigh(weight, k, each)


@jit
def sided_absorb(
    state: Floats,
    covariance: Floats,
    mode: Floats,
    rows: Ints,
    dt_s: Floats,
    position: Floats,
    noise: Floats,
    renewal_s: float,
    models: Floats,
) -> tuple[Floats, ...]:
    """Prediction, distance and update by a position in one pass: what is read of a row stays in the processor's cache.

    A position that is older than its row (dt_s < 0) is brought forward by the velocity and is as much less certain.
    Args: state, covariance, mode: of N rows; rows: (A,) of these; dt_s: (A,); position: (A, 2); noise: (A, 2, 2); else as of
        sided_predict.
    Returns: state (A, J, 5), covariance (A, J, 5, 5), mode (A, J), natural logarithm of the density of the position (A,), and its
        squared distance from where all models together expect it (A,).
    """
    count, j = len(rows), mode.shape[1]
    x, p, weight = np.empty((count, j, SIZE)), np.empty((count, j, SIZE, SIZE)), np.empty((count, j))
    fit, square = np.empty(count), np.empty(count)
    _absorb_rows(state, covariance, mode, rows, dt_s, position, noise, renewal_s, models, x, p, weight, fit, square)
    return x, p, weight, fit, square
