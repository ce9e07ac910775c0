"""Likelihoods of windows of bearings, if they come from vessels of the picture. LANES pairs at a time, by numba.

The window of a track is walked from the newest bearing back. Every lane is at a step of its own: a pair that ends leaves its lane to the
next pair. Where a vessel was is gathered lane by lane, all that follows from it is done for several lanes at once. What a pair gets is the
same to the bit as alone.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.association.history import fetch, number
from coastwatch.kernels.bearings.null_hypothesis import LOG_2PI, short_way
from coastwatch.kernels.bearings.windows import (
    AFTER,
    BEFORE,
    COSINE,
    LANES,
    NULL,
    PLACE_BYTES,
    PLACES,
    RHO,
    SAID,
    SHARE,
    SINE,
    SLOTS,
    VECTOR,
    WHERE,
    gathered,
    looked,
    sifted,
)
from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes
from coastwatch.kernels.jit import jit
from coastwatch.kernels.vectorised_math import angle, logarithm

NEAREST = 1.0  # metres: a vessel on top of the sensor has no bearing, its uncertainty says so
TRACKS = 64  # at once: what their bearings say stays in the cache
STEP_SAID = 2 * PLACES  # rows of a lane: its vessel at two instants, then what its step says
EAST, NORTH, SIGMA, DISTANCE, FRAME = range(
    STEP_SAID + SAID, STEP_SAID + SAID + 5
)  # of the step that a lane is at; FRAME: 7 rows of its pair
VARIANCE, REACH, OFFSET, ERROR, P00, P01, P11, ODDS, MARGIN, WORST, WEIGHTS, WEIGHTED, ROWS = range(FRAME + 7, FRAME + 20)
WANTED, PAIR, BYTES, FIRST, STEP, NUMBERS = range(6)  # whole numbers of a lane


@jit
def beyond(distance, direction, reach, arc_from, arc_width):  # type: ignore[no-untyped-def]
    """How far a place is outside the coverage, negative inside."""
    past = distance - reach
    if arc_width < 2.0 * math.pi:
        off = abs(short_way(direction - arc_from - 0.5 * arc_width)) - 0.5 * arc_width
        past = max(past, distance * math.sin(min(max(off, -0.5 * math.pi), 0.5 * math.pi)))
    return past


@jit
def less_heard(sigmas, heard, odds, outside):  # type: ignore[no-untyped-def]
    """What is added to the log odds of being heard of a vessel so many standard deviations outside the coverage."""
    p = outside + (heard - outside) * 0.5 * math.erfc(sigmas / math.sqrt(2.0))
    return math.log(p / (1.0 - p)) - odds


@jit
def _begun(c, first, t, i, p, slot, windows, rule, frame, x, number_of):  # type: ignore[no-untyped-def]
    """Pair p, of the track wanted as first + t, which is track i, and of the vessel in a slot, into lane c."""
    number_of[WANTED, c], number_of[PAIR, c], number_of[BYTES, c] = first + t, p, slot * PLACE_BYTES
    number_of[FIRST, c] = number_of[STEP, c] = t * (windows.time.shape[1] + 1)
    for k in range(7):
        x[FRAME + k, c] = frame[t, k]
    x[VARIANCE, c], x[REACH, c] = windows.variance[i], windows.reach[i]
    x[OFFSET, c], x[ERROR, c], x[P00, c], x[P01, c], x[P11, c] = 0.0, 0.0, windows.bias_variance[i], 0.0, 1.0
    x[ODDS, c] = rule.odds - windows.density[i]
    x[MARGIN, c], x[WORST, c], x[WEIGHTS, c], x[WEIGHTED, c] = np.inf, -np.inf, 0.0, 0.0


@jit
def _moved(of, to, x, number_of):  # type: ignore[no-untyped-def]
    """What is in one lane into another one."""
    for k in range(FRAME, ROWS):
        x[k, to] = x[k, of]
    for k in range(NUMBERS):
        number_of[k, to] = number_of[k, of]


@jit
def _ended(c, row, windows, rule, x, number_of, gain, residual):  # type: ignore[no-untyped-def]
    """The pair in lane c is looked at no further."""
    i, p = row[number_of[WANTED, c]], number_of[PAIR, c]
    if number_of[STEP, c] == number_of[FIRST, c]:
        gain[p], residual[p] = -np.inf, np.nan
        return
    gain[p], residual[p] = x[MARGIN, c], x[WEIGHTED, c] / x[WEIGHTS, c] + windows.bias[i]
    if x[MARGIN, c] >= rule.give_up:
        gain[p] += less_heard(x[WORST, c], rule.heard, rule.odds, windows.outside[i])


@jit
def _stepped(c, rule, said, where, x, number_of):  # type: ignore[no-untyped-def]
    """Lane c to its next step. Returns: whether there is one: a window ends with its bearings, with the path, and when it is given up."""
    step, at_byte = np.uint64(number_of[STEP, c]), number_of[BYTES, c]
    if x[MARGIN, c] < rule.give_up or at_byte < 0 or at_byte >= where[step, SLOTS]:
        return False
    before, after = where[step, BEFORE] + at_byte, where[step, AFTER] + at_byte
    if math.isnan(number(before) + number(after)):  # type: ignore[call-arg]
        return False
    fetch(where[step + np.uint64(1), BEFORE] + at_byte)
    gathered(before, after, c, x)
    for k in range(SAID):
        x[STEP_SAID + k, c] = said[step, k]
    number_of[STEP, c] += 1
    return True


@jit
def _elsewhere(m, first, row, windows, still, x, number_of):  # type: ignore[no-untyped-def]
    """Where the bearing of each lane was taken, of sensors that move."""
    for c in range(m):
        if not still[number_of[WANTED, c] - first]:
            i, k = row[number_of[WANTED, c]], windows.time.shape[1] - (number_of[STEP, c] - number_of[FIRST, c])
            f = ecef_and_axes(windows.site[i, k, 0], windows.site[i, k, 1])
            x[FRAME, c], x[FRAME + 1, c], x[FRAME + 2, c], x[FRAME + 3, c] = f[0], f[1], f[2], f[3]
            x[FRAME + 4, c], x[FRAME + 5, c], x[FRAME + 6, c] = f[4], f[5], f[6]


@jit
def _off_the_arc(m, row, windows, x, number_of):  # type: ignore[no-untyped-def]
    """How far lanes of sensors that do not hear all round are outside their coverage, if farther than so far."""
    for c in range(m):
        i = row[number_of[WANTED, c]]
        if windows.arc_width[i] < 2.0 * math.pi:
            towards = math.atan2(x[EAST, c], x[NORTH, c])
            past = beyond(x[DISTANCE, c], towards, windows.reach[i], windows.arc_from[i], windows.arc_width[i])
            x[WORST, c] = max(x[WORST, c], past / max(x[SIGMA, c], NEAREST))


@jit
def _placed(m, x):  # type: ignore[no-untyped-def]
    """East, north, standard deviation and distance of each vessel between its two instants, from the site."""
    for c in range((m + VECTOR - 1) // VECTOR * VECTOR):
        share = x[STEP_SAID + SHARE, c]
        dx = (1.0 - share) * x[0, c] + share * x[4, c] - x[FRAME, c]
        dy = (1.0 - share) * x[1, c] + share * x[5, c] - x[FRAME + 1, c]
        dz = (1.0 - share) * x[2, c] + share * x[6, c] - x[FRAME + 2, c]
        sp, cp, sl, cl = x[FRAME + 3, c], x[FRAME + 4, c], x[FRAME + 5, c], x[FRAME + 6, c]
        east, north = cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy)
        x[EAST, c], x[NORTH, c] = east, north
        x[SIGMA, c] = (1.0 - share) * x[3, c] + share * x[7, c]
        x[DISTANCE, c] = max(math.sqrt(east * east + north * north), NEAREST)


@jit
def _compared(m, x):  # type: ignore[no-untyped-def]
    """One bearing more: offset + h * error + noise, where the error has kept `rho` of itself since the bearing before."""
    for c in range((m + VECTOR - 1) // VECTOR * VECTOR):
        east, north, sigma, distance = x[EAST, c], x[NORTH, c], x[SIGMA, c], x[DISTANCE, c]
        sine, cosine, rho = x[STEP_SAID + SINE, c], x[STEP_SAID + COSINE, c], x[STEP_SAID + RHO, c]
        h, variance = sigma / distance, x[VARIANCE, c]
        x[WORST, c] = max(x[WORST, c], (distance - x[REACH, c]) / max(sigma, NEAREST))
        difference = angle(sine * north - cosine * east, cosine * north + sine * east)
        offset, error, p00 = x[OFFSET, c], rho * x[ERROR, c], x[P00, c]
        p01, p11 = rho * x[P01, c], rho * rho * x[P11, c] + 1.0 - rho * rho
        g0, g1 = p00 + h * p01, p01 + h * p11
        s = g0 + h * g1 + variance
        v = difference - offset - h * error
        shrunk = 1.0 / s
        x[OFFSET, c], x[ERROR, c] = offset + g0 * shrunk * v, error + g1 * shrunk * v
        x[P00, c], x[P01, c], x[P11, c] = p00 - g0 * g0 * shrunk, p01 - g0 * g1 * shrunk, p11 - g1 * g1 * shrunk
        odds = x[ODDS, c] - 0.5 * (LOG_2PI + logarithm(s) + v * v * shrunk)
        x[ODDS, c], x[MARGIN, c] = odds, odds - x[STEP_SAID + NULL, c]
        weight = 1.0 / (variance + h * h)
        x[WEIGHTS, c] += weight
        x[WEIGHTED, c] += weight * difference


@jit
def _walked(first, kept, row, slot, windows, rule, said, where, still, frame, odd, gain, residual):  # type: ignore[no-untyped-def]
    """The pairs that `sifted` kept. Args: odd: whether any of the sensors moves, or does not hear all round."""
    x, number_of = np.empty((ROWS, LANES)), np.empty((NUMBERS, LANES), np.int64)
    e, m = 0, 0
    while True:
        c = 0
        while c < LANES:
            if c < m:
                if _stepped(c, rule, said, where, x, number_of):
                    c += 1
                    continue
                _ended(c, row, windows, rule, x, number_of, gain, residual)
            if e < len(kept):
                t, p = kept[e, 0], kept[e, 1]
                _begun(c, first, t, row[first + t], p, slot[p], windows, rule, frame, x, number_of)
                e, m = e + 1, max(m, c + 1)
            elif c < m:
                m -= 1
                _moved(m, c, x, number_of)
            else:
                break
        if m == 0:
            break
        if odd:
            _elsewhere(m, first, row, windows, still, x, number_of)
        _placed(m, x)
        if odd:
            _off_the_arc(m, row, windows, x, number_of)
        _compared(m, x)


@jit
def known_vessels(low, high, row, start, slot, windows, null, paths, rule, gain, residual):  # type: ignore[no-untyped-def]
    """Log odds of each pair, vessel against unknown vessel, and the mean of its bearing differences.

    Differences are white noise, plus the across-range error of the vessel's position, correlated over `rule.memory` seconds,
    plus a constant offset with `bias_variance`. A window ends where the vessel's own path does, and with `give_up`.
    Args:
        low, high: of row (R,), the tracks that are wanted. start: (R + 1,) where the pairs of each begin. slot: (A,) of the vessel of each
        pair in the paths, -1 for none. windows: Windows. null: (R, W + 1) of `unknown_vessels`. paths: Paths. rule: Rule.
        gain: (A,) written; -inf where nothing could be compared, less than `give_up` where a pair is given up. residual: the same, NaN
        where nothing could be compared, and where the newest bearing alone rules the vessel out.
    """
    steps = TRACKS * (windows.time.shape[1] + 1)
    said, where = np.empty((steps, SAID)), np.empty((steps, WHERE), np.int64)
    still, frame, room = np.empty(TRACKS, np.bool_), np.zeros((TRACKS, 7)), np.empty((3, windows.time.shape[1]))
    for first in range(low, high, TRACKS):
        count, odd = min(TRACKS, high - first), False
        looked(first, count, row, windows, null, paths, rule, said, where, still, frame, room)
        for t in range(count):
            odd |= not still[t] or windows.arc_width[row[first + t]] < 2.0 * math.pi
        kept = np.empty((start[first + count] - start[first] + 1, 2), np.int64)
        found = sifted(first, count, row, start, slot, windows, rule, said, where, frame, kept, gain, residual)
        _walked(first, kept[:found], row, slot, windows, rule, said, where, still, frame, odd, gain, residual)
