"""Prune pairs that cannot score above the threshold, by bounds of each track alone: nine in ten of the pairs within the gate.

Scores of 100,000 tracks take 357 ms of processor time without bounds and 81 with them (scaling/decisions/association_cycle.py).
The bounds are exact: `pair_scores` would refuse every pruned pair.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.arrays import Floats
from coastwatch.kernels.association.pair_score import Rule
from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, metres_per_degree, wrap_degrees
from coastwatch.kernels.jit import jit

SEEN = 7  # newest entries that the bounds use; fewer give weak bounds, more cost time
REGULAR = 1e-9  # a determinant that is less than this part of its main product is rounding
LEAST_ERROR = 1e-4  # relative error of a distance within the gate, besides what converging meridians make of it
LONGEST_DEGREE = 1.0034 * SEMI_MAJOR * DEGREE  # more than any degree of longitude
LOG2, LOG_TURN = math.log(2.0), math.log(2.0 * math.pi)


BOUND = np.dtype(
    [
        ("length", np.int32),  # entries of its history
        ("latitude_deg", np.float64),  # newest entry
        ("longitude_deg", np.float64),
        ("east_m_s", np.float64),
        ("north_m_s", np.float64),
        ("variance_m2", np.float64),
        ("greatest_variance_m2", np.float64),  # over the newest SEEN entries
        ("latitude_rate", np.float64),  # mean over them, degrees a cycle
        ("longitude_rate", np.float64),
        ("bend_m", np.float64),  # greatest distance from the straight line of that rate
        ("change_m_s", np.float64),  # greatest difference from the newest velocity
        ("east_m_deg", np.float64),  # metres a degree here
        ("north_m_deg", np.float64),
        ("error", np.float64),  # relative, of a distance within the gate by these
        ("greatest_block", np.float64, (2, 2)),  # of position: cap times the covariance plus registration
        ("log_area", np.float64),  # of the least root of the determinant of the position block, -inf: not regular
        ("log_rate_area", np.float64),  # of that of velocity given position
    ]
)


@jit
def _bound_path(track, values, newest, out):  # type: ignore[no-untyped-def]
    """What a BOUND says of the newest entries. Args: track: one TRACK; values: (S, W) ENTRY; out: one BOUND, written."""
    window, n, now = values.shape[1], min(track.length, SEEN), values[track.slot, newest]
    out.length, out.latitude_deg, out.longitude_deg = track.length, now.latitude_deg, now.longitude_deg
    out.east_m_s, out.north_m_s, out.variance_m2 = now.east_m_s, now.north_m_s, now.variance_m2
    oldest = values[track.slot, newest - (n - 1) if newest >= n - 1 else newest - (n - 1) + window]
    cycles = max(n - 1, 1)
    out.latitude_rate = (now.latitude_deg - oldest.latitude_deg) / cycles
    out.longitude_rate = wrap_degrees(now.longitude_deg - oldest.longitude_deg) / cycles
    bend = change = 0.0
    greatest = out.variance_m2
    for age in range(1, n):
        then = values[track.slot, newest - age if newest >= age else newest - age + window]
        x = (wrap_degrees(then.longitude_deg - now.longitude_deg) + age * out.longitude_rate) * out.east_m_deg
        y = (then.latitude_deg - now.latitude_deg + age * out.latitude_rate) * out.north_m_deg
        u, v = then.east_m_s - out.east_m_s, then.north_m_s - out.north_m_s
        bend, change = max(bend, x * x + y * y), max(change, u * u + v * v)
        greatest = max(greatest, then.variance_m2)
    out.bend_m, out.change_m_s, out.greatest_variance_m2 = math.sqrt(bend), math.sqrt(change), greatest


@jit
def _given_position(p, i, j):  # type: ignore[no-untyped-def]
    """Element of the covariance of velocity given position (a Schur complement) times the determinant of the position block."""
    a, b, c, d = p[2 + i, 0], p[2 + i, 1], p[2 + j, 0], p[2 + j, 1]
    determinant = p[0, 0] * p[1, 1] - p[0, 1] * p[0, 1]
    return p[2 + i, 2 + j] * determinant - (p[1, 1] * a * c - p[0, 1] * (a * d + b * c) + p[0, 0] * b * d)


@jit
def _bound_covariance(track, rule, out):  # type: ignore[no-untyped-def]
    """What a BOUND says of the covariance. Args: track: one TRACK; out: one BOUND, written."""
    p, r = track.covariance, track.registration
    for i in range(2):
        for j in range(2):
            out.greatest_block[i, j] = rule.cap * p[i, j] + r[i, j]
    out.log_area = out.log_rate_area = -math.inf
    registration = r[0, 0] * r[1, 1] - r[0, 1] * r[0, 1]
    position = p[0, 0] * p[1, 1] - p[0, 1] * p[0, 1]
    if not (r[0, 0] >= 0.0 and r[1, 1] >= 0.0 and registration >= 0.0):
        return
    if not (p[0, 0] > 0.0 and position > REGULAR * p[0, 0] * p[1, 1]):
        return
    c00, c01 = _given_position(p, 0, 0) / position, _given_position(p, 0, 1) / position
    c11 = _given_position(p, 1, 1) / position
    rate = c00 * c11 - c01 * c01
    if c00 > REGULAR * p[2, 2] and rate > REGULAR * p[2, 2] * p[3, 3]:
        out.log_area = math.log(rule.floor * math.sqrt(position) + math.sqrt(registration))
        out.log_rate_area = math.log(rule.floor * math.sqrt(rate))


@jit
def track_bounds(low, high, track, values, newest, rule, out):  # type: ignore[no-untyped-def]
    """The bounds of tracks low to high. Args: track: (N,) TRACK; values: (S, W) ENTRY; newest: its column; out: (N,) BOUND, written."""
    for i in range(low, high):
        bound = out[i]
        bound.north_m_deg, bound.east_m_deg = metres_per_degree(values[track[i].slot, newest].latitude_deg)
        cosine = max(bound.east_m_deg / LONGEST_DEGREE, LEAST_ERROR)
        bound.error = LEAST_ERROR + rule.gate_m / SEMI_MAJOR * math.sqrt(1.0 - cosine * cosine) / cosine
        _bound_path(track[i], values, newest, bound)
        _bound_covariance(track[i], rule, bound)


def hopeless_steps(rule: Rule, window: int) -> Floats:
    """The bound of the newest steps below which a pair cannot exceed the threshold, by its number of common entries. (W + 1,)

    Let m be the forgetting factor, L the limit, and each of the newest k of n steps at most s. Then the sum is at most
    max(m^k U + s (1 + m + ... + m^(k - 1)), -L). U = L (1 + ... + m^(n - k - 1)) bounds the older steps. Proof: every step is monotone
    in the sum before it. For paths that touch -L the bound is linear in m^i, and therefore greatest at an end.
    """
    entries = np.arange(1, window + 1)
    newest = np.minimum(entries, SEEN)
    power = rule.forgetting ** np.arange(window + 1)
    total = np.concatenate([[0.0], np.cumsum(power)])
    least = rule.threshold - 1e-9 * (1.0 + rule.limit) * window  # what rounding may add to a score
    most = (least - power[newest] * rule.limit * total[entries - newest]) / total[newest]
    possible = (most >= -rule.limit) & (least >= -rule.limit)  # neither a step nor a sum is ever less
    return np.concatenate([[-np.inf], np.where(possible, most, -np.inf)])


@jit
def _log_sum(p, q):  # type: ignore[no-untyped-def]
    """A lower bound of log(exp(p) + exp(q)): the greater of max(p, q) and log 2 + (p + q) / 2."""
    return max(max(p, q), LOG2 + 0.5 * (p + q))


@jit
def _is_hopeless(a, b, log_density, least, null_variance):  # type: ignore[no-untyped-def]
    """Whether each of the newest steps of a pair is at most `least`. Args: a, b: one BOUND each; null_variance: and its logarithm.

    A step is at most position + max(velocity, 0) - q / 2, where
    - position = -log(2 pi density r), r the root of the determinant of the position block. The block is at least floor times the
      sum of the tracks' covariances, plus their registration terms. Such roots of positive 2 x 2 matrices are superadditive (Minkowski).
    - velocity = log(null variance / r') + (difference of the velocities)^2 / 2 / null variance. r' is the root of the determinant of
      the velocity block given the position. This Schur complement is superadditive too, and registration only adds to it.
    - q is the squared Mahalanobis length of the position difference d of that step. By Cauchy and Schwarz it is at least
      (u d)^2 / (u C u) / older for any direction u. C = cap times the covariances plus the registration terms is no smaller than the
      block; `older` bounds how much larger the variance was. With u = |C| C^-1 d for the newest d, u C u = |C| u d. Over the newest
      entries u d is linear in time, except for `bend_m` of both tracks.
    """
    if not (a.log_area > -math.inf and b.log_area > -math.inf):
        return False
    u, v = b.east_m_s - a.east_m_s, b.north_m_s - a.north_m_s
    change = math.sqrt(u * u + v * v) + a.change_m_s + b.change_m_s
    velocity = null_variance[1] - _log_sum(a.log_rate_area, b.log_rate_area) + 0.5 * change * change / null_variance[0]
    position = -LOG_TURN - log_density - _log_sum(a.log_area, b.log_area)
    need = 2.0 * (position + max(velocity, 0.0) - least)  # q must be at least this
    if need <= 0.0:
        return True
    cycles = min(a.length, b.length, SEEN) - 1
    x, y = wrap_degrees(b.longitude_deg - a.longitude_deg) * a.east_m_deg, (b.latitude_deg - a.latitude_deg) * a.north_m_deg
    old_x = x - cycles * (b.longitude_rate - a.longitude_rate) * a.east_m_deg
    old_y = y - cycles * (b.latitude_rate - a.latitude_rate) * a.north_m_deg
    ee, nn = a.greatest_block[0, 0] + b.greatest_block[0, 0], a.greatest_block[1, 1] + b.greatest_block[1, 1]
    en = a.greatest_block[0, 1] + b.greatest_block[0, 1]
    u, v = nn * x - en * y, ee * y - en * x
    along = u * x + v * y
    off = a.error * (abs(u) * max(abs(x), abs(old_x)) + abs(v) * max(abs(y), abs(old_y)))
    off += (1.0 + a.error) * math.sqrt(u * u + v * v) * (a.bend_m + b.bend_m)
    nearest = min(along, u * old_x + v * old_y) - off
    variance = a.variance_m2 + b.variance_m2
    greatest = max(a.greatest_variance_m2 + b.greatest_variance_m2, variance)
    return nearest > 0.0 and nearest * nearest * variance >= need * (ee * nn - en * en) * along * greatest


@jit
def possible_pairs(pair, bound, least, null_speed_m_s):  # type: ignore[no-untyped-def]
    """Which pairs may score above the threshold. Args: pair: (A,) PAIR; bound: (N,) BOUND; least: of `hopeless_steps`. Returns: (A,)."""
    out, log_density = np.empty(len(pair), np.bool_), 0.0
    variance = 2.0 * null_speed_m_s * null_speed_m_s
    null_variance = variance, math.log(variance)
    for p in range(len(pair)):
        if p == 0 or pair[p].first != pair[p - 1].first:
            log_density = math.log(pair[p].density)
        a, b = bound[pair[p].first], bound[pair[p].second]
        newest = least[min(a.length, b.length)]
        out[p] = newest == -math.inf or not _is_hopeless(a, b, log_density, newest, null_variance)
    return out
