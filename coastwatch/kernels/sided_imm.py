"""Interacting multiple models with a turn to each side and a change of speed: scalar code by numba, a row a track.

State: east, north, east rate, north rate, and a fifth component that is each model's own.
A model is a row of `models`, by column:
    KIND        STRAIGHT  constant velocity; the fifth component is 0 and goes with nothing
                TURNING   the velocity turns; the fifth is the turn rate, rad/s, positive to port, that is from east towards north
                SPEEDING  the speed changes along the track; the fifth is that acceleration, m/s2
    NOISE       density of white acceleration, m2/s3
    OWN, OWN_SIGMA  mean and standard deviation of the fifth component before anything is known
    OWN_NOISE   density of its drift, rad2/s3 or m2/s5
    SHARE       probability of the model at the start and whenever a motion is taken up anew; shares sum to one
At the rate 1 / renewal a vessel takes up a motion anew: it keeps position and velocity, draws the model by the shares, and the fifth
component from the prior of the model drawn. So what is mixed into a model is its own past and one pool of all pasts, the same for
every model; the work is linear in the number of models, and the chain of models is that of continuous time exactly.
TURNING and SPEEDING are linearised about the state (extended Kalman filter). While velocity is hardly known that is right only where
the turn rate is roughly known; therefore one model a side, each with a prior that is narrow (scaling/decisions/turns_to_a_side.py).
Arrays are indexed in full and nothing is allocated a track: a view of a row costs more than the sums on it (scaling/kernels).

Sources: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 6.2.2, 11.6.6
and 11.7; K. Granstrom, P. Willett, Y. Bar-Shalom, Systematic approach to IMM mixing for unequal dimension states, IEEE Trans. AES
51(4), 2015 (what another model does not have is drawn from the prior, not taken as zero).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coastwatch.kernels.imm import FLOOR, LOG_TWO_PI, SIZE, _correct, _turn_terms
from coastwatch.kernels.models import KIND, NOISE, OWN, OWN_NOISE, OWN_SIGMA, SHARE, STRAIGHT, TURNING

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

SLOW = 0.5  # m/s: a vessel slower than this has no direction in which to gain speed


@njit(cache=True)
def _pool(x, p, mode, row, mean, cov):  # type: ignore[no-untyped-def]
    """Moments of position and velocity over the models, into the last two (4,), (4, 4), of which the lower half."""
    for a in range(4):
        t = 0.0
        for m in range(mode.shape[1]):
            t += mode[row, m] * x[row, m, a]
        mean[a] = t
        for b in range(4):
            cov[a, b] = 0.0
    for m in range(mode.shape[1]):
        weight = mode[row, m]
        for a in range(4):
            da = x[row, m, a] - mean[a]
            for b in range(a + 1):
                cov[a, b] += weight * (p[row, m, a, b] + da * (x[row, m, b] - mean[b]))


@njit(cache=True)
def _mix(x, p, row, m, old, mean, cov, models, d):  # type: ignore[no-untyped-def]
    """One model's state mixed with the pool, in place, `old` parts of one its own past; the lower half of its covariance."""
    new = 1.0 - old
    both = old * new
    for a in range(4):
        d[a] = x[row, m, a] - mean[a]
        x[row, m, a] = mean[a] + old * d[a]
        for b in range(a + 1):
            p[row, m, a, b] = old * p[row, m, a, b] + new * cov[a, b] + both * d[a] * d[b]
    if models[m, KIND] != STRAIGHT:
        gap = x[row, m, 4] - models[m, OWN]
        x[row, m, 4] = models[m, OWN] + old * gap
        for b in range(4):
            p[row, m, 4, b] = old * p[row, m, 4, b] + both * gap * d[b]
        p[row, m, 4, 4] = old * p[row, m, 4, 4] + new * models[m, OWN_SIGMA] ** 2 + both * gap * gap


@njit(cache=True)
def _go_straight(x, p, row, m, dt):  # type: ignore[no-untyped-def]
    """A state moved in place at constant velocity, in the lower half of its covariance."""
    x[row, m, 0] += dt * x[row, m, 2]
    x[row, m, 1] += dt * x[row, m, 3]
    ee, en, nn = p[row, m, 2, 2], p[row, m, 3, 2], p[row, m, 3, 3]
    p[row, m, 0, 0] += dt * (2.0 * p[row, m, 2, 0] + dt * ee)
    p[row, m, 1, 0] += dt * (p[row, m, 3, 0] + p[row, m, 2, 1] + dt * en)
    p[row, m, 1, 1] += dt * (2.0 * p[row, m, 3, 1] + dt * nn)
    p[row, m, 2, 0] += dt * ee
    p[row, m, 3, 0] += dt * en
    p[row, m, 2, 1] += dt * en
    p[row, m, 3, 1] += dt * nn


@njit(cache=True)
def _turn(x, row, m, dt, f):  # type: ignore[no-untyped-def]
    """A state moved in place at its turn rate; f (4, 3) becomes the Jacobian of position and velocity by the last three."""
    rate, east, north = x[row, m, 4], x[row, m, 2], x[row, m, 3]
    s, c, ds, dc = _turn_terms(rate, dt)
    cos, sin = 1.0 - rate * c, rate * s
    f[0, 0], f[0, 1], f[0, 2] = s, -c, ds * east - dc * north
    f[1, 0], f[1, 1], f[1, 2] = c, s, dc * east + ds * north
    f[2, 0], f[2, 1], f[2, 2] = cos, -sin, -dt * (sin * east + cos * north)
    f[3, 0], f[3, 1], f[3, 2] = sin, cos, dt * (cos * east - sin * north)
    x[row, m, 0] += s * east - c * north
    x[row, m, 1] += c * east + s * north
    x[row, m, 2], x[row, m, 3] = cos * east - sin * north, sin * east + cos * north


@njit(cache=True)
def _speed_up(x, row, m, dt, f):  # type: ignore[no-untyped-def]
    """A state moved in place at its acceleration along the track; f as in _turn."""
    gain, speed = dt * x[row, m, 4], math.sqrt(x[row, m, 2] ** 2 + x[row, m, 3] ** 2 + SLOW * SLOW)
    east, north = x[row, m, 2] / speed, x[row, m, 3] / speed
    part, half = gain / speed, 0.5 * dt
    f[2, 0], f[2, 1], f[2, 2] = 1.0 + part * (1.0 - east * east), -part * east * north, dt * east
    f[3, 0], f[3, 1], f[3, 2] = f[2, 1], 1.0 + part * (1.0 - north * north), dt * north
    f[0, 0], f[0, 1], f[0, 2] = half * (1.0 + f[2, 0]), half * f[2, 1], half * f[2, 2]
    f[1, 0], f[1, 1], f[1, 2] = half * f[3, 0], half * (1.0 + f[3, 1]), half * f[3, 2]
    x[row, m, 0] += dt * x[row, m, 2] + half * gain * east
    x[row, m, 1] += dt * x[row, m, 3] + half * gain * north
    x[row, m, 2] += gain * east
    x[row, m, 3] += gain * north


@njit(cache=True)
def _carry(p, row, m, f, n):  # type: ignore[no-untyped-def]
    """F P F' in place, in the lower half of P. F is the unit matrix but for f: the first four rows of its last three columns.

    With P = [[A, N'], [N, M]], position apart: n (4, 3), room to work in, becomes the last three columns of F P.
    """
    vee, vne, vnn = p[row, m, 2, 2], p[row, m, 3, 2], p[row, m, 3, 3]
    oe, on, oo = p[row, m, 4, 2], p[row, m, 4, 3], p[row, m, 4, 4]
    for a in range(4):
        n[a, 0] = f[a, 0] * vee + f[a, 1] * vne + f[a, 2] * oe
        n[a, 1] = f[a, 0] * vne + f[a, 1] * vnn + f[a, 2] * on
        n[a, 2] = f[a, 0] * oe + f[a, 1] * on + f[a, 2] * oo
    for a in range(2):
        for b in range(a + 1):
            t = p[row, m, a, b] + n[a, 0] * f[b, 0] + n[a, 1] * f[b, 1] + n[a, 2] * f[b, 2]
            t += f[a, 0] * p[row, m, 2, b] + f[a, 1] * p[row, m, 3, b] + f[a, 2] * p[row, m, 4, b]
            p[row, m, a, b] = t + p[row, m, 2, a] * f[b, 0] + p[row, m, 3, a] * f[b, 1] + p[row, m, 4, a] * f[b, 2]
    for b in range(2):
        for k in range(3):
            n[b, k] += p[row, m, k + 2, b]
        p[row, m, 4, b] = n[b, 2]
        for a in range(2, 4):
            p[row, m, a, b] = f[a, 0] * n[b, 0] + f[a, 1] * n[b, 1] + f[a, 2] * n[b, 2]
    for a in range(2, 4):
        p[row, m, 4, a] = n[a, 2]
        for b in range(2, a + 1):
            p[row, m, a, b] = n[a, 0] * f[b, 0] + n[a, 1] * f[b, 1] + n[a, 2] * f[b, 2]


@njit(cache=True)
def _predict_row(x, p, mode, row, dt, renewal_s, models, mean, cov, d, f, n):  # type: ignore[no-untyped-def]
    """One row after dt > 0, in place; the arguments behind `models` are room to work in."""
    keep = math.exp(-dt / renewal_s)
    _pool(x, p, mode, row, mean, cov)
    for m in range(mode.shape[1]):
        old = keep * mode[row, m]
        mode[row, m] = old + (1.0 - keep) * models[m, SHARE]
        _mix(x, p, row, m, old / mode[row, m], mean, cov, models, d)
        if models[m, KIND] == STRAIGHT:
            _go_straight(x, p, row, m, dt)
        else:
            if models[m, KIND] == TURNING:
                _turn(x, row, m, dt, f)
            else:
                _speed_up(x, row, m, dt, f)
            _carry(p, row, m, f, n)
            p[row, m, 4, 4] += models[m, OWN_NOISE] * dt
        noise = models[m, NOISE] * dt
        for a in range(2):
            p[row, m, a, a] += noise * dt * dt / 3.0
            p[row, m, a + 2, a] += 0.5 * noise * dt
            p[row, m, a + 2, a + 2] += noise
        for a in range(SIZE):
            for b in range(a):
                p[row, m, b, a] = p[row, m, a, b]


@njit(cache=True)
def predict_in_place(x, p, mode, dt_s, renewal_s, models):  # type: ignore[no-untyped-def]
    """As sided_predict, but x, p and mode are overwritten."""
    mean, cov, d, f, n = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty((4, 3)), np.empty((4, 3))
    for row in range(len(mode)):
        if dt_s[row] > 0.0:
            _predict_row(x, p, mode, row, dt_s[row], renewal_s, models, mean, cov, d, f, n)


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _copy_row(x, p, mode, row, x_out, p_out, mode_out, to):  # type: ignore[no-untyped-def]
    """One row to the row `to` of others."""
    for m in range(mode.shape[1]):
        mode_out[to, m] = mode[row, m]
        for a in range(SIZE):
            x_out[to, m, a] = x[row, m, a]
            for b in range(SIZE):
                p_out[to, m, a, b] = p[row, m, a, b]


@njit(cache=True)
def sided_predict(
    state: Floats, covariance: Floats, mode: Floats, dt_s: Floats, renewal_s: float, models: Floats
) -> tuple[Floats, Floats, Floats]:
    """State, covariance and probability of every model after dt: what takes up a motion anew, then each model's own motion.

    Args:
        state: (N, J, 5); covariance: (N, J, 5, 5); mode: (N, J) probabilities, positive, rows sum to 1.
        dt_s: (N,) not negative; 0 changes nothing. renewal_s: mean time before a motion is taken up anew.
        models: (J, 6), see the module.
    Returns: state (N, J, 5), covariance (N, J, 5, 5), mode (N, J).
    """
    out = state.copy(), covariance.copy(), mode.copy()
    predict_in_place(out[0], out[1], out[2], dt_s, renewal_s, models)
    return out


@njit(cache=True)
def sided_update(
    state: Floats, covariance: Floats, mode: Floats, z: Floats, noise: Floats, has_velocity: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """State, covariance and probability of every model after a measurement, and how likely the measurement was.

    Args, Returns: as of coastwatch.kernels.imm.imm_update.
    """
    out = state.copy(), covariance.copy(), mode.copy(), np.empty(len(mode))
    update_in_place(out[0], out[1], out[2], z, noise, has_velocity, out[3])
    return out


@njit(cache=True)
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
            _predict_row(one[0], one[1], one[2], 0, dt_s[row], renewal_s, models, room[0], room[1], room[2], room[3], room[4])
        _pool(one[0], one[1], one[2], 0, room[0], room[1])
        for a in range(4):
            mean[row, a] = room[0][a]
            for b in range(a + 1):
                cov[row, a, b] = room[1][a, b]
                cov[row, b, a] = room[1][a, b]
    return mean, cov


@njit(cache=True)
def _measure(z, r, mean, cov, late, z_out, r_out):  # type: ignore[no-untyped-def]
    """A plot brought forward by `late` seconds (not positive: back in time) into the last two (1, 2), (1, 2, 2); its squared distance."""
    for a in range(2):
        z_out[0, a] = z[a] - mean[a + 2] * late
        for b in range(2):
            r_out[0, a, b] = r[a, b] + cov[max(a, b) + 2, min(a, b) + 2] * late * late
    ee, en, nn = cov[0, 0] + r_out[0, 0, 0], cov[1, 0] + r_out[0, 1, 0], cov[1, 1] + r_out[0, 1, 1]
    east, north = z_out[0, 0] - mean[0], z_out[0, 1] - mean[1]
    return (nn * east * east - 2.0 * en * east * north + ee * north * north) / (ee * nn - en * en)


@njit(cache=True)
def _absorb_rows(state, covariance, mode, rows, dt_s, position, noise, renewal_s, models, x, p, weight, fit, square):  # type: ignore[no-untyped-def]
    j = mode.shape[1]
    mean, cov, d, f, n = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty((4, 3)), np.empty((4, 3))
    each, gain, z, r = np.empty(j), np.empty((4, SIZE)), np.empty((1, 2)), np.empty((1, 2, 2))
    for k in range(len(rows)):
        _copy_row(state, covariance, mode, rows[k], x, p, weight, k)
        if dt_s[k] > 0.0:
            _predict_row(x, p, weight, k, dt_s[k], renewal_s, models, mean, cov, d, f, n)
        _pool(x, p, weight, k, mean, cov)
        square[k] = _measure(position[k], noise[k], mean, cov, min(dt_s[k], 0.0), z, r)
        for m in range(j):
            each[m] = _fix(x, p, k, m, z, r, 0, gain)
        fit[k] = _weigh(weight, k, each)


@njit(cache=True)
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
