"""The likelihood ratio of windows of differences between pairs of tracks (`kernels.differences`), compiled by numba.

Pairs are worked on LANES at a time. What a pair gets is the same to the bit as alone.
"""

import math

import numpy as np

from coastwatch.kernels.compiling import arithmetic, arithmetic_part
from coastwatch.kernels.differences import (
    BIAS,
    COUNT,
    COURSE,
    COURSE_0,
    DENSITY,
    EAST,
    EAST_RATE,
    FACTOR,
    GOOD,
    LANES,
    NORTH,
    NORTH_RATE,
    OLDER_COURSE,
    OLDER_PLACE,
    PLACE,
    PLACE_0,
    RAW_COURSE,
    ROOM,
    SQUARE,
    SUM,
    differences,
    factorise,
    lanes,
    squares,
    steps,
    whole,
)
from coastwatch.kernels.elementary import exponential, logarithm
from coastwatch.kernels.rings import fetch, fetch_window

AHEAD = 2  # pairs whose windows are asked for while one is laid out
# rows whose differences are not wanted any more then
LOG_PLACE, LOG_COURSE, MIXTURE, LOG_MIXTURE = EAST, NORTH, EAST_RATE, NORTH_RATE


@arithmetic_part
def _laid_out(p, k, first, second, density, table, chain, length, record, room):  # type: ignore[no-untyped-def]
    """Pair p into lane k: its steps, their squares, the summed covariances and registration terms."""
    lane, a, b = lanes(room), first[p], second[p]
    n = min(length[a], length[b])
    lane[COUNT, k], lane[DENSITY, k], lane[GOOD, k] = n, density[p], 1.0
    for q in range(10):
        lane[SUM + q, k] = lane[FACTOR + q, k] = record[a, q] + record[b, q]
    for q in range(10, 13):
        lane[SUM + q + 10, k] = record[a, q] + record[b, q]
    differences(a, b, n, table, chain, k, room)
    squares(n, k, room)


@arithmetic_part
def _gain(n, xx, xy, yy, p00, p01, p11, rule):  # type: ignore[no-untyped-def]
    """Factor of a block: what the window shows of it, tr(Phi^-1 S) / 2, drawn to 1 as by so many more entries."""
    shown = (xx * p11 - 2.0 * xy * p01 + yy * p00) / (p00 * p11 - p01 * p01) / (2.0 * (n - 1.0))
    weight = (n - 1.0) / (n - 1.0 + rule.prior)
    gain = min(max(1.0 + weight * (shown - 1.0), rule.floor), rule.cap)
    return gain if n > 2.0 else 1.0


@arithmetic_part
def _scale(rule, room):  # type: ignore[no-untyped-def]
    """The sum, scaled block by block by what the window shows, plus the registration terms, into FACTOR."""
    lane, f, s = lanes(room), FACTOR, SQUARE
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
        pp, pv, vv = math.sqrt(gp * gp), math.sqrt(gv * gp), math.sqrt(gv * gv)
        for q, gain in ((0, pp), (1, pp), (2, pp), (3, pv), (4, pv), (5, vv), (6, pv), (7, pv), (8, vv), (9, vv)):
            lane[f + q, k] = lane[SUM + q, k] * gain
        for q in range(3):
            lane[f + q, k] += lane[BIAS + q, k]


@arithmetic_part
def _whiten(n, k, null_variance, room):  # type: ignore[no-untyped-def]
    """The exponents of every step of lane k into PLACE, RAW_COURSE and COURSE, and by how much variances were larger into OLDER_*."""
    w, lane, f = steps(room), lanes(room), FACTOR
    l00, l10, l11, l20, l21, l22 = lane[f, k], lane[f + 1, k], lane[f + 2, k], lane[f + 3, k], lane[f + 4, k], lane[f + 5, k]
    l30, l31, l32, l33, place, course = (
        lane[f + 6, k],
        lane[f + 7, k],
        lane[f + 8, k],
        lane[f + 9, k],
        lane[PLACE_0, k],
        lane[COURSE_0, k],
    )
    now_p, now_v = w[k, OLDER_PLACE, n - 1], w[k, OLDER_COURSE, n - 1]
    for t in range(whole(n)):
        older = max(w[k, OLDER_PLACE, t] / now_p, 1.0)
        shrunk = 1.0 / math.sqrt(older)
        a = shrunk * w[k, EAST, t] / l00
        b = (shrunk * w[k, NORTH, t] - l10 * a) / l11
        w[k, OLDER_PLACE, t] = older
        older = max(w[k, OLDER_COURSE, t] / now_v, 1.0)
        shrunk = 1.0 / math.sqrt(older)
        x, y = w[k, EAST_RATE, t], w[k, NORTH_RATE, t]
        c = (shrunk * x - l20 * a - l21 * b) / l22
        d = (shrunk * y - l30 * a - l31 * b - l32 * c) / l33
        w[k, OLDER_COURSE, t] = older
        w[k, PLACE, t] = place - 0.5 * (a * a + b * b)
        raw = course + 0.5 * (x * x + y * y) / null_variance
        w[k, RAW_COURSE, t] = raw
        w[k, COURSE, t] = raw - 0.5 * (c * c + d * d)


@arithmetic_part
def _bound(n, k, rule, room):  # type: ignore[no-untyped-def]
    """A bound of what `_accumulate` gives: log(m + (1 - m) exp(c)) is at most the greater of c and 0, and age only takes away."""
    w, total = steps(room), 0.0
    for t in range(n):
        step = min(max(w[k, PLACE, t] + max(w[k, COURSE, t], 0.0), -rule.limit), rule.limit)
        total = max(rule.memory * total + step, -rule.limit)
    return total


@arithmetic_part
def _logarithms(n, k, of, to, room):  # type: ignore[no-untyped-def]
    """The logarithms of a row of lane k into another."""
    w = steps(room)
    for t in range(whole(n)):
        w[k, to, t] = logarithm(w[k, of, t])


@arithmetic_part
def _mix(n, k, rule, room):  # type: ignore[no-untyped-def]
    """The likelihood ratio of velocities that may say nothing, from COURSE into MIXTURE of lane k."""
    w = steps(room)
    for t in range(whole(n)):
        w[k, COURSE, t] -= w[k, LOG_COURSE, t]
        w[k, MIXTURE, t] = rule.misled + (1.0 - rule.misled) * exponential(w[k, COURSE, t])


@arithmetic_part
def _accumulate(n, k, rule, room):  # type: ignore[no-untyped-def]
    """The sum of the log-likelihood ratios of the steps of lane k, each bounded by the limit and counting less a cycle later."""
    w, total, certain = steps(room), 0.0, math.log1p(-rule.misled)
    _logarithms(n, k, OLDER_PLACE, LOG_PLACE, room)
    _logarithms(n, k, OLDER_COURSE, LOG_COURSE, room)
    _mix(n, k, rule, room)
    _logarithms(n, k, MIXTURE, LOG_MIXTURE, room)
    for t in range(whole(n)):
        place, course = w[k, PLACE, t] - w[k, LOG_PLACE, t], w[k, COURSE, t]
        sure, open_ = place + course + certain, place + w[k, LOG_MIXTURE, t]
        step = min(max(sure if course > 30.0 else open_, -rule.limit), rule.limit)
        least = w[k, PLACE, t] + max(w[k, RAW_COURSE, t], 0.0) <= -rule.limit  # logarithms only make it less
        w[k, PLACE, t] = -rule.limit if least else step
    for t in range(n):
        total = max(rule.memory * total + w[k, PLACE, t], -rule.limit)
    return total


@arithmetic
def windowed_scores(first, second, density, table, chain, length, record, rule, slack):  # type: ignore[no-untyped-def]
    """Discounted log-likelihood ratio of "one vessel" against "no partner" over the common window of each pair.

    The covariance of a step is that of both tracks, scaled in its position and its velocity block by what the window shows about it
    (drawn to 1 by the prior, floored and capped), plus the registration term, which is constant and cannot show; each block of all that
    by how much larger the summed variance was then than it is now. The likelihood is a mixture: where a track is misled its velocity
    is as that of an unrelated vessel. A pair that cannot pass the threshold is given up before a logarithm is taken (`_bound`); `slack`
    covers the roundings of what is not computed.

    Args:
        first, second: (A,) tracks. density: (A,) unrelated tracks a square metre.
        table, chain, length: the windows, none longer than LONGEST; record: (N, facts.COLUMNS) of the tracks; rule: `screening.Rule`.
    Returns: (A,), -inf where the covariance is not positive definite or the score would not exceed the threshold for certain.
    """
    score, null_variance = np.full(len(first), -math.inf), 2.0 * rule.null_speed * rule.null_speed
    buffer = np.ones(ROOM)
    room = buffer.ctypes.data
    lane = lanes(room)
    for pair in range(0, len(first), LANES):
        for k in range(LANES):
            ahead = min(pair + k + AHEAD, len(first) - 1)
            for track in (first[ahead], second[ahead]):
                fetch_window(table, chain, length[track], track)
                fetch(record.ctypes.data + 128 * track)  # type: ignore[call-arg]
                fetch(record.ctypes.data + 128 * track + 64)
            _laid_out(min(pair + k, len(first) - 1), k, first, second, density, table, chain, length, record, room)
        factorise(room)
        _scale(rule, room)
        factorise(room)
        for k in range(min(LANES, len(first) - pair)):
            if lane[GOOD, k] == 0.0:
                continue
            lane[PLACE_0, k] = -math.log(2.0 * math.pi * lane[FACTOR, k] * lane[FACTOR + 2, k] * lane[DENSITY, k])
            lane[COURSE_0, k] = math.log(null_variance / (lane[FACTOR + 5, k] * lane[FACTOR + 9, k]))
            n = int(lane[COUNT, k])
            _whiten(n, k, null_variance, room)
            if not _bound(n, k, rule, room) + slack <= rule.threshold:
                score[pair + k] = _accumulate(n, k, rule, room)
    buffer[0] = 0.0  # or it would be given back as soon as its address is known
    return score
