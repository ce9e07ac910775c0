"""An interacting multiple model filter whose velocity may jump, one filter at a time, with matrices. Imports nothing of coastwatch.

Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 11.6.4 and 11.6.6.
"""

from __future__ import annotations

import imm_textbook as textbook
import numpy as np


def jump(dt, variance):
    """Covariance of a random step of the velocity at a moment evenly spread over dt."""
    out = np.zeros((5, 5))
    block = variance * np.array([[dt**2 / 3.0, dt / 2.0], [dt / 2.0, 1.0]])
    for axis in range(2):
        out[np.ix_([axis, axis + 2], [axis, axis + 2])] = block
    return out


def step(x, p, mode, dt, z, r, models, rate, variance):
    """x (J, 5), p (J, 5, 5), mode (J,) and log-likelihood after dt and a measurement of the first len(z) components."""
    x, p, mode = textbook.predict(x, p, mode, dt, *models)
    with_jump = np.array([pk + jump(dt, v) for pk, v in zip(p, variance, strict=True)])
    chance = 1.0 - np.exp(-rate * dt)
    prior = np.stack([mode * (1.0 - chance), mode * chance])
    both = np.concatenate([x, x]), np.concatenate([p, with_jump])
    weight = np.maximum(prior.ravel(), 1e-300)
    xs, ps, now, fit = textbook.update(*both, weight, z, r)
    j, now = len(mode), now.reshape(2, -1)
    out = [textbook.estimate(xs[m::j], ps[m::j], now[:, m] / now[:, m].sum()) for m in range(j)]
    return np.array([o[0] for o in out]), np.array([o[1] for o in out]), now.sum(axis=0), fit


def ahead(x, p, mode, dt, models, rate, variance):
    """Mean and covariance after dt without a measurement."""
    x, p, mode = textbook.predict(x, p, mode, dt, *models)
    chance = 1.0 - np.exp(-rate * dt)
    p = np.array([pk + c * jump(dt, v) for pk, c, v in zip(p, chance, variance, strict=True)])
    return textbook.estimate(x, p, mode)
