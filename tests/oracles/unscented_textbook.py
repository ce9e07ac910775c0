"""IMM-JPDA with unscented filters by the textbook: one track and one plot at a time, whole matrices, every joint assignment.

Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, equations (1) to (9); S. J. Julier, J. K.
Uhlmann, 1997; J. D. Glass, W. D. Blair, Y. Bar-Shalom, 2013.
"""

from __future__ import annotations

import marginals_textbook
import numpy as np

CENTRE = 1.0 / 3.0


def wrapped(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def points(mean, covariance):
    """The sigma points and their weights."""
    size = len(mean)
    root = np.linalg.cholesky(covariance) * np.sqrt(size / (1.0 - CENTRE))
    weights = np.r_[CENTRE, np.full(2 * size, (1.0 - CENTRE) / (2.0 * size))]
    return np.vstack([mean, mean + root.T, mean - root.T]), weights


def moved(model, x, dt):
    """One point of state and noise after a step."""
    if model == 0:
        east, north, course, speed, a, b = x
        chord = (speed + b / 2.0) * dt
        heading = course + a / 2.0
        return np.array([east + chord * np.sin(heading), north + chord * np.cos(heading), course + a, speed + b])
    east, north, course, speed, rate, a, b = x
    u = rate + b / 2.0
    chord, heading = (speed + a / 2.0) * dt * np.sinc(u * dt / 2.0 / np.pi), course + u * dt / 2.0
    return np.array([east + chord * np.sin(heading), north + chord * np.cos(heading), course + u * dt, speed + a, rate + b])


def turned_round(mean, covariance):
    """A negative speed as the opposite course."""
    mean, flip = mean.copy(), np.eye(len(mean))
    if mean[3] < 0.0:
        mean[3], mean[2], flip[3, 3] = -mean[3], mean[2] + np.pi, -1.0
    mean[2] = wrapped(mean[2])
    return mean, flip @ covariance @ flip


def predicted(model, mean, covariance, dt, noise):
    size = len(mean)
    joint = np.zeros((size + 2, size + 2))
    joint[:size, :size], joint[size:, size:] = covariance, np.diag(noise * dt)
    cloud, weights = points(np.r_[mean, 0.0, 0.0], joint)
    cloud = np.array([moved(model, x, dt) for x in cloud])
    off = cloud - cloud[0]
    off[:, 2] = wrapped(off[:, 2])
    shift = weights @ off
    return turned_round(cloud[0] + shift, (off - shift).T @ np.diag(weights) @ (off - shift))


def measured(mean, covariance, site):
    """Range and bearing, their covariance, and that with the state."""
    cloud, weights = points(mean, covariance)
    east, north = (cloud[:, :2] - site).T
    seen = np.column_stack([np.hypot(east, north), np.arctan2(east, north)])
    off = seen - seen[0]
    off[:, 1] = wrapped(off[:, 1])
    shift = weights @ off
    return (
        seen[0] + shift,
        (off - shift).T @ np.diag(weights) @ (off - shift),
        (cloud - mean).T @ np.diag(weights) @ (off - shift),
    )


def mixed_and_predicted(models, mode, dt, sojourn, noise):
    """Both models, mixed without bias and predicted. Args: models: mean and covariance of each."""
    stay = np.exp(-dt / np.asarray(sojourn))
    change = np.array([[stay[0], 1.0 - stay[0]], [1.0 - stay[1], stay[1]]])
    joint = change * mode[:, None]
    after = joint.sum(axis=0)
    (x0, p0), (x1, p1) = models
    longer = np.zeros((5, 5))
    longer[:4, :4], longer[4, 4] = p0, p1[4, 4]
    pairs = [((x0, p0), (x1[:4], p1[:4, :4])), ((np.r_[x0, x1[4]], longer), (x1, p1))]
    out = []
    for model, ((a, pa), (b, pb)) in enumerate(pairs):
        w = joint[:, model] / after[model]
        off = b - a
        off[2] = wrapped(off[2])
        spread = w[0] * pa + w[1] * pb + w[0] * w[1] * np.outer(off, off)
        out.append(predicted(model, a + w[1] * off, spread, dt, noise[model]))
    return out, after


def looked(tracks, plots, site, gate, detection, density):
    """All tracks after the plots of one look. Args: tracks: (models, mode) of each, at its time; plots: (polar, variance) of each;
    density: (M,) of false plots. Returns: tracks, shares (N, M)."""
    likelihood = np.zeros((len(tracks), len(plots), 2))
    for n, (models, _) in enumerate(tracks):
        for m, (z, variance) in enumerate(plots):
            inside, found = False, np.zeros(2)
            for i, (x, p) in enumerate(models):
                zh, s, _ = measured(x, p, site)
                s = s + np.diag(variance)
                v = z - zh
                v[1] = wrapped(v[1])
                d2 = v @ np.linalg.solve(s, v)
                inside |= d2 < gate
                found[i] = np.exp(-d2 / 2.0) / (2.0 * np.pi * np.sqrt(np.linalg.det(s)))
            if inside:
                likelihood[n, m] = found
    modes = np.array([mode for _, mode in tracks])
    total = (likelihood * modes[:, None]).sum(axis=2)
    within = 1.0 - np.exp(-gate / 2.0)
    share = marginals_textbook.by_enumeration(detection * total / density / (1.0 - detection * within))
    out = []
    for n, (models, mode) in enumerate(tracks):
        joint = np.zeros((len(plots) + 1, 2))
        joint[0] = (1.0 - share[n].sum()) * mode
        for m in range(len(plots)):
            if total[n, m] > 0.0:
                joint[m + 1] = share[n, m] * mode * likelihood[n, m] / total[n, m]
        after, updated = joint.sum(axis=0), []
        for i, (x, p) in enumerate(models):
            beta = joint[1:, i] / after[i]
            zh, s0, cross = measured(x, p, site)
            steps, spread = np.zeros((len(plots), len(x))), p.copy()
            for m, (z, variance) in enumerate(plots):
                s = s0 + np.diag(variance)
                gain = cross @ np.linalg.inv(s)
                v = z - zh
                v[1] = wrapped(v[1])
                steps[m] = gain @ v
                spread += beta[m] * (np.outer(steps[m], steps[m]) - gain @ s @ gain.T)
            d = beta @ steps
            updated.append(turned_round(x + d, spread - np.outer(d, d)))
        out.append((updated, after / after.sum()))
    return out, share
