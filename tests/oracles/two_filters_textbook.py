"""Two Kalman filters of one target in one run, with plain matrices: fusion of independent and dependent tracks, partial feedback.

State: east, north, east rate, north rate. The joint error is followed by the gains themselves, not by covariances before and after.
Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, sections 5.2 and 9.3.
"""

import numpy as np

H = np.eye(2, 4)


def motion(noise, t=1.0):
    """F and Q of constant velocity over t."""
    q = noise * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    return np.kron(np.array([[1.0, t], [0.0, 1.0]]), np.eye(2)), np.kron(q, np.eye(2))


def update(x, p, z, variance):
    """State, covariance and gain after a position."""
    gain = p @ H.T @ np.linalg.inv(H @ p @ H.T + variance * np.eye(2))
    return x + gain @ (z - H @ x), (np.eye(4) - gain @ H) @ p, gain


def fuse(x_i, p_i, x_j, p_j, c):
    """Estimate of least variance from two whose errors have the cross-covariance c, by generalised least squares."""
    joint = np.block([[p_i, c], [c.T, p_j]])
    g = np.vstack([np.eye(4), np.eye(4)])
    weight = np.linalg.inv(joint) @ g
    p = np.linalg.inv(g.T @ weight)
    return p @ weight.T @ np.concatenate([x_i, x_j]), p


class Pair:
    """A radar filter without and one with feedback, an AIS filter, and the cross-covariances."""

    def __init__(self, x, p_radar, x_ais, p_ais, noise):
        self.f, self.q = motion(noise)
        self.radar, self.fed, self.ais = (x, p_radar), (x, p_radar), (x_ais, p_ais)
        self.c, self.c_fed = np.zeros((4, 4)), np.zeros((4, 4))

    def step(self, plot=None, plot_variance=1.0, report=None, report_variance=1.0, first=False):
        """One second on. Returns: independent, dependent and fed back estimates with covariance."""
        f, q = self.f, self.q
        k_radar = k_fed = k_ais = np.zeros((4, 2))
        if not first:
            self.radar, self.fed, self.ais = ((f @ x, f @ p @ f.T + q) for x, p in (self.radar, self.fed, self.ais))
            self.c, self.c_fed = (f @ c @ f.T + q for c in (self.c, self.c_fed))
        if plot is not None:
            *self.radar, k_radar = update(*self.radar, plot, plot_variance)
            *self.fed, k_fed = update(*self.fed, plot, plot_variance)
        if report is not None:
            *self.ais, k_ais = update(*self.ais, report, report_variance)
        right = (np.eye(4) - k_ais @ H).T
        self.c = (np.eye(4) - k_radar @ H) @ self.c @ right
        self.c_fed = (np.eye(4) - k_fed @ H) @ self.c_fed @ right
        independent = fuse(*self.radar, *self.ais, np.zeros((4, 4)))
        dependent = fuse(*self.radar, *self.ais, self.c)
        x, p, c = *self.fed, self.c_fed
        gain = (p - c) @ np.linalg.inv(p + self.ais[1] - c - c.T)
        self.c_fed = (np.eye(4) - gain) @ c + gain @ self.ais[1]
        self.fed = x + gain @ (self.ais[0] - x), p - gain @ (p - c).T
        return independent, dependent, self.fed
