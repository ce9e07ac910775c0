"""Statistics of windows of differences between pairs of tracks: scalar code a pair, compiled by numba.

A window is a row of a ring that has been laid out in time: newest last, `length` valid entries at the end.
"""

import math

import numpy as np
from numba import njit

SEMI_MAJOR = 6378137.0
ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563


@njit(cache=True)
def _scales(latitude):  # type: ignore[no-untyped-def]
    """Metres a degree north and east: the scalar twin of geodesy.scale_m_deg."""
    s = math.sin(math.radians(latitude))
    w2 = 1.0 - ECCENTRICITY2 * s * s
    north = SEMI_MAJOR * (1.0 - ECCENTRICITY2) / (w2 * math.sqrt(w2)) * math.pi / 180.0
    east = SEMI_MAJOR / math.sqrt(w2) * math.cos(math.radians(latitude)) * math.pi / 180.0
    return north, east


@njit(cache=True)
def _differences(a, b, position, velocity, n, out):  # type: ignore[no-untyped-def]
    """east, north, east rate, north rate of b less a for the newest n entries, oldest first."""
    w = position.shape[1]
    north, east = _scales(0.5 * (position[a, w - 1, 0] + position[b, w - 1, 0]))
    for k in range(n):
        i = w - n + k
        turn = position[b, i, 1] - position[a, i, 1]
        if turn > 180.0:
            turn -= 360.0
        elif turn < -180.0:
            turn += 360.0
        out[k, 0] = turn * east
        out[k, 1] = (position[b, i, 0] - position[a, i, 0]) * north
        out[k, 2] = velocity[b, i, 0] - velocity[a, i, 0]
        out[k, 3] = velocity[b, i, 1] - velocity[a, i, 1]


@njit(cache=True)
def _cholesky(m, low):  # type: ignore[no-untyped-def]
    """Lower Cholesky factor of a 4 x 4 matrix into `low`; False where it is not positive definite."""
    for i in range(4):
        for j in range(i + 1):
            s = m[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                low[i, i] = math.sqrt(s)
            else:
                low[i, j] = s / low[j, j]
    return True


@njit(cache=True)
def _whiten(low, d, white):  # type: ignore[no-untyped-def]
    """Solve low @ white = d; returns the squared length of white."""
    total = 0.0
    for i in range(4):
        s = d[i]
        for k in range(i):
            s -= low[i, k] * white[k]
        white[i] = s / low[i, i]
        total += white[i] * white[i]
    return total


@njit(cache=True)
def _spread(delta, n, low, first):  # type: ignore[no-untyped-def]
    """tr(Phi0^-1 S) / 2 of the 2 x 2 block that begins at `first`; S is the sample covariance about the mean."""
    mean0 = 0.0
    mean1 = 0.0
    for k in range(n):
        mean0 += delta[k, first]
        mean1 += delta[k, first + 1]
    mean0 /= n
    mean1 /= n
    s00 = 0.0
    s01 = 0.0
    s11 = 0.0
    for k in range(n):
        x = delta[k, first] - mean0
        y = delta[k, first + 1] - mean1
        s00 += x * x
        s01 += x * y
        s11 += y * y
    p00 = 0.0
    p01 = 0.0
    p11 = 0.0
    for k in range(first + 1):
        p00 += low[first, k] * low[first, k]
        p01 += low[first, k] * low[first + 1, k]
    for k in range(first + 2):
        p11 += low[first + 1, k] * low[first + 1, k]
    determinant = p00 * p11 - p01 * p01
    return (s00 * p11 - 2.0 * s01 * p01 + s11 * p00) / determinant / (2.0 * (n - 1))


@njit(cache=True)
def _scale(delta, n, low, first, prior, floor, cap):  # type: ignore[no-untyped-def]
    """Factor of the 2 x 2 block that begins at `first`: what the window shows, drawn to 1 as by so many more entries."""
    weight = (n - 1.0) / (n - 1.0 + prior)
    return min(max(1.0 + weight * (_spread(delta, n, low, first) - 1.0), floor), cap)


@njit(cache=True)
def _bounded(delta, n, phi, registration, prior, floor, cap, low, total):  # type: ignore[no-untyped-def]
    """Factor of phi, scaled block by block by what the window shows, plus the registration term, into `low`; False: not positive.

    `total` is room for the sum.
    """
    if not _cholesky(phi, low):
        return False
    gain_p = gain_v = 1.0
    if n > 2:
        gain_p = _scale(delta, n, low, 0, prior, floor, cap)
        gain_v = _scale(delta, n, low, 2, prior, floor, cap)
    for i in range(4):
        for j in range(4):
            total[i, j] = phi[i, j] * math.sqrt((gain_p if i < 2 else gain_v) * (gain_p if j < 2 else gain_v))
            if i < 2 and j < 2:
                total[i, j] += registration[i, j]
    return _cholesky(total, low)


@njit(cache=True)
def _ratio(delta, low, older_p, older_v, place, course, misled, null_variance, limit):  # type: ignore[no-untyped-def]
    """Log-likelihood ratio of one difference, bounded by the limit.

    Args: delta: (4,); low: factor of its covariance now; older_p, older_v: by how much larger the variances of position and velocity
    were then, 1 or more; place, course: the ratio of a difference of zero, of the position and of the velocity given it; misled: share
    of tracks whose velocity says nothing, so that the position alone decides; null_variance: of each component of the
    difference of unrelated velocities.
    """
    p, v = 1.0 / math.sqrt(older_p), 1.0 / math.sqrt(older_v)
    a = p * delta[0] / low[0, 0]
    b = (p * delta[1] - low[1, 0] * a) / low[1, 1]
    place -= 0.5 * (a * a + b * b)
    course += 0.5 * (delta[2] * delta[2] + delta[3] * delta[3]) / null_variance
    if place + max(course, 0.0) <= -limit:  # most pairs, without a logarithm: what follows only makes it less
        return -limit
    c = (v * delta[2] - low[2, 0] * a - low[2, 1] * b) / low[2, 2]
    d = (v * delta[3] - low[3, 0] * a - low[3, 1] * b - low[3, 2] * c) / low[3, 3]
    course -= 0.5 * (c * c + d * d)
    place -= math.log(older_p)
    course -= math.log(older_v)
    if course > 30.0:
        return min(max(place + course + math.log1p(-misled), -limit), limit)
    return min(max(place + math.log(misled + (1.0 - misled) * math.exp(course)), -limit), limit)


@njit(cache=True, nogil=True)
def windowed_scores(  # type: ignore[no-untyped-def]
    first,
    second,
    position,
    velocity,
    variance,
    length,
    phi,
    registration,
    density,
    prior,
    floor,
    cap,
    memory,
    limit,
    misled,
    null_speed,
):
    """Discounted log-likelihood ratio of "one vessel" against "no partner" over the common window of each pair.

    The covariance of a step is phi, scaled in its position and its velocity block by what the window shows about it (drawn to 1 by
    the prior, floored and capped), plus the registration term, which is constant and cannot show; each block of all that by how much
    larger the summed variance was then than it is now. The likelihood is a mixture: where a track is misled its velocity is as
    that of an unrelated vessel.

    Args:
        first, second: (A,) rows of tracks.
        position: (N, W, 2) latitude, longitude in degrees, newest last. velocity: (N, W, 2).
        variance: (N, W, 2) of position and of velocity (traces) of the track at each entry. length: (N,) valid entries.
        phi: (A, 4, 4) covariance of the difference of the tracks now. registration: (A, 2, 2) of a constant offset.
        density: (A,) unrelated tracks a square metre.
        prior: entries of the window that phi counts as. floor, cap: of the scale. memory: factor by which what was known counts one
        cycle later. limit: bound of one step and, as -limit, of the sum. misled: share, 0 to 1. null_speed: standard deviation a
        axis of the velocity of unrelated vessels.
    Returns: (A,).
    """
    count = len(first)
    score = np.full(count, -math.inf)
    w = position.shape[1]
    delta, low, total_phi = np.empty((w, 4)), np.zeros((4, 4)), np.empty((4, 4))
    null_variance = 2.0 * null_speed * null_speed
    for p in range(count):
        a, b = first[p], second[p]
        n = min(length[a], length[b])
        if n < 1:
            continue
        _differences(a, b, position, velocity, n, delta)
        if not _bounded(delta, n, phi[p], registration[p], prior, floor, cap, low, total_phi):
            continue
        place = -math.log(2.0 * math.pi * low[0, 0] * low[1, 1] * density[p])
        course = math.log(null_variance / (low[2, 2] * low[3, 3]))
        now_p = variance[a, w - 1, 0] + variance[b, w - 1, 0]
        now_v = variance[a, w - 1, 1] + variance[b, w - 1, 1]
        total = 0.0
        for k in range(n):
            older_p = max((variance[a, w - n + k, 0] + variance[b, w - n + k, 0]) / now_p, 1.0)
            older_v = max((variance[a, w - n + k, 1] + variance[b, w - n + k, 1]) / now_v, 1.0)
            step = _ratio(delta[k], low, older_p, older_v, place, course, misled, null_variance, limit)
            total = max(memory * total + step, -limit)
        score[p] = total
    return score


@njit(cache=True, nogil=True)
def sample_statistics(first, second, position, velocity, length, p):  # type: ignore[no-untyped-def]
    """x = Delta^T S^-1 Delta of the newest difference, S the sample covariance of the newest p differences (paper, eq. 7).

    Args: as `windowed_scores`; p: length of the window. Returns: (A,) x, infinite where the common window is shorter than p or S is
    singular.
    """
    count = len(first)
    out = np.empty(count)
    delta = np.empty((position.shape[1], 4))
    low = np.zeros((4, 4))
    white = np.empty(4)
    mean = np.empty(4)
    s = np.empty((4, 4))
    for q in range(count):
        a = first[q]
        b = second[q]
        out[q] = math.inf
        if min(length[a], length[b]) < p:
            continue
        _differences(a, b, position, velocity, p, delta)
        for i in range(4):
            mean[i] = 0.0
            for k in range(p):
                mean[i] += delta[k, i]
            mean[i] /= p
        for i in range(4):
            for j in range(4):
                s[i, j] = 0.0
                for k in range(p):
                    s[i, j] += (delta[k, i] - mean[i]) * (delta[k, j] - mean[j])
                s[i, j] /= p - 1
        if _cholesky(s, low):
            out[q] = _whiten(low, delta[p - 1], white)
    return out
