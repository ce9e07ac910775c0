"""Likelihoods of windows of bearings: of a known vessel, and of one that nobody else has seen. Scalar code a row, by numba.

A window is a row, oldest first, NaN before the first bearing; everything here walks it from the newest bearing back.
"""

import math

import numpy as np
from numba import njit

LOG_2PI = math.log(2.0 * math.pi)
NEAREST = 1.0  # metres: a vessel on top of the sensor has no bearing, its uncertainty says so


@njit(cache=True)
def wrap(angle):  # type: ignore[no-untyped-def]
    """The angle in (-pi, pi]."""
    return -((-angle + math.pi) % (2.0 * math.pi) - math.pi)


@njit(cache=True)
def _one_range(time, bearing, variance, rate_variance, rate_noise, out):  # type: ignore[no-untyped-def]
    """out[n]: log density of the newest n bearings of a vessel whose bearing has a random rate that wanders; offset flat, density 1.

    Args: time, bearing: (W,); variance of one bearing; variance of the rate and its growth a second; out (W + 1,).
    """
    w = time.shape[0]
    theta, rate = 0.0, 0.0
    p00, p01, p11 = 0.0, 0.0, rate_variance
    total, before = 0.0, 0.0
    out[0] = 0.0
    for n in range(1, w + 1):
        k = w - n
        if math.isnan(bearing[k]):
            for m in range(n, w + 1):
                out[m] = total
            return
        if n == 1:
            theta, p00 = bearing[k], variance
        else:
            dt = time[k] - before
            a = abs(dt)
            theta += dt * rate
            p00 += 2.0 * dt * p01 + dt * dt * p11 + rate_noise * a * a * a / 3.0
            p01 += dt * p11 + 0.5 * rate_noise * a * dt
            p11 += rate_noise * a
            s = p00 + variance
            v = wrap(bearing[k] - theta)
            total -= 0.5 * (LOG_2PI + math.log(s) + v * v / s)
            g0, g1 = p00 / s, p01 / s
            theta += g0 * v
            rate += g1 * v
            p11 -= g1 * p01
            p01 -= g0 * p01
            p00 -= g0 * p00
        before = time[k]
        out[n] = total


@njit(cache=True)
def unknown_vessel(time, bearing, variance, reach, share, weight, speed, kick, out):  # type: ignore[no-untyped-def]
    """out[i, n]: log density of the newest n bearings of track i, if they come from a vessel anywhere in reach.

    The range is one of `reach * share`, with these weights; at range r the bearing rate is N(0, (speed / r)^2) and wanders,
    by the geometry of a straight course (variance (speed / r)^3 a second) and by changes of course (kick / r^2). The bearing
    itself is flat with density 1 a radian.
    Args: time, bearing: (N, W); variance, reach: (N,); share, weight: (J,); speed, kick; out: (N, W + 1).
    """
    n, w = time.shape
    terms = np.empty((share.shape[0], w + 1))
    for i in range(n):
        for j in range(share.shape[0]):
            angular = speed / (reach[i] * share[j])
            noise = angular**3 + kick * (angular / speed) ** 2
            _one_range(time[i], bearing[i], variance[i], angular * angular, noise, terms[j])
        for m in range(w + 1):
            most = -np.inf
            for j in range(share.shape[0]):
                most = max(most, terms[j, m])
            total = 0.0
            for j in range(share.shape[0]):
                total += weight[j] * math.exp(terms[j, m] - most)
            out[i, m] = most + math.log(total)


@njit(cache=True)
def _seen_from(path, at, blend, origin, axes):  # type: ignore[no-untyped-def]
    """East, north and standard deviation of a vessel between two instants of its path, from a site; NaN where it was absent."""
    east, north = 0.0, 0.0
    for c in range(3):
        d = (1.0 - blend) * path[at, c] + blend * path[at + 1, c] - origin[c]
        east += axes[0, c] * d
        north += axes[1, c] * d
    return east, north, (1.0 - blend) * path[at, 3] + blend * path[at + 1, 3]


@njit(cache=True)
def _later(state, rho):  # type: ignore[no-untyped-def]
    """The state (offset, position error, p00, p01, p11) when the error, of unit variance, has kept `rho` of itself."""
    offset, error, p00, p01, p11 = state
    return offset, rho * error, p00, rho * p01, rho * rho * p11 + 1.0 - rho * rho


@njit(cache=True)
def _updated(state, difference, h, variance):  # type: ignore[no-untyped-def]
    """The state after one bearing difference, offset + h * error + noise, and the log density of that difference."""
    offset, error, p00, p01, p11 = state
    g0, g1 = p00 + h * p01, p01 + h * p11
    s = g0 + h * g1 + variance
    v = difference - offset - h * error
    after = offset + g0 / s * v, error + g1 / s * v, p00 - g0 * g0 / s, p01 - g0 * g1 / s, p11 - g1 * g1 / s
    return after, -0.5 * (LOG_2PI + math.log(s) + v * v / s)


@njit(cache=True)
def beyond(distance, direction, reach, arc_from, arc_width):  # type: ignore[no-untyped-def]
    """How far a place is outside the coverage, negative inside."""
    past = distance - reach
    if arc_width < 2.0 * math.pi:
        off = abs(wrap(direction - arc_from - 0.5 * arc_width)) - 0.5 * arc_width
        past = max(past, distance * math.sin(min(max(off, -0.5 * math.pi), 0.5 * math.pi)))
    return past


@njit(cache=True)
def less_heard(sigmas, heard, outside):  # type: ignore[no-untyped-def]
    """What is added to the log odds of being heard of a vessel so many standard deviations outside the coverage."""
    p = outside + (heard - outside) * 0.5 * math.erfc(sigmas / math.sqrt(2.0))
    return math.log(p / (1.0 - p)) - math.log(heard / (1.0 - heard))


@njit(cache=True)
def known_vessel(  # type: ignore[no-untyped-def]
    pair_bearing,
    pair_vessel,
    time,
    bearing,
    frame,
    frame_origin,
    frame_axes,
    before,
    blend,
    path,
    null,
    heard,
    unknown_density,
    outside,
    reach,
    arc_from,
    arc_width,
    bias,
    bias_variance,
    variance,
    memory,
    give_up,
    out_gain,
    out_residual,
):
    """Log odds of each pair, vessel against unknown vessel, and the mean of its bearing differences.

    Differences are white noise (`variance`), plus the across-range error of the vessel's position, correlated over `memory`
    seconds, plus a constant offset with `bias_variance`. A window ends where the vessel's own path does.
    Args:
        pair_bearing, pair_vessel: (A,) rows.
        time, bearing: (N, W). frame: (N, W) rows of frame_origin (F, 3) and frame_axes (F, 2, 3), Earth-centred.
        before, blend: (N, W) the instant of the paths before each bearing (-1 none) and the share of the next one.
        path: (V, T, 4) Earth-centred position and its standard deviation per axis, NaN where absent.
        null: (N, W + 1) of `unknown_vessel`. heard: that a vessel inside the coverage (reach, arc_from, arc_width: (N,)) is heard.
        unknown_density: (N,) log density of unknown vessels, 1 / rad. outside: (N,) that a vessel outside the coverage is heard.
        bias, bias_variance, variance: (N,). memory, give_up: numbers.
        out_gain: (A,) -inf where nothing could be compared. out_residual: (A,) NaN where nothing could be compared.
    """
    w = time.shape[1]
    for a in range(pair_bearing.shape[0]):
        i, j = pair_bearing[a], pair_vessel[a]
        out_gain[a], out_residual[a] = -np.inf, np.nan
        state = (0.0, 0.0, bias_variance[i], 0.0, 1.0)
        odds, weights, weighted, used = math.log(heard / (1.0 - heard)) - unknown_density[i], 0.0, 0.0, 0
        worst = -np.inf
        for k in range(w - 1, -1, -1):
            if before[i, k] < 0 or math.isnan(bearing[i, k]):
                break
            f = frame[i, k]
            east, north, sigma = _seen_from(path[j], before[i, k], blend[i, k], frame_origin[f], frame_axes[f])
            if math.isnan(east):
                break
            distance, direction = max(math.sqrt(east * east + north * north), NEAREST), math.atan2(east, north)
            h = sigma / distance
            past = beyond(distance, direction, reach[i], arc_from[i], arc_width[i])
            worst = max(worst, past / max(sigma, NEAREST))
            if used > 0:
                state = _later(state, math.exp(-abs(time[i, k + 1] - time[i, k]) / memory))
            difference = wrap(bearing[i, k] - direction - bias[i])
            state, density = _updated(state, difference, h, variance[i])
            odds += density
            used += 1
            weights += 1.0 / (variance[i] + h * h)
            weighted += difference / (variance[i] + h * h)
            if odds - null[i, used] < give_up:
                break
        if used > 0:
            out_gain[a] = odds - null[i, used] + less_heard(worst, heard, outside[i])
            out_residual[a] = weighted / weights + bias[i]
