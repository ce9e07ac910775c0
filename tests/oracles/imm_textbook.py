"""The interacting multiple model filter of the textbook, one track at a time, with matrices. Imports nothing of coastwatch.

Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.6.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal


def transition_matrix(sojourn, dt):
    """transition[i, j]: probability of model j now, given model i before."""
    j = len(sojourn)
    out = np.zeros((j, j))
    for i in range(j):
        for k in range(j):
            stay = (1.0 + (j - 1) * np.exp(-dt / sojourn[i] * j / (j - 1))) / j if j > 1 else 1.0
            out[i, k] = stay if i == k else (1.0 - stay) / (j - 1)
    return out


def moved(x, dt, kind):
    """State after dt; the turn by rotating the velocity and integrating it over small steps of Simpson's rule."""
    if kind == 0:
        return np.array([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3], 0.0 if dt > 0.0 else x[4]])
    times = np.linspace(0.0, dt, 2001)
    turn = np.exp(1j * x[4] * times)
    velocity = (x[2] + 1j * x[3]) * turn
    weight = np.full(len(times), 2.0)
    weight[1::2] = 4.0
    weight[0] = weight[-1] = 1.0
    way = (velocity * weight).sum() * (dt / 2000.0) / 3.0
    return np.array([x[0] + way.real, x[1] + way.imag, velocity[-1].real, velocity[-1].imag, x[4]])


def jacobian(x, dt, kind, steps=(1e-2, 1e-2, 1e-3, 1e-3, 1e-5)):
    """Of `moved`, by central differences."""
    out = np.zeros((5, 5))
    for k, h in enumerate(steps):
        e = np.zeros(5)
        e[k] = h
        out[:, k] = (moved(x + e, dt, kind) - moved(x - e, dt, kind)) / (2.0 * h)
    return out


def process_noise(dt, kind, noise, turn_noise, turn_sigma):
    out = np.zeros((5, 5))
    block = noise * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    for axis in range(2):
        out[np.ix_([axis, axis + 2], [axis, axis + 2])] = block
    out[4, 4] = turn_noise * dt if kind == 1 else (turn_sigma**2 if dt > 0.0 else 0.0)
    return out


def predict(x, p, mode, dt, kind, noise, turn_noise, turn_sigma, sojourn):
    """x (J, 5), p (J, 5, 5), mode (J,) after dt."""
    pi = transition_matrix(sojourn, dt)
    now = mode @ pi
    xs, ps = np.zeros_like(x), np.zeros_like(p)
    for j in range(len(mode)):
        weight = pi[:, j] * mode / now[j]
        mean = weight @ x
        cov = sum(w * (pk + np.outer(xk - mean, xk - mean)) for w, xk, pk in zip(weight, x, p, strict=True))
        f = jacobian(mean, dt, kind[j])
        xs[j] = moved(mean, dt, kind[j])
        ps[j] = f @ cov @ f.T + process_noise(dt, kind[j], noise[j], turn_noise[j], turn_sigma[j])
    return xs, ps, now


def update(x, p, mode, z, r):
    """x (J, 5), p (J, 5, 5), mode (J,) and log-likelihood after a measurement of the first len(z) components."""
    d = len(z)
    h = np.eye(d, 5)
    xs, ps, fit = np.zeros_like(x), np.zeros_like(p), np.zeros(len(mode))
    for j in range(len(mode)):
        s = h @ p[j] @ h.T + r
        gain = p[j] @ h.T @ np.linalg.inv(s)
        xs[j] = x[j] + gain @ (z - h @ x[j])
        rest = np.eye(5) - gain @ h
        ps[j] = rest @ p[j] @ rest.T + gain @ r @ gain.T
        fit[j] = multivariate_normal.logpdf(z, h @ x[j], s)
    weight = np.log(mode) + fit
    total = np.logaddexp.reduce(weight)
    return xs, ps, np.exp(weight - total), total


def estimate(x, p, mode):
    mean = mode @ x
    return mean, sum(w * (pk + np.outer(xk - mean, xk - mean)) for w, xk, pk in zip(mode, x, p, strict=True))
