"""Interacting multiple models, one row a track: scalar code compiled by numba, the same to the bit in any batch.

State: east, north, east rate, north rate, turn rate (rad/s, positive to port, that is from east towards north).
Models, by `kind`:
    0  constant velocity: white acceleration of density `noise` (m2/s3); the turn rate is no part of the motion and after any
       time stands at its prior N(0, turn_sigma^2), so that a turn that begins is sought from straight ahead, both ways
    1  coordinated turn: the velocity turns at the estimated rate, which drifts with density `turn_noise` (rad2/s3); white
       acceleration of density `noise` on top; linearised about the state (extended Kalman filter)
Process noises are densities of continuous time, so that two short predictions are one long one.
transition[i, j] is the probability of model j now, given model i before. A model is left at the rate 1 / sojourn, for each of the
others alike; with equal sojourns this is the exact chain of continuous time, with unequal ones it is so to first order.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 6.2.2
(white acceleration), 11.6.6 (IMM) and 11.7 (coordinated turn).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.filters.coordinated_turn import turn_terms
from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SIZE = 5
FLOOR = 1e-12  # of a mode probability: a model that is ruled out today can come back, and nothing is divided by 0
LOG_TWO_PI = math.log(2.0 * math.pi)


@jit
def move(x, dt, kind, noise, turn_noise, turn_sigma, x_out, f_out, q_out):  # type: ignore[no-untyped-def]
    """One model's state after dt, the Jacobian of that and the process noise, into the last three arguments."""
    f_out[:] = 0.0
    q_out[:] = 0.0
    for k in range(SIZE):
        f_out[k, k] = 1.0
    if kind == 1:
        s, c, ds, dc = turn_terms(x[4], dt)
        sin, cos = math.sin(x[4] * dt), math.cos(x[4] * dt)
        f_out[0, 2], f_out[0, 3], f_out[0, 4] = s, -c, ds * x[2] - dc * x[3]
        f_out[1, 2], f_out[1, 3], f_out[1, 4] = c, s, dc * x[2] + ds * x[3]
        f_out[2, 2], f_out[2, 3], f_out[2, 4] = cos, -sin, -dt * (sin * x[2] + cos * x[3])
        f_out[3, 2], f_out[3, 3], f_out[3, 4] = sin, cos, dt * (cos * x[2] - sin * x[3])
        x_out[0], x_out[1] = x[0] + s * x[2] - c * x[3], x[1] + c * x[2] + s * x[3]
        x_out[2], x_out[3], x_out[4] = cos * x[2] - sin * x[3], sin * x[2] + cos * x[3], x[4]
        q_out[4, 4] = turn_noise * dt
    else:
        f_out[0, 2] = f_out[1, 3] = dt
        x_out[0], x_out[1], x_out[2], x_out[3] = x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]
        x_out[4] = x[4]
        if dt > 0.0:
            f_out[4, 4], x_out[4], q_out[4, 4] = 0.0, 0.0, turn_sigma * turn_sigma
    for k in range(2):
        q_out[k, k] = noise * dt * dt * dt / 3.0
        q_out[k, k + 2] = q_out[k + 2, k] = noise * dt * dt / 2.0
        q_out[k + 2, k + 2] = noise * dt


@jit
def moments(x, p, weight, mean, cov):  # type: ignore[no-untyped-def]
    """Mean and covariance of a mixture of Gaussians, into the last two arguments; the weights sum to one."""
    mean[:] = 0.0
    cov[:] = 0.0
    for i in range(x.shape[0]):
        for a in range(SIZE):
            mean[a] += weight[i] * x[i, a]
    for i in range(x.shape[0]):
        for a in range(SIZE):
            da = x[i, a] - mean[a]
            for b in range(a + 1):
                cov[a, b] += weight[i] * (p[i, a, b] + da * (x[i, b] - mean[b]))
    for a in range(SIZE):
        for b in range(a):
            cov[b, a] = cov[a, b]


@jit
def _sandwich(f, p, q, half, out):  # type: ignore[no-untyped-def]
    """F P F' + Q into `out`, symmetric to the bit."""
    for a in range(SIZE):
        for b in range(SIZE):
            t = 0.0
            for c in range(SIZE):
                t += f[a, c] * p[c, b]
            half[a, b] = t
    for a in range(SIZE):
        for b in range(a + 1):
            t = q[a, b]
            for c in range(SIZE):
                t += half[a, c] * f[b, c]
            out[a, b] = t
            out[b, a] = t


@jit
def predict_row(x, p, mode, dt, models, work, x_out, p_out, mode_out):  # type: ignore[no-untyped-def]
    """One bank of models after dt, into the last three: x (J, 5), p (J, 5, 5), mode (J,); work: of `room_to_predict`."""
    kind, noise, turn_noise, turn_sigma, sojourn = models
    weight, stay, mixed, cov, f, q, half = work
    j = len(mode)
    for i in range(j):
        stay[i] = 1.0
        if j > 1:
            stay[i] = (1.0 + (j - 1) * math.exp(-dt / sojourn[i] * j / (j - 1))) / j
    for m in range(j):
        total = 0.0
        for i in range(j):
            weight[i] = mode[i] * (stay[i] if i == m else (1.0 - stay[i]) / (j - 1))
            total += weight[i]
        mode_out[m] = total
        for i in range(j):
            weight[i] /= total
        moments(x, p, weight, mixed, cov)
        move(mixed, dt, kind[m], noise[m], turn_noise[m], turn_sigma[m], x_out[m], f, q)
        _sandwich(f, cov, q, half, p_out[m])


@jit
def room_to_predict(j):  # type: ignore[no-untyped-def]
    """Arrays that `predict_row` works in, for so many models."""
    square = (SIZE, SIZE)
    return np.zeros(j), np.zeros(j), np.zeros(SIZE), np.zeros(square), np.zeros(square), np.zeros(square), np.zeros(square)


@jit
def _predict_rows(x, p, mode, dt, kind, noise, turn_noise, turn_sigma, sojourn, x_out, p_out, mode_out):  # type: ignore[no-untyped-def]
    work, models = room_to_predict(mode.shape[1]), (kind, noise, turn_noise, turn_sigma, sojourn)
    for row in range(len(mode)):
        predict_row(x[row], p[row], mode[row], dt[row], models, work, x_out[row], p_out[row], mode_out[row])


@jit
def _correct(x, p, z, r, d, white, low, gain, x_out, p_out):  # type: ignore[no-untyped-def]
    """One Kalman update with the first d components measured; returns the log-likelihood. x_out may be x, and p_out p."""
    log_det = 0.0
    for a in range(d):
        for b in range(a + 1):
            t = p[a, b] + r[a, b]
            for c in range(b):
                t -= low[a, c] * low[b, c]
            low[a, b] = math.sqrt(t) if a == b else t / low[b, b]
        log_det += math.log(low[a, a])
        t = z[a] - x[a]
        for c in range(a):
            t -= low[a, c] * white[c]
        white[a] = t / low[a, a]
    for s in range(SIZE):  # gain = P H' L^-T, so that K S K' = gain gain'
        for a in range(d):
            t = p[s, a]
            for c in range(a):
                t -= gain[s, c] * low[a, c]
            gain[s, a] = t / low[a, a]
    for s in range(SIZE):
        t = x[s]
        for a in range(d):
            t += gain[s, a] * white[a]
        x_out[s] = t
        for b in range(s + 1):
            t = p[s, b]
            for a in range(d):
                t -= gain[s, a] * gain[b, a]
            p_out[s, b] = t
            p_out[b, s] = t
    square = 0.0
    for a in range(d):
        square += white[a] * white[a]
    return -0.5 * square - log_det - 0.5 * d * LOG_TWO_PI


@jit
def update_row(x, p, mode, z, r, d, work, x_out, p_out, mode_out):  # type: ignore[no-untyped-def]
    """One bank of models after its first d components were measured, into the last three, which may be the first; the log-likelihood.

    Args: x (J, 5), p (J, 5, 5), mode (J,); z (4,), r (4, 4); work: of `room_to_update`.
    """
    white, low, gain, weight = work
    j, best = len(mode), -np.inf
    for m in range(j):
        fit = _correct(x[m], p[m], z, r, d, white, low, gain, x_out[m], p_out[m])
        weight[m] = fit + math.log(max(mode[m], FLOOR))
        best = max(best, weight[m])
    total = 0.0
    for m in range(j):
        weight[m] = math.exp(weight[m] - best)
        total += weight[m]
    floored = 0.0
    for m in range(j):
        weight[m] = max(weight[m] / total, FLOOR)
        floored += weight[m]
    for m in range(j):
        mode_out[m] = weight[m] / floored
    return best + math.log(total)


@jit
def room_to_update(j):  # type: ignore[no-untyped-def]
    """Arrays that `update_row` works in, for so many models."""
    return np.zeros(4), np.zeros((4, 4)), np.zeros((SIZE, 4)), np.zeros(j)


@jit
def _update_rows(x, p, mode, z, r, has_velocity, x_out, p_out, mode_out, log_likelihood):  # type: ignore[no-untyped-def]
    work = room_to_update(mode.shape[1])
    for row in range(len(mode)):
        d = 4 if has_velocity[row] else 2
        log_likelihood[row] = update_row(
            x[row], p[row], mode[row], z[row], r[row], d, work, x_out[row], p_out[row], mode_out[row]
        )


@jit
def _estimate_rows(x, p, mode, mean, cov):  # type: ignore[no-untyped-def]
    for row in range(len(mode)):
        moments(x[row], p[row], mode[row], mean[row], cov[row])


@jit
def imm_predict(
    state: Floats,
    covariance: Floats,
    mode: Floats,
    dt_s: Floats,
    kind: Ints,
    noise: Floats,
    turn_noise: Floats,
    turn_sigma: Floats,
    sojourn_s: Floats,
) -> tuple[Floats, Floats, Floats]:
    """State, covariance and probability of every model after dt: mixing, then each model's own motion.

    Args:
        state: (N, J, 5) m, m/s, rad/s; covariance: (N, J, 5, 5); mode: (N, J) probabilities, positive, rows sum to 1.
        dt_s: (N,) not negative; 0 changes nothing.
        kind: (J,) 0 constant velocity, 1 coordinated turn; noise: (J,) m2/s3; turn_noise: (J,) rad2/s3, read by kind 1;
        turn_sigma: (J,) rad/s, read by kind 0; sojourn_s: (J,) mean time in a model.
    Returns: state (N, J, 5), covariance (N, J, 5, 5), mode (N, J).
    Source: see the module.
    """
    out = np.empty(state.shape), np.empty(covariance.shape), np.empty(mode.shape)
    _predict_rows(state, covariance, mode, dt_s, kind, noise, turn_noise, turn_sigma, sojourn_s, out[0], out[1], out[2])
    return out


@jit
def imm_update(
    state: Floats, covariance: Floats, mode: Floats, z: Floats, noise: Floats, has_velocity: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """State, covariance and probability of every model after a measurement, and how likely the measurement was.

    Args:
        state: (N, J, 5); covariance: (N, J, 5, 5); mode: (N, J).
        z: (N, 4) east, north, east rate, north rate; noise: R, (N, 4, 4); has_velocity: (N,), where False only z[:, :2] and
        noise[:, :2, :2] are read.
    Returns: state (N, J, 5), covariance (N, J, 5, 5), mode (N, J) of at least FLOOR, natural logarithm of the density of the
        measurement (N,).
    Source: see the module.
    """
    out = np.empty(state.shape), np.empty(covariance.shape), np.empty(mode.shape), np.empty(len(mode))
    _update_rows(state, covariance, mode, z, noise, has_velocity, out[0], out[1], out[2], out[3])
    return out


@jit
def imm_estimate(state: Floats, covariance: Floats, mode: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance over the models.

    Args: state: (N, J, 5); covariance: (N, J, 5, 5); mode: (N, J), rows sum to 1. Returns: (N, 5) and (N, 5, 5).
    """
    mean, cov = np.empty((len(mode), SIZE)), np.empty((len(mode), SIZE, SIZE))
    _estimate_rows(state, covariance, mode, mean, cov)
    return mean, cov


@jit
def _moved(x, dt, kind, noise, turn_noise, turn_sigma, x_out, f, q):  # type: ignore[no-untyped-def]
    move(x, dt, kind, noise, turn_noise, turn_sigma, x_out, f, q)


def one_model(
    state: NDArray[Any], dt_s: float, kind: int, noise: float, turn_noise: float, turn_sigma: float
) -> tuple[Floats, ...]:
    """One state moved by one model: the state, its Jacobian F and the process noise Q, for a filter that keeps its own books.

    Args: state: (5,). Returns: (5,), (5, 5), (5, 5).
    """
    out = np.empty(SIZE), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    _moved(np.ascontiguousarray(state), float(dt_s), int(kind), float(noise), float(turn_noise), float(turn_sigma), *out)
    return out
