"""How models of unequal states are mixed and move, one row a track: scalar code by numba, called by sided_imm.

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

from coastwatch.kernels.filters.coordinated_turn import turn_terms
from coastwatch.kernels.filters.imm import SIZE
from coastwatch.kernels.filters.model_kinds import KIND, NOISE, OWN, OWN_NOISE, OWN_SIGMA, SHARE, STRAIGHT, TURNING
from coastwatch.kernels.jit import jit

SLOW = 0.5  # m/s: a vessel slower than this has no direction in which to gain speed


@jit
def pool(x, p, mode, row, mean, cov):  # type: ignore[no-untyped-def]
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


@jit
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


@jit
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


@jit
def _turn(x, row, m, dt, f):  # type: ignore[no-untyped-def]
    """A state moved in place at its turn rate; f (4, 3) becomes the Jacobian of position and velocity by the last three."""
    rate, east, north = x[row, m, 4], x[row, m, 2], x[row, m, 3]
    s, c, ds, dc = turn_terms(rate, dt)
    cos, sin = 1.0 - rate * c, rate * s
    f[0, 0], f[0, 1], f[0, 2] = s, -c, ds * east - dc * north
    f[1, 0], f[1, 1], f[1, 2] = c, s, dc * east + ds * north
    f[2, 0], f[2, 1], f[2, 2] = cos, -sin, -dt * (sin * east + cos * north)
    f[3, 0], f[3, 1], f[3, 2] = sin, cos, dt * (cos * east - sin * north)
    x[row, m, 0] += s * east - c * north
    x[row, m, 1] += c * east + s * north
    x[row, m, 2], x[row, m, 3] = cos * east - sin * north, sin * east + cos * north


@jit
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


@jit
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


@jit
def predict_row(x, p, mode, row, dt, renewal_s, models, mean, cov, d, f, n):  # type: ignore[no-untyped-def]
    """One row after dt > 0, in place; the arguments behind `models` are room to work in."""
    keep = math.exp(-dt / renewal_s)
    pool(x, p, mode, row, mean, cov)
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


@jit
def predict_in_place(x, p, mode, dt_s, renewal_s, models):  # type: ignore[no-untyped-def]
    """As sided_predict, but x, p and mode are overwritten."""
    mean, cov, d, f, n = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty((4, 3)), np.empty((4, 3))
    for row in range(len(mode)):
        if dt_s[row] > 0.0:
            predict_row(x, p, mode, row, dt_s[row], renewal_s, models, mean, cov, d, f, n)
