"""The IMM of motions that are taken up anew, by the textbook, one track at a time. Imports nothing of coastwatch.

Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.6; what a model needs and
another does not have is taken from the prior (Granstrom, Willett, Bar-Shalom, 2015).
A model is (kind, noise, manoeuvre mean, manoeuvre sigma, drift of the manoeuvre, prior probability).
"""

from __future__ import annotations

import imm_textbook as textbook
import numpy as np

STRAIGHT, TURNING, SPEEDING = 0, 1, 2
SLOW = 0.5


def moved(x, dt, kind):
    """State after dt, its fifth component kept."""
    if kind == TURNING:
        return textbook.moved(x, dt, 1)
    way = x[2:4] * dt
    velocity = x[2:4]
    if kind == SPEEDING:
        ahead = x[2:4] / np.sqrt(x[2:4] @ x[2:4] + SLOW**2)
        way = way + 0.5 * dt**2 * x[4] * ahead
        velocity = velocity + dt * x[4] * ahead
    return np.concatenate([x[:2] + way, velocity, x[4:]])


def jacobian(x, dt, kind, steps=(1e-2, 1e-2, 1e-4, 1e-4, 1e-5)):
    """Of `moved`, by central differences."""
    out = np.zeros((5, 5))
    for k, h in enumerate(steps):
        e = np.zeros(5)
        e[k] = h
        out[:, k] = (moved(x + e, dt, kind) - moved(x - e, dt, kind)) / (2.0 * h)
    return out


def transition_matrix(share, renewal, dt):
    """transition[i, j]: probability of model j now, given model i before."""
    keep = np.exp(-dt / renewal)
    return keep * np.eye(len(share)) + (1.0 - keep) * np.tile(share, (len(share), 1))


def predict(x, p, mode, dt, renewal, models):
    """x (J, 5), p (J, 5, 5), mode (J,) after dt, each past apart: kept in its model, or taken up anew from any model."""
    share, j = models[:, 5], len(mode)
    keep = np.exp(-dt / renewal)
    now = mode @ transition_matrix(share, renewal, dt)
    xs, ps = np.zeros_like(x), np.zeros_like(p)
    for m, (kind, noise, mean_before, sigma, drift, _) in enumerate(models):
        pasts = [(keep * mode[m], x[m], p[m])]
        for i in range(j):
            fresh, spread = x[i].copy(), np.zeros((5, 5))
            fresh[4] = mean_before if kind != STRAIGHT else 0.0
            spread[:4, :4] = p[i][:4, :4]
            spread[4, 4] = sigma**2 if kind != STRAIGHT else 0.0
            pasts.append(((1.0 - keep) * mode[i] * share[m], fresh, spread))
        mean = sum(w * a for w, a, _ in pasts) / now[m]
        cov = sum(w * (c + np.outer(a - mean, a - mean)) for w, a, c in pasts) / now[m]
        f = jacobian(mean, dt, kind)
        xs[m] = moved(mean, dt, kind)
        ps[m] = f @ cov @ f.T + textbook.process_noise(dt, 1, noise, drift if kind != STRAIGHT else 0.0, 0.0)
    return xs, ps, now
