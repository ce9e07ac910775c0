"""Tracks with unscented filters that weigh several plots of a radar: gates, likelihoods and the update. Scalar code, compiled by numba.

Sources: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, equations (7) and (8), with the covariance of
Y. Bar-Shalom, F. Daum, J. Huang, The probabilistic data association filter, 2009, which the paper leaves out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.filters.unscented import COURSE, MODELS, SIZE, SPEED, measured, predict_mixed, turn_round, wrapped
from coastwatch.kernels.jit import jit

TWO_PI = 2.0 * math.pi
NEAR, SIGMAS = 200.0, 4.0  # a plot nearer than this, and so many deviations of the track, is compared with it
LEAST_MODE = 1e-6  # of the probability of a model
LEAST_SHARE = 1e-6  # a plot with less changes no filter


class PolarPlots(NamedTuple):
    """Plots of one radar as they were measured from its site."""

    time: Floats  # (M,)
    position: Floats  # (M, 2)
    polar: Floats  # (M, 2) range, bearing clockwise from north
    variance: Floats  # (M, 2) of both


class PolarPairs(NamedTuple):
    """Pairs of a track and a plot in its gate, sorted by track, then plot."""

    track: Ints  # (A,)
    plot: Ints  # (A,)
    likelihood: Floats  # (A, 2) of the plot by each model, in 1 / (m rad)


@jit
def squared(polar, variance, predicted, spread):  # type: ignore[no-untyped-def]
    """Innovation, its squared distance, and the inverse of its covariance with the determinant: seven numbers."""
    rr, ra, aa = spread[0, 0] + variance[0], spread[0, 1], spread[1, 1] + variance[1]
    determinant = rr * aa - ra * ra
    i00, i01, i11 = aa / determinant, -ra / determinant, rr / determinant
    a, b = polar[0] - predicted[0], wrapped(polar[1] - predicted[1])
    return a, b, i00 * a * a + 2.0 * i01 * a * b + i11 * b * b, i00, i01, i11, determinant


@jit
def predict_to_plots(tracks, plots, hit, half, site, gate, rules):  # type: ignore[no-untyped-def]
    """Predict each track to the time of the plot nearest to it, in place, and find the plots in its gate by any of its models: PolarPairs.

    Args: tracks: time, state, covariance, mode, of N; plots: PolarPlots; hit: (N,) newest plot of this radar in each track; half: of a
    turn: a track that took a plot since is not due; site: (2,); gate: squared distance; rules: MotionRules.
    """
    time, state, covariance, mode = tracks
    room, count = 64, 0
    track, plot, likelihood = np.empty(room, np.int64), np.empty(room, np.int64), np.empty((room, MODELS))
    near = np.empty(len(plots.time), np.int64)
    predicted, spread, cross = np.empty((MODELS, 2)), np.empty((MODELS, 2, 2)), np.empty((SIZE, 2))
    for n in range(len(time)):
        best = 0 if mode[n, 0] >= mode[n, 1] else 1
        x, p = state[n, best], covariance[n, best]
        reach = NEAR + SIGMAS * math.sqrt(max(p[0, 0], p[1, 1]))
        ve, vn = x[SPEED] * math.sin(x[COURSE]), x[SPEED] * math.cos(x[COURSE])
        found, nearest, least = 0, -1, np.inf
        for m in range(len(plots.time)):
            dt = plots.time[m] - time[n]
            off = math.hypot(plots.position[m, 0] - x[0] - dt * ve, plots.position[m, 1] - x[1] - dt * vn)
            if off < reach and plots.time[m] - hit[n] > half:
                near[found] = m
                found += 1
                if off < least:
                    nearest, least = m, off
        if found == 0:
            continue
        predict_mixed(state[n], covariance[n], mode[n], plots.time[nearest] - time[n], rules)
        time[n] = max(time[n], plots.time[nearest])
        for model in range(MODELS):
            size = 4 + model
            measured(size, state[n, model], covariance[n, model], site, predicted[model], spread[model], cross)
        if count + found > room:
            room = 2 * (count + found)
            track, plot = (
                np.append(track, np.empty(room - len(track), np.int64)),
                np.append(plot, np.empty(room - len(plot), np.int64)),
            )
            likelihood = np.concatenate((likelihood, np.empty((room - len(likelihood), MODELS))))
        for k in range(found):
            m, inside = near[k], False
            for model in range(MODELS):
                _, _, square, _, _, _, determinant = squared(plots.polar[m], plots.variance[m], predicted[model], spread[model])
                inside |= square < gate
                likelihood[count, model] = math.exp(-0.5 * square) / (TWO_PI * math.sqrt(determinant))
            if inside:
                track[count], plot[count] = n, m
                count += 1
    return PolarPairs(track[:count], plot[:count], likelihood[:count])


@jit
def update_by_shares(tracks, plots, pairs, share, site):  # type: ignore[no-untyped-def]
    """Update each track by all plots in its gate, in place; what is left of the shares is "missed".

    Args: tracks, plots, site: as of `predict_to_plots`, which predicted them; share: (A,) probability that a plot is of its track.
    """
    state, covariance, mode = tracks[1], tracks[2], tracks[3]
    predicted, spread, cross = np.empty(2), np.empty((2, 2)), np.empty((SIZE, 2))
    first = 0
    while first < len(pairs.track):
        n, end = pairs.track[first], first
        while end < len(pairs.track) and pairs.track[end] == n:
            end += 1
        missed, before = 1.0, mode[n].copy()
        given = np.empty((end - first, MODELS))
        for a in range(first, end):
            missed -= share[a]
            total = max(before[0] * pairs.likelihood[a, 0] + before[1] * pairs.likelihood[a, 1], 1e-300)
            for model in range(MODELS):
                given[a - first, model] = share[a] * before[model] * pairs.likelihood[a, model] / total
        missed, floored = max(missed, 0.0), 0.0
        for model in range(MODELS):
            size, after = 4 + model, missed * before[model] + given[:, model].sum()
            mode[n, model] = max(after, LEAST_MODE)
            floored += mode[n, model]
            x, p = state[n, model], covariance[n, model]
            measured(size, x, p, site, predicted, spread, cross)
            moved, added = np.zeros(size), np.zeros((size, size))
            for a in range(first, end):
                m, weight = pairs.plot[a], given[a - first, model] / max(after, 1e-300)
                if weight <= LEAST_SHARE:
                    continue
                u, v, _, i00, i01, i11, _ = squared(plots.polar[m], plots.variance[m], predicted, spread)
                f, g = i00 * u + i01 * v, i01 * u + i11 * v  # S^-1 nu
                for i in range(size):
                    step = cross[i, 0] * f + cross[i, 1] * g  # K nu
                    moved[i] += weight * step
                    k0, k1 = cross[i, 0] * i00 + cross[i, 1] * i01, cross[i, 0] * i01 + cross[i, 1] * i11  # K
                    for j in range(size):
                        other = cross[j, 0] * f + cross[j, 1] * g
                        added[i, j] += weight * (step * other - k0 * cross[j, 0] - k1 * cross[j, 1])  # K S K' = K C'
            for i in range(size):
                x[i] += moved[i]
                for j in range(size):
                    p[i, j] += 0.5 * (added[i, j] + added[j, i]) - moved[i] * moved[j]
            turn_round(x, p, size)
        mode[n] /= floored
        first = end
