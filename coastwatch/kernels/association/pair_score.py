"""The likelihood ratio of two tracks over their common history: scalar code, one pair after the other."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.geometry.ellipsoid import metres_per_degree, wrap_degrees
from coastwatch.kernels.jit import jit

MOST_EXPONENT = 600.0  # of the velocity's likelihood ratio: greater ones would overflow, and are added as logarithms


class Rule(NamedTuple):
    """The settings of a windowed covariance as its kernels read them."""

    gate_m: float
    prior: float  # entries of the window that the tracks' own covariance counts as
    floor: float  # of the scale
    cap: float
    forgetting: float  # factor by which the past counts one cycle later
    limit: float  # bound of one step, and, as -limit, of the sum
    misled: float  # share of tracks whose velocity says nothing
    null_speed_m_s: float  # standard deviation an axis of the velocity of unrelated vessels
    threshold: float  # that a score must exceed


@jit
def differences(values, slots, n, newest, delta, variance):  # type: ignore[no-untyped-def]
    """The newest n differences of two tracks, oldest first, with metres a degree taken halfway between their newest positions.

    Args:
        values: (S, W) ENTRY; slots: (2,) of the two tracks; newest: column of the newest entry.
        delta: (4, W) second less first: east, north (m), east rate, north rate (m/s); variance: (2, W) sums of both tracks' variances,
        of position and of velocity. Columns 0 to n - 1 are written.
    """
    first, second, window = values[slots[0]], values[slots[1]], values.shape[1]
    north_m_deg, east_m_deg = metres_per_degree(0.5 * (first[newest].latitude_deg + second[newest].latitude_deg))
    column = newest - (n - 1) if newest >= n - 1 else newest - (n - 1) + window
    for t in range(n):
        a, b = first[column], second[column]
        delta[0, t] = wrap_degrees(b.longitude_deg - a.longitude_deg) * east_m_deg
        delta[1, t] = (b.latitude_deg - a.latitude_deg) * north_m_deg
        delta[2, t] = np.float64(b.east_m_s) - np.float64(a.east_m_s)
        delta[3, t] = np.float64(b.north_m_s) - np.float64(a.north_m_s)
        variance[0, t] = np.float64(a.variance_m2) + np.float64(b.variance_m2)
        variance[1, t] = np.float64(a.rate_variance_m2_s2) + np.float64(b.rate_variance_m2_s2)
        column = column + 1 if column + 1 < window else 0


@jit
def factorise(m, low):  # type: ignore[no-untyped-def]
    """The lower Cholesky factor of a symmetric (4, 4) matrix. Returns: whether the matrix is positive definite."""
    low[0, 0] = math.sqrt(m[0, 0])
    low[1, 0], low[2, 0], low[3, 0] = m[1, 0] / low[0, 0], m[2, 0] / low[0, 0], m[3, 0] / low[0, 0]
    low[1, 1] = math.sqrt(m[1, 1] - low[1, 0] * low[1, 0])
    low[2, 1] = (m[2, 1] - low[2, 0] * low[1, 0]) / low[1, 1]
    low[3, 1] = (m[3, 1] - low[3, 0] * low[1, 0]) / low[1, 1]
    low[2, 2] = math.sqrt(m[2, 2] - low[2, 0] * low[2, 0] - low[2, 1] * low[2, 1])
    low[3, 2] = (m[3, 2] - low[3, 0] * low[2, 0] - low[3, 1] * low[2, 1]) / low[2, 2]
    low[3, 3] = math.sqrt(m[3, 3] - low[3, 0] * low[3, 0] - low[3, 1] * low[3, 1] - low[3, 2] * low[3, 2])
    return low[0, 0] > 0.0 and low[1, 1] > 0.0 and low[2, 2] > 0.0 and low[3, 3] > 0.0  # the root of less than 0 is NaN


@jit
def _block_scales(delta, n, phi, rule):  # type: ignore[no-untyped-def]
    """Scales of both blocks of the covariance: tr(block^-1 S) / 2, averaged with 1 by the prior, limited to floor and cap.

    S is the sample covariance of the differences, summed about the newest one and then shifted to the mean.
    Args: delta: (4, W), of which n count; phi: (4, 4). Returns: of position, of velocity.
    """
    if n <= 2:
        return 1.0, 1.0
    x0, y0, u0, v0 = delta[0, n - 1], delta[1, n - 1], delta[2, n - 1], delta[3, n - 1]
    sx = sy = su = sv = xx = xy = yy = uu = uv = vv = 0.0
    for t in range(n):
        x, y, u, v = delta[0, t] - x0, delta[1, t] - y0, delta[2, t] - u0, delta[3, t] - v0
        sx, sy, su, sv = sx + x, sy + y, su + u, sv + v
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
    xx, xy, yy = xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n
    uu, uv, vv = uu - su * su / n, uv - su * sv / n, vv - sv * sv / n
    position = (xx * phi[1, 1] - 2.0 * xy * phi[0, 1] + yy * phi[0, 0]) / (phi[0, 0] * phi[1, 1] - phi[0, 1] * phi[0, 1])
    velocity = (uu * phi[3, 3] - 2.0 * uv * phi[2, 3] + vv * phi[2, 2]) / (phi[2, 2] * phi[3, 3] - phi[2, 3] * phi[2, 3])
    entries = n - 1.0
    weight = entries / (entries + rule.prior)
    position, velocity = 1.0 + weight * (0.5 * position / entries - 1.0), 1.0 + weight * (0.5 * velocity / entries - 1.0)
    return min(max(position, rule.floor), rule.cap), min(max(velocity, rule.floor), rule.cap)


@jit
def _factor(a, b, delta, n, rule, phi, low):  # type: ignore[no-untyped-def]
    """Cholesky factor of the covariance of the difference: that of both tracks, scaled block by block, plus registration.

    Args: a, b: TRACK; delta: (4, W), of which n count; phi: (4, 4) scratch; low: (4, 4) written.
    Returns: whether the covariance is positive definite, with and without the scale.
    """
    for i in range(4):
        for j in range(4):
            phi[i, j] = a.covariance[i, j] + b.covariance[i, j]
    if not factorise(phi, low):
        return False
    position, velocity = _block_scales(delta, n, phi, rule)
    cross = math.sqrt(position * velocity)
    for i in range(2):
        for j in range(2):
            phi[i, j] = phi[i, j] * position + a.registration[i, j] + b.registration[i, j]
            phi[i + 2, j] *= cross
            phi[i + 2, j + 2] *= velocity
    return factorise(phi, low)


@jit
def _step_ratios(delta, variance, n, low, density, rule, out):  # type: ignore[no-untyped-def]
    """The log-likelihood ratio of each difference, one vessel against an unrelated one, within the limit.

    Args: delta: (4, W), variance: (2, W), of which n count; low: (4, 4) factor of the covariance now: where a variance was larger
    then, its block was larger by as much. density: of unrelated tracks, a square metre; out: (W,) written.
    """
    null_variance, limit, misled = 2.0 * rule.null_speed_m_s * rule.null_speed_m_s, rule.limit, rule.misled
    i0, i1, i2, i3 = 1.0 / low[0, 0], 1.0 / low[1, 1], 1.0 / low[2, 2], 1.0 / low[3, 3]
    l10, l20, l21, l30, l31, l32 = low[1, 0], low[2, 0], low[2, 1], low[3, 0], low[3, 1], low[3, 2]
    position_constant = math.log(i0 * i1 / (2.0 * math.pi * density))
    velocity_constant, half = math.log(null_variance * i2 * i3), 0.5 / null_variance
    variance_now, rate_variance_now = variance[0, n - 1], variance[1, n - 1]
    for t in range(n):
        share, rate_share = variance_now / variance[0, t], rate_variance_now / variance[1, t]
        share = share if (share > 0.0) & (share < 1.0) else 1.0
        rate_share = rate_share if (rate_share > 0.0) & (rate_share < 1.0) else 1.0
        u, v, root, rate_root = delta[2, t], delta[3, t], math.sqrt(share), math.sqrt(rate_share)
        a = root * delta[0, t] * i0
        b = (root * delta[1, t] - l10 * a) * i1
        c = (rate_root * u - l20 * a - l21 * b) * i2
        d = (rate_root * v - l30 * a - l31 * b - l32 * c) * i3
        velocity = velocity_constant + half * (u * u + v * v) - 0.5 * (c * c + d * d)
        most = min(velocity, MOST_EXPONENT)
        mixture = misled + (1.0 - misled) * math.exp(most) * rate_share
        ratio = position_constant - 0.5 * (a * a + b * b) + (velocity - most) + math.log(mixture * share)
        out[t] = min(max(ratio, -limit), limit)


@jit
def pair_scores(pair, track, values, newest, rule):  # type: ignore[no-untyped-def]
    """Discounted log-likelihood ratio of "one vessel" against "no partner" over the common history of each pair.

    The covariance of a difference is the sum of both tracks' covariances. Its position and velocity blocks are scaled by the sample
    covariance of the window. The scale is averaged with 1 by the prior, then limited to floor and cap. The registration term is
    added unscaled: it is constant, so the window does not show it. The likelihood is a mixture: with a small probability a track's
    velocity is wrong, and distributed as that of an unrelated vessel. The score is s(t) = max(forgetting s(t - 1) + ratio(t), -limit).

    Args:
        pair: (A,) PAIR, rows of `track`. track: (N,) TRACK; values: (S, W) ENTRY; newest: column of the newest entries; rule: Rule.
    Returns: (A,), -inf where the covariance is not positive definite.
    """
    window, score = values.shape[1], np.empty(len(pair))
    delta, variance, ratio = np.empty((4, window)), np.empty((2, window)), np.empty(window)
    phi, low = np.empty((4, 4)), np.empty((4, 4))
    for p in range(len(pair)):
        a, b = track[pair[p].first], track[pair[p].second]
        n = min(a.length, b.length)
        differences(values, (a.slot, b.slot), n, newest, delta, variance)
        score[p] = -math.inf
        if _factor(a, b, delta, n, rule, phi, low):
            _step_ratios(delta, variance, n, low, pair[p].density, rule, ratio)
            total = 0.0
            for t in range(n):
                total = max(rule.forgetting * total + ratio[t], -rule.limit)
            score[p] = total
    return score


@jit
def sample_statistics(first, second, slot, length, values, newest):  # type: ignore[no-untyped-def]
    """x = delta^T S^-1 delta of the newest difference, S the sample covariance of the W newest differences.

    Args: first, second: (A,) rows; slot: (N,) of each row; length: (S,), values: (S, W) ENTRY, newest: of the history.
    Returns: (A,) x, infinite where fewer than W differences are common or S is singular.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach, eq. 7.
    """
    window, out = values.shape[1], np.full(len(first), math.inf)
    delta, variance = np.empty((4, window)), np.empty((2, window))
    mean, white, sample, low = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty((4, 4))
    for p in range(len(first)):
        slots = slot[first[p]], slot[second[p]]
        if min(length[slots[0]], length[slots[1]]) < window:
            continue
        differences(values, slots, window, newest, delta, variance)
        for i in range(4):
            mean[i] = np.mean(delta[i])
        for i in range(4):
            for j in range(4):
                s = 0.0
                for t in range(window):
                    s += (delta[i, t] - mean[i]) * (delta[j, t] - mean[j])
                sample[i, j] = s / (window - 1)
        if not factorise(sample, low):
            continue
        x = 0.0
        for i in range(4):
            white[i] = delta[i, window - 1]
            for k in range(i):
                white[i] -= low[i, k] * white[k]
            white[i] /= low[i, i]
            x += white[i] * white[i]
        out[p] = x
    return out
