"""What must be known of a track to say at once that most of its neighbours cannot be the same vessel.

The outline of a track holds its newest entry and bounds: how straight it ran and how steady its velocity was for the newest `SEEN` cycles,
how large its covariance can become, and how small the determinants of its blocks. `screened` puts two outlines together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.association.history import entry, fetch_window
from coastwatch.kernels.association.pair_differences import turned
from coastwatch.kernels.association.pair_features import BIAS, EAST, NORTH, ROUGH
from coastwatch.kernels.jit import jit
from coastwatch.kernels.vectorised_math import logarithm

SEEN = 7  # newest entries that the bounds are of; fewer make them weak, more make them dear
AHEAD = 6  # tracks whose entries are asked for while one is worked on
LATITUDE, LONGITUDE, EAST_RATE, NORTH_RATE, VARIANCE, WORST, SIZE_EE, SIZE_EN, SIZE_NN = range(9)
DRIFT_NORTH, DRIFT_EAST, BEND, CHANGE, AREA, RATE_AREA = range(9, 15)
COLUMNS = 16  # of an outline
REGULAR = 1e-9  # a determinant that is less than this part of its main product is rounding
LOG2 = math.log(2.0)

Floats = NDArray[np.float64]


class Rule(NamedTuple):
    """The settings of a windowed covariance as its kernels read them."""

    gate: float
    prior: float  # entries of the window that the tracks' own covariance counts as
    floor: float  # of the scale
    cap: float
    memory: float  # factor by which what was known counts one cycle later
    limit: float  # bound of one step, and, as -limit, of the sum
    misled: float  # share of tracks whose velocity says nothing
    null_speed: float  # standard deviation a axis of the velocity of unrelated vessels
    threshold: float  # that a score must exceed


@jit
def _path(table, chain, n, track, record, out):  # type: ignore[no-untyped-def]
    """The newest of n entries, drift a cycle (degrees), bend (m), change (m/s) and worst variance over them into the outline of a track."""
    now = entry(table, 0, track)
    latitude, longitude, east_rate, north_rate, worst = now[0], now[1], now[2], now[3], now[4]
    out[track, LATITUDE], out[track, LONGITUDE], out[track, EAST_RATE], out[track, NORTH_RATE], out[track, VARIANCE] = (
        latitude,
        longitude,
        east_rate,
        north_rate,
        worst,
    )
    drift_north = drift_east = bend = change = 0.0
    if n > 1:
        oldest = entry(table, n - 1, chain[track, n - 2])
        drift_north, drift_east = (latitude - oldest[0]) / (n - 1), turned(longitude - oldest[1]) / (n - 1)
        for age in range(1, n):
            then = entry(table, age, chain[track, age - 1])
            x = (turned(then[1] - longitude) + age * drift_east) * record[track, EAST]
            y = (then[0] - latitude + age * drift_north) * record[track, NORTH]
            bend = max(bend, x * x + y * y)
            x, y = then[2] - east_rate, then[3] - north_rate
            change = max(change, x * x + y * y)
            worst = max(worst, then[4])
    out[track, DRIFT_NORTH], out[track, DRIFT_EAST], out[track, BEND], out[track, CHANGE], out[track, WORST] = (
        drift_north,
        drift_east,
        math.sqrt(bend),
        math.sqrt(change),
        worst,
    )


@jit
def _size(track, record, rule, out):  # type: ignore[no-untyped-def]
    """The greatest position block, and logarithms of the least root of its determinant and of that of the velocity block given it.

    They are -inf where nothing can be said, because a matrix is near to having a negative direction.
    """
    c0, c1, c2, x0, y0 = record[track, 0], record[track, 1], record[track, 2], record[track, 3], record[track, 4]
    c5, x1, y1, c8, c9 = record[track, 5], record[track, 6], record[track, 7], record[track, 8], record[track, 9]
    r0, r1, r2 = record[track, BIAS], record[track, BIAS + 1], record[track, BIAS + 2]
    out[track, SIZE_EE], out[track, SIZE_EN], out[track, SIZE_NN] = rule.cap * c0 + r0, rule.cap * c1 + r1, rule.cap * c2 + r2
    out[track, AREA] = out[track, RATE_AREA] = -math.inf
    bias, place = r0 * r2 - r1 * r1, c0 * c2 - c1 * c1
    if not (r0 >= 0.0 and r2 >= 0.0 and bias >= 0.0 and c0 > 0.0 and place > REGULAR * c0 * c2):
        return
    s00 = c5 - (c2 * x0 * x0 - 2.0 * c1 * x0 * y0 + c0 * y0 * y0) / place
    s11 = c9 - (c2 * x1 * x1 - 2.0 * c1 * x1 * y1 + c0 * y1 * y1) / place
    s01 = c8 - (c2 * x0 * x1 - c1 * (x0 * y1 + y0 * x1) + c0 * y0 * y1) / place
    rate = s00 * s11 - s01 * s01
    if s00 > REGULAR * c5 and rate > REGULAR * c5 * c9:
        out[track, AREA], out[track, RATE_AREA] = (
            logarithm(rule.floor * math.sqrt(place) + math.sqrt(bias)),
            logarithm(rule.floor * math.sqrt(rate)),
        )


@jit
def outlines(low, high, table, chain, length, record, rule, out):  # type: ignore[no-untyped-def]
    """The outlines of tracks low to high. Args: record: of `facts`; out: (N, COLUMNS)."""
    for track in range(low, high):
        ahead = min(track + AHEAD, len(length) - 1)
        fetch_window(table, chain, min(length[ahead], SEEN), ahead)
        _path(table, chain, min(length[track], SEEN), track, record, out)
        _size(track, record, rule, out)


def slack(rule: Rule, window: int) -> float:
    """What rounding may add to a bound of a score."""
    return 1e-9 * (1.0 + rule.limit) * window


def cuts(rule: Rule, window: int) -> Floats:
    """How great the newest steps may be at most for a pair to be hopeless, by its number of common entries. Returns: (W + 1,).

    With m the forgetting factor and L the limit, the sum after n steps of which the newest k are each at most s is at most
    max(m^k U + s (1 + m + ... + m^(k - 1)), -L), where U = L (1 + ... + m^(n - k - 1)) bounds what was before: every step is monotone in
    the sum before it, and of the paths that touch -L on the way the bound is linear in m^i and therefore greatest at an end.
    """
    entries = np.arange(1, window + 1)
    newest = np.minimum(entries, SEEN)
    power = rule.memory ** np.arange(window + 1)
    total = np.concatenate([[0.0], np.cumsum(power)])
    least = rule.threshold - slack(rule, window)
    most = (least - power[newest] * rule.limit * total[entries - newest]) / total[newest]
    possible = (most >= -rule.limit) & (least >= -rule.limit)  # neither a step nor a sum is ever less
    return np.concatenate([[-np.inf], np.where(possible, most, -np.inf)])


@jit
def _log_sum(p, q):  # type: ignore[no-untyped-def]
    """A lower bound of log(exp(p) + exp(q)): the greater of the two; log 2 and the mean."""
    return max(max(p, q), LOG2 + 0.5 * (p + q))


@jit
def screened(a, track, found, count, around, length, record, outline, rule, cut):  # type: ignore[no-untyped-def]
    """Leave those of the neighbours of a track whose score may exceed the threshold. Returns: how many.

    A step is at most place + max(course, 0) - q / 2, where
    - place = -log(2 pi density r), r the root of the determinant of the position block of the covariance. That is at least floor times the
      sum of the tracks' plus their registration terms, and roots of determinants of 2 x 2 matrices that are not negative are
      superadditive (Minkowski).
    - course = log(null variance / r') + (difference of the velocities)^2 / 2 / null variance, r' the root of the determinant of the
      velocity
      block given the position: a Schur complement, superadditive too, and registration only adds to it.
    - q, the squared length of the position's difference in terms of its covariance then, is at least (u d)^2 / (u C u) / older for
      any direction u (Cauchy and Schwarz), where C = cap times the covariances plus the registration terms is no smaller than the
      block, and
      older bounds by how much the variance was larger. u = |C| C^-1 d for the newest d, hence u C u = |C| u d; over the newest entries
      u d is linear in time but for what both tracks bend.

    Args: a: rank of the track; track: ranks by place; found: places of `count` neighbours, changed; around: density a square metre.
    """
    left, north, east, rough = 0, record[a, NORTH], record[a, EAST], record[a, ROUGH]
    half, course_0 = 0.25 / (rule.null_speed * rule.null_speed), math.log(2.0 * rule.null_speed * rule.null_speed)
    alone = -logarithm(2.0 * math.pi * around)
    for k in range(count):
        b = track[found[k]]
        n = min(length[a], length[b])
        x, y = outline[b, EAST_RATE] - outline[a, EAST_RATE], outline[b, NORTH_RATE] - outline[a, NORTH_RATE]
        change = math.sqrt(x * x + y * y) + outline[a, CHANGE] + outline[b, CHANGE]
        course = course_0 - _log_sum(outline[a, RATE_AREA], outline[b, RATE_AREA]) + half * change * change
        need = 2.0 * (alone - _log_sum(outline[a, AREA], outline[b, AREA]) + max(course, 0.0) - cut[n])
        x, y, back = (
            turned(outline[b, LONGITUDE] - outline[a, LONGITUDE]) * east,
            (outline[b, LATITUDE] - outline[a, LATITUDE]) * north,
            min(n, SEEN) - 1,
        )
        x1, y1 = (
            x - back * (outline[b, DRIFT_EAST] - outline[a, DRIFT_EAST]) * east,
            y - back * (outline[b, DRIFT_NORTH] - outline[a, DRIFT_NORTH]) * north,
        )
        ee, en, nn = (
            outline[a, SIZE_EE] + outline[b, SIZE_EE],
            outline[a, SIZE_EN] + outline[b, SIZE_EN],
            outline[a, SIZE_NN] + outline[b, SIZE_NN],
        )
        u, v = nn * x - en * y, ee * y - en * x
        square = u * x + v * y
        off = rough * (abs(u) * max(abs(x), abs(x1)) + abs(v) * max(abs(y), abs(y1)))
        off += (1.0 + rough) * math.sqrt(u * u + v * v) * (outline[a, BEND] + outline[b, BEND])
        near, variance = max(min(square, u * x1 + v * y1) - off, 0.0), outline[a, VARIANCE] + outline[b, VARIANCE]
        far = near * near * variance >= need * (ee * nn - en * en) * square * max(
            outline[a, WORST] + outline[b, WORST], variance
        )
        known = (outline[a, AREA] > -math.inf) & (outline[b, AREA] > -math.inf)
        found[left] = found[k]
        left += not (known & ((need <= 0.0) | ((near > 0.0) & far)))
    return left
