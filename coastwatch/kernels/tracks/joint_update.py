"""Tracks that weigh several plots: likelihood of each plot by each model, and the update by all plots at once. Compiled by numba.

Each model of a filter is a Gaussian. It becomes the mixture of "missed" and of its updates by the plots, weighted by their
probabilities. The mixture is reduced to one Gaussian with the same mean and covariance.
Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, equations (60) to (78), with the sums from "missed" on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.filters import imm
from coastwatch.kernels.filters.kalman import SIZE
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

TWO_PI = 2.0 * math.pi
LEAST = 1e-200  # of a likelihood: a plot at the edge of a wide gate is impossible for a model that is sure


class Hypotheses(NamedTuple):
    """Which plots may be of which tracks, sorted by track. T tracks, A pairs, J models."""

    slot: Ints  # (T,)
    start: Ints  # (T + 1,) first pair of each track
    plot: Ints  # (A,)
    position: Floats  # (A, 2) of the plot, at the time of the track
    noise: Floats  # (A, 2, 2) its covariance
    likelihood: Floats  # (A, J) of the plot, given the track and the model

    @property
    def track(self) -> Ints:
        """Of each pair, as a row of slot. (A,)"""
        return np.repeat(np.arange(len(self.slot)), np.diff(self.start))


@jit
def predict_to_plots(filters, estimates, hypotheses, columns, added, renewal, models):  # type: ignore[no-untyped-def]
    """Predict each track to the newest of its plots, and fill in the plots and their likelihoods. In place.

    A plot that is older than its track is brought forward by the velocity and is as much less certain.
    Args: filters: state (S, J, 5), covariance (S, J, 5, 5), mode probability (S, J); estimates: `Estimates` of them; columns:
    PlotColumns; added: (T,) share of the covariance of a plot that is added to it; renewal: as of `imm.predict_filters`; models: (J,)
    MODEL.
    """
    state, covariance, mode = filters
    work = imm.workspace(len(models))
    for t in range(len(hypotheses.slot)):
        n, first, end = hypotheses.slot[t], hypotheses.start[t], hypotheses.start[t + 1]
        time = estimates.time[n]
        for a in range(first, end):
            time = max(time, columns.time[hypotheses.plot[a]])
        if time > estimates.time[n]:
            copy_into(work.mean, estimates.mean[n])
            copy_into(work.spread, estimates.covariance[n])
            imm.predict_from_moments(state[n], covariance[n], mode[n], models, time - estimates.time[n], renewal, work)
            imm.combine(state[n], covariance[n], mode[n], models, n, estimates)
            estimates.time[n] = time
        for a in range(first, end):
            m = hypotheses.plot[a]
            z, noise = hypotheses.position[a], hypotheses.noise[a]
            copy_into(z, columns.position[m])
            copy_into(noise, columns.covariance[m])
            noise *= 1.0 + added[t]
            if columns.time[m] < time:
                imm.bring_forward(z, noise, time - columns.time[m], estimates.mean[n], estimates.covariance[n])
            for j in range(len(models)):
                hypotheses.likelihood[a, j] = _likelihood(state[n, j], covariance[n, j], z, noise)


@jit
def _likelihood(mean, covariance, z, noise):  # type: ignore[no-untyped-def]
    """N(z; H x, H P H' + R) of a measured position."""
    ee, en, nn = covariance[0, 0] + noise[0, 0], covariance[1, 0] + noise[1, 0], covariance[1, 1] + noise[1, 1]
    east, north, determinant = z[0] - mean[0], z[1] - mean[1], ee * nn - en * en
    square = (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant
    return max(math.exp(-0.5 * square) / (TWO_PI * math.sqrt(determinant)), LEAST)


@jit
def update_by_shares(filters, estimates, hypotheses, share, least, models):  # type: ignore[no-untyped-def]
    """Update each track by all of its plots at once, in place.

    Args: as of `predict_to_plots`; share: (A,) probability of each plot, given that the track exists; what is left is "missed";
    least: of the probability of a model.
    """
    state, covariance, mode = filters
    count = len(models)
    given = np.empty((0, count))  # probability of each plot and model
    for t in range(len(hypotheses.slot)):
        n, first, end = hypotheses.slot[t], hypotheses.start[t], hypotheses.start[t + 1]
        if end - first > len(given):
            given = np.empty((2 * (end - first), count))
        missed = 1.0
        for a in range(first, end):
            missed -= share[a]
            total = 0.0
            for j in range(count):
                total += mode[n, j] * hypotheses.likelihood[a, j]
            for j in range(count):
                given[a - first, j] = share[a] * mode[n, j] * hypotheses.likelihood[a, j] / total
        missed = max(missed, 0.0)
        floored = 0.0
        for j in range(count):
            after = missed * mode[n, j]
            for a in range(first, end):
                after += given[a - first, j]
            if after > 0.0:
                _mix_updates(state[n, j], covariance[n, j], hypotheses, (first, end), given[:, j], after)
            mode[n, j] = max(after, least)
            floored += mode[n, j]
        for j in range(count):
            mode[n, j] /= floored
        imm.combine(state[n], covariance[n], mode[n], models, n, estimates)


@jit
def _mix_updates(mean, covariance, hypotheses, pairs, given, total):  # type: ignore[no-untyped-def]
    """A Gaussian becomes the moments of the mixture of itself and its updates by some plots.

    An update moves the mean by d = K y and narrows the covariance by K (H P). With shares c of the total, and D = sum c d:
        x = x + D
        P = P + sum c (d d' - K H P) - D D'
    Args: pairs: (first, end); given: weight of each of these plots, from 0; total: these weights and that of "missed".
    """
    p = covariance
    b0, b1 = (p[0, 0], p[0, 1], p[0, 2], p[0, 3], p[0, 4]), (p[1, 0], p[1, 1], p[1, 2], p[1, 3], p[1, 4])  # H P
    x0, x1 = mean[0], mean[1]
    moved0, moved1 = 0.0, 0.0  # D = moved H P, because d = (H P)' S^-1 y
    e00, e01, e11 = 0.0, 0.0, 0.0  # sum c (S^-1 y y' S^-1 - S^-1)
    for a in range(pairs[0], pairs[1]):
        c = given[a - pairs[0]] / total
        noise = hypotheses.noise[a]
        ee, en, nn = b0[0] + noise[0, 0], b1[0] + noise[1, 0], b1[1] + noise[1, 1]
        inverse = 1.0 / (ee * nn - en * en)
        i00, i01, i11 = nn * inverse, -en * inverse, ee * inverse
        y0, y1 = hypotheses.position[a, 0] - x0, hypotheses.position[a, 1] - x1
        u0, u1 = i00 * y0 + i01 * y1, i01 * y0 + i11 * y1
        moved0 += c * u0
        moved1 += c * u1
        e00 += c * (u0 * u0 - i00)
        e01 += c * (u0 * u1 - i01)
        e11 += c * (u1 * u1 - i11)
    e00, e01, e11 = e00 - moved0 * moved0, e01 - moved0 * moved1, e11 - moved1 * moved1
    for k in range(SIZE):
        mean[k] += b0[k] * moved0 + b1[k] * moved1
        first, second = b0[k] * e00 + b1[k] * e01, b0[k] * e01 + b1[k] * e11
        for other in range(SIZE):
            p[k, other] += first * b0[other] + second * b1[other]
