"""The likelihood ratio of windows of differences between pairs of tracks (`kernels.differences`), compiled by numba.

Pairs are worked on LANES at a time. What a pair gets is the same to the bit as alone.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from coastwatch.kernels.association.history import fetch, fetch_window
from coastwatch.kernels.association.pair_differences import (
    ABSENT,
    BIAS,
    COUNT,
    COURSE,
    DENSITY,
    EAST,
    EAST_RATE,
    FACTOR,
    GOOD,
    LANE_ROWS,
    LANES,
    LONGEST,
    NEWEST_RATE_VARIANCE,
    NEWEST_VARIANCE,
    NORTH,
    NORTH_RATE,
    PLACE,
    RATE_SHARE,
    RATE_VARIANCE,
    SHARE,
    SQUARE,
    STEP_COURSE,
    STEP_PLACE,
    STEP_ROWS,
    SUM,
    TOTAL,
    VARIANCE,
    differences,
    factorise,
    in_metres,
    squares,
)
from coastwatch.kernels.jit import jit
from coastwatch.kernels.vectorised_math import exponential, logarithm

if TYPE_CHECKING:
    from coastwatch.kernels.association.prune_pairs import Rule

AHEAD = 4  # pairs whose windows are asked for while one is laid out
MOST_EXPONENT = 600.0  # of a likelihood ratio that is written out; what is beyond counts in full as a logarithm


@jit
def _laid_out(pair, first, second, density, table, chain, length, record, lane, step):  # type: ignore[no-untyped-def]
    """The pairs from `pair` on into the lanes, of which those behind the last pair repeat it. Returns: entries of the longest window."""
    last, most = len(first) - 1, 0
    for k in range(LANES):
        p = min(pair + k, last)
        most = max(most, min(length[first[p]], length[second[p]]))
    for k in range(LANES):
        p, ahead = min(pair + k, last), min(pair + k + AHEAD, last)
        for track in (first[ahead], second[ahead]):
            fetch_window(table, chain, length[track], track)
            fetch(record.ctypes.data + 128 * track)  # type: ignore[call-arg]
            fetch(record.ctypes.data + 128 * track + 64)
        a, b = first[p], second[p]
        lane[DENSITY, k], lane[GOOD, k] = density[p], 1.0
        for q in range(10):
            lane[SUM + q, k] = lane[FACTOR + q, k] = record[a, q] + record[b, q]
        for q in range(10, 13):
            lane[SUM + q + 10, k] = record[a, q] + record[b, q]
        differences(a, b, min(length[a], length[b]), most, table, chain, k, lane, step)
    return most


@jit
def _gain(n, xx, xy, yy, p00, p01, p11, rule):  # type: ignore[no-untyped-def]
    """Factor of a block: what the window shows of it, tr(Phi^-1 S) / 2, drawn to 1 as by so many more entries."""
    shown = (xx * p11 - 2.0 * xy * p01 + yy * p00) / (p00 * p11 - p01 * p01) / (2.0 * (n - 1.0))
    weight = (n - 1.0) / (n - 1.0 + rule.prior)
    gain = min(max(1.0 + weight * (shown - 1.0), rule.floor), rule.cap)
    return gain if n > 2.0 else 1.0


@jit
def _grown(rule, lane):  # type: ignore[no-untyped-def]
    """The sum, scaled block by block by what the window shows, plus the registration terms, into FACTOR."""
    f, s = FACTOR, SQUARE
    for k in range(LANES):
        l00, l10, l11, l20, l21, l22 = (
            lane[f, k],
            lane[f + 1, k],
            lane[f + 2, k],
            lane[f + 3, k],
            lane[f + 4, k],
            lane[f + 5, k],
        )
        l30, l31, l32, l33 = lane[f + 6, k], lane[f + 7, k], lane[f + 8, k], lane[f + 9, k]
        n, p00, p01, p11 = lane[COUNT, k], l00 * l00, l00 * l10, l10 * l10 + l11 * l11
        gp = _gain(n, lane[s, k], lane[s + 1, k], lane[s + 2, k], p00, p01, p11, rule)
        p00, p01 = l20 * l20 + l21 * l21 + l22 * l22, l20 * l30 + l21 * l31 + l22 * l32
        p11 = l30 * l30 + l31 * l31 + l32 * l32 + l33 * l33
        gv = _gain(n, lane[s + 3, k], lane[s + 4, k], lane[s + 5, k], p00, p01, p11, rule)
        pv = math.sqrt(gv * gp)
        for q in range(10):
            gain = gp if q < 3 else gv if q in (5, 8, 9) else pv
            lane[f + q, k] = lane[SUM + q, k] * gain + (lane[BIAS + q, k] if q < 3 else 0.0)


@jit
def _begun(null_variance, lane):  # type: ignore[no-untyped-def]
    """Logarithms of what a step has in common with all others, and reciprocals of the diagonal of the factor."""
    f = FACTOR
    for k in range(LANES):
        lane[PLACE, k] = -logarithm(2.0 * math.pi * lane[f, k] * lane[f + 2, k] * lane[DENSITY, k])
        lane[COURSE, k] = logarithm(null_variance / (lane[f + 5, k] * lane[f + 9, k]))
        lane[TOTAL, k] = 0.0
        lane[f, k], lane[f + 2, k] = 1.0 / lane[f, k], 1.0 / lane[f + 2, k]
        lane[f + 5, k], lane[f + 9, k] = 1.0 / lane[f + 5, k], 1.0 / lane[f + 9, k]


@jit
def _whitened(t, null_variance, lane, step):  # type: ignore[no-untyped-def]
    """The exponents of step t, of position and of velocity given it; of a variance that was larger, the inverse of how many times."""
    f, at, half = FACTOR, t * STEP_ROWS, 0.5 / null_variance
    for k in range(LANES):
        share, rate_share = (
            lane[NEWEST_VARIANCE, k] / step[at + VARIANCE, k],
            lane[NEWEST_RATE_VARIANCE, k] / step[at + RATE_VARIANCE, k],
        )
        share = share if (share > 0.0) & (share < 1.0) else 1.0
        rate_share = rate_share if (rate_share > 0.0) & (rate_share < 1.0) else 1.0
        shrunk, x, y = math.sqrt(share), step[at + EAST_RATE, k], step[at + NORTH_RATE, k]
        a = shrunk * step[at + EAST, k] * lane[f, k]
        b = (shrunk * step[at + NORTH, k] - lane[f + 1, k] * a) * lane[f + 2, k]
        shrunk = math.sqrt(rate_share)
        c = (shrunk * x - lane[f + 3, k] * a - lane[f + 4, k] * b) * lane[f + 5, k]
        d = (shrunk * y - lane[f + 6, k] * a - lane[f + 7, k] * b - lane[f + 8, k] * c) * lane[f + 9, k]
        lane[STEP_PLACE, k] = lane[PLACE, k] - 0.5 * (a * a + b * b)
        lane[STEP_COURSE, k] = lane[COURSE, k] + half * (x * x + y * y) - 0.5 * (c * c + d * d)
        lane[SHARE, k], lane[RATE_SHARE, k] = share, rate_share


@jit
def _accumulated(t, rule, lane):  # type: ignore[no-untyped-def]
    """Step t: its log-likelihood ratio, bounded by the limit, on what was, which counts less a cycle later.

    The logarithm is of one product: the mixture of a velocity that is of the vessel and one that says nothing, and the areas.
    """
    limit, rest = rule.limit, 1.0 - rule.misled
    for k in range(LANES):
        most = min(lane[STEP_COURSE, k], MOST_EXPONENT)
        mixture = rule.misled + rest * exponential(most) * lane[RATE_SHARE, k]
        ratio = lane[STEP_PLACE, k] + (lane[STEP_COURSE, k] - most) + logarithm(mixture * lane[SHARE, k])
        total = max(rule.memory * lane[TOTAL, k] + min(max(ratio, -limit), limit), -limit)
        lane[TOTAL, k] = total if t >= lane[ABSENT, k] else 0.0


@jit
def windowed_scores(first, second, density, table, chain, length, record, rule: Rule):  # type: ignore[no-untyped-def]
    """Discounted log-likelihood ratio of "one vessel" against "no partner" over the common window of each pair.

    The covariance of a step is that of both tracks, scaled in its position and its velocity block by what the window shows about it
    (drawn to 1 by the prior, floored and capped), plus the registration term, which is constant and cannot show; each block of all that
    by how much larger the summed variance was then than it is now. The likelihood is a mixture: where a track is misled its velocity
    is as that of an unrelated vessel.

    Args:
        first, second: (A,) tracks. density: (A,) unrelated tracks a square metre.
        table, chain, length: the windows, none longer than LONGEST; record: (N, facts.COLUMNS) of the tracks; rule: `screening.Rule`.
    Returns: (A,), -inf where the covariance is not positive definite.
    """
    score, null_variance = np.empty(len(first)), 2.0 * rule.null_speed * rule.null_speed
    lane, step = np.empty((LANE_ROWS, LANES)), np.empty((LONGEST * STEP_ROWS, LANES))
    for pair in range(0, len(first), LANES):
        count = min(LANES, len(first) - pair)
        most = _laid_out(pair, first, second, density, table, chain, length, record, lane, step)
        in_metres(most, lane, step)
        squares(most, lane, step)
        factorise(lane)
        _grown(rule, lane)
        factorise(lane)
        _begun(null_variance, lane)
        for t in range(most):
            _whitened(t, null_variance, lane, step)
            _accumulated(t, rule, lane)
        for k in range(count):
            score[pair + k] = lane[TOTAL, k] if lane[GOOD, k] > 0.0 else -math.inf
    return score
