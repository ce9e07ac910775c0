"""Smoothing: states of the past corrected by the measurements after them. Scalar code, compiled by numba.

A filter leaves a step for each measurement: its estimate after it, and its prediction before it. Going back over these steps gives the
estimates by all measurements (Rauch, Tung and Striebel). The predictions are those of the filter, so they may be moments of several
models; between two steps position and velocity are correlated as under constant velocity.
Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 8.6.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

STATE = 4  # east, north, east rate, north rate


class Steps(NamedTuple):
    """P steps of filters, in any order."""

    time: Floats  # (P,)
    mean: Floats  # (P, 4) after the measurement
    covariance: Floats  # (P, 4, 4)
    predicted_mean: Floats  # (P, 4) before it, at the same time
    predicted_covariance: Floats  # (P, 4, 4)


@jit
def fixed_lag(steps, path):  # type: ignore[no-untyped-def]
    """The first state of each path, smoothed by the steps after it: mean (T, 4) and covariance (T, 4, 4).

    Where a later prediction has no inverse, the state is that of the filter.
    Args: steps: Steps; path: (T, W) rows of steps, oldest first, -1: none in this place; the first is a row.
    """
    mean, covariance = np.empty((len(path), STATE)), np.empty((len(path), STATE, STATE))
    gain, change = np.empty((STATE, STATE)), np.empty((STATE, STATE))
    for t in range(len(path)):
        later = -1
        for place in range(path.shape[1] - 1, -1, -1):
            now = path[t, place]
            if now < 0:
                continue
            if later >= 0:
                _step_back(steps, now, later, mean[t], covariance[t], gain, change)
            if later < 0 or not np.isfinite(mean[t].sum()):
                copy_into(mean[t], steps.mean[now])
                copy_into(covariance[t], steps.covariance[now])
            later = now
    return mean, covariance


@jit
def _step_back(steps, now, later, mean, covariance, gain, change):  # type: ignore[no-untyped-def]
    """A smoothed state becomes that of the step before, in place.

    With the gain G = P F' Ppred^-1 of the later prediction: x = x + G (xs - xpred), P = P + G (Ps - Ppred) G'.
    A covariance that would not be one, as the models of the filter turned, stays that of the filter.
    """
    p, dt = steps.covariance[now], steps.time[later] - steps.time[now]
    for a in range(STATE):  # P F'
        for b in range(2):
            gain[a, b] = p[a, b] + dt * p[a, b + 2]
            gain[a, b + 2] = p[a, b + 2]
    _divide(gain, steps.predicted_covariance[later])
    before, predicted = steps.mean[now], steps.predicted_mean[later]
    difference = mean - predicted
    for a in range(STATE):
        mean[a] = before[a]
        for b in range(STATE):
            mean[a] += gain[a, b] * difference[b]
    covariance -= steps.predicted_covariance[later]
    for a in range(STATE):
        for b in range(STATE):
            change[a, b] = 0.0
            for c in range(STATE):
                change[a, b] += gain[a, c] * covariance[c, b]
    for a in range(STATE):
        for b in range(a + 1):
            total = p[a, b]
            for c in range(STATE):
                total += change[a, c] * gain[b, c]
            covariance[a, b] = covariance[b, a] = total
    if not _is_positive(covariance, change):
        copy_into(covariance, p)


@jit
def _divide(numerator, divisor):  # type: ignore[no-untyped-def]
    """N D^-1 of a positive definite D, in place of N: by Cholesky, D = L L'. (4, 4) each"""
    root = np.zeros((STATE, STATE))
    for a in range(STATE):
        for b in range(a + 1):
            s = divisor[a, b]
            for c in range(b):
                s -= root[a, c] * root[b, c]
            root[a, b] = np.sqrt(s) if a == b else s / root[b, b]
    for row in range(STATE):
        n = numerator[row]
        for a in range(STATE):
            for c in range(a):
                n[a] -= root[a, c] * n[c]
            n[a] /= root[a, a]
        for a in range(STATE - 1, -1, -1):
            for c in range(a + 1, STATE):
                n[a] -= root[c, a] * n[c]
            n[a] /= root[a, a]


@jit
def _is_positive(covariance, root):  # type: ignore[no-untyped-def]
    """Whether a symmetric matrix is positive definite. Args: root: (4, 4) to work in."""
    for a in range(STATE):
        for b in range(a + 1):
            s = covariance[a, b]
            for c in range(b):
                s -= root[a, c] * root[b, c]
            if a == b:
                if not s > 0.0:
                    return False
                root[a, b] = np.sqrt(s)
            else:
                root[a, b] = s / root[b, b]
    return True
