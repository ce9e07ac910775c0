"""One track that weighs several plots, by the textbook: whole Kalman updates, the mixture written down, moments by sums.

Also existence and visibility as a Markov chain with three states. Sources: Y. Bar-Shalom, X. R. Li, Multitarget-Multisensor Tracking,
1995, section 3.4 (probabilistic data association); D. Musicki, R. Evans, Joint integrated probabilistic data association, IEEE Trans.
AES 40(3), 2004.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.stats import multivariate_normal


def likelihoods(states, covariances, z, noise):
    """N(z; H x, H P H' + R) of one plot for each model. (J,)"""
    return np.array([multivariate_normal(x[:2], p[:2, :2] + noise).pdf(z) for x, p in zip(states, covariances, strict=True)])


def update(states, covariances, mode, plots, shares):
    """States (J, d), covariances (J, d, d) and mode probabilities (J,) after all plots. Args: plots: (z, R) each; shares: of each."""
    parts = [(1.0 - sum(shares), mode, states, covariances)]
    for (z, noise), share in zip(plots, shares, strict=True):
        given = mode * likelihoods(states, covariances, z, noise)
        moved, narrowed = [], []
        for x, p in zip(states, covariances, strict=True):
            h = np.eye(2, len(x))
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise)
            moved.append(x + gain @ (z - h @ x))
            narrowed.append((np.eye(len(x)) - gain @ h) @ p)
        parts.append((share, given / given.sum(), np.array(moved), np.array(narrowed)))
    after = sum(share * of for share, of, _, _ in parts)
    mean = sum((share * of)[:, None] * x for share, of, x, _ in parts) / after[:, None]
    spread = sum(
        (share * of)[:, None, None] * (p + (x - mean)[:, :, None] * (x - mean)[:, None, :]) for share, of, x, p in parts
    )
    return mean, spread / after[:, None, None], after


class ThreeStates:
    """A vessel is gone, hidden or visible: the probability of each."""

    def __init__(self, existence, visibility, end, hide, show):
        self.p = np.array([1.0 - existence, existence * (1.0 - visibility), existence * visibility])
        self.rates = np.array([[0.0, 0.0, 0.0], [end, -end - show, show], [end, hide, -end - hide]])

    def wait(self, dt):
        self.p = self.p @ expm(self.rates * dt)

    def miss(self, detection):
        """A look without a plot."""
        self.p = self.p * np.array([1.0, 1.0, 1.0 - detection])
        self.p /= self.p.sum()

    def look(self, detection, likelihood_ratio):
        """A look with one plot in the gate, so many times as likely of the vessel as of clutter."""
        missed, taken = (
            self.p * np.array([1.0, 1.0, 1.0 - detection]),
            self.p * np.array([0.0, 0.0, detection * likelihood_ratio]),
        )
        self.p = (missed + taken) / (missed + taken).sum()

    @property
    def existence(self):
        return self.p[1:].sum()

    @property
    def visibility(self):
        return self.p[2] / self.p[1:].sum()
