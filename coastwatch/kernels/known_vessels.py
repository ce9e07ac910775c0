"""Likelihoods of windows of bearings, if they come from vessels of the picture. LANES pairs at a time, by numba.

The window of a track is walked from the newest bearing back. Every lane is at a step of its own: a pair that ends leaves its lane to the
next pair. Where a vessel was is gathered lane by lane, what follows from it is done for eight lanes at once. What a pair gets is the same
to the bit as alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.compiling import arithmetic, bare_part
from coastwatch.kernels.earth_centred import sine_cosine
from coastwatch.kernels.elementary import angle, exponential, logarithm
from coastwatch.kernels.rings import fetch, number
from coastwatch.kernels.tangent import centred
from coastwatch.kernels.unknown_vessels import LOG_2PI, short_way

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAREST = 1.0  # metres: a vessel on top of the sensor has no bearing, its uncertainty says so
PLACES = 4  # numbers of a vessel at an instant: Earth-centred position, standard deviation per axis
PLACE_BYTES = 8 * PLACES
LANES, VECTOR = 64, 8  # pairs at once, and what is computed in one go
TRACKS = 256  # at once: what their bearings say stays in the cache
AHEAD = 8  # pairs whose vessels are asked for before they begin
EAST, NORTH, SIGMA, DISTANCE, SINE, COSINE, RHO, NULL = range(8)  # of the step that a lane is at
VARIANCE, REACH, OFFSET, ERROR, P00, P01, P11, ODDS, MARGIN, WORST, WEIGHTS, WEIGHTED, ROWS = range(8, 21)  # of its pair
WANTED, TRACK, PAIR, SLOT, USED, NUMBERS = range(6)  # whole numbers of a lane


class Windows(NamedTuple):
    """Of N bearing tracks."""

    time: Floats  # (N, W) s, oldest first, NaN before the first bearing
    bearing: Floats  # (N, W) rad
    site: Floats  # (N, W, 2) degrees
    density: Floats  # (N,) log density of unknown vessels, 1 / rad
    outside: Floats  # (N,) that a vessel outside the coverage is heard
    reach: Floats  # (N,) m: the coverage
    arc_from: Floats  # (N,) rad
    arc_width: Floats  # (N,) 2 pi: all round
    bias: Floats  # (N,) rad
    bias_variance: Floats  # (N,)
    variance: Floats  # (N,) of a bearing


class Paths(NamedTuple):
    """Where vessels were at T common instants."""

    time: Floats  # (T,) oldest first
    table: Ints  # (T,) addresses of arrays (S, PLACES), oldest first; NaN: absent
    slots: Ints  # (T,) how long each is; a later slot was absent


class Rule(NamedTuple):
    heard: float  # that a vessel inside the coverage has a track
    odds: float  # the logarithm of its odds
    memory: float  # s, correlation time of position errors
    give_up: float  # log odds at which a pair is not looked at any further


@bare_part
def beyond(distance, direction, reach, arc_from, arc_width):  # type: ignore[no-untyped-def]
    """How far a place is outside the coverage, negative inside."""
    past = distance - reach
    if arc_width < 2.0 * math.pi:
        off = abs(short_way(direction - arc_from - 0.5 * arc_width)) - 0.5 * arc_width
        past = max(past, distance * math.sin(min(max(off, -0.5 * math.pi), 0.5 * math.pi)))
    return past


@bare_part
def less_heard(sigmas, heard, odds, outside):  # type: ignore[no-untyped-def]
    """What is added to the log odds of being heard of a vessel so many standard deviations outside the coverage."""
    p = outside + (heard - outside) * 0.5 * math.erfc(sigmas / math.sqrt(2.0))
    return math.log(p / (1.0 - p)) - odds


@bare_part
def _instant(time, t, hi):  # type: ignore[no-untyped-def]
    """The instant before t that has one after it, -1 where t is outside, and the share of the one after it.

    Args: hi: where the one after it was found for a bearing nearby.
    """
    if len(time) < 2:
        return -1, 0.0
    while hi < len(time) - 1 and time[hi] < t:
        hi += 1
    while hi > 1 and time[hi - 1] >= t:
        hi -= 1
    share = (t - time[hi - 1]) / (time[hi] - time[hi - 1])
    return (hi - 1, share) if 0.0 <= share <= 1.0 else (-1, 0.0)


@bare_part
def _ending(i, windows, paths, at, share):  # type: ignore[no-untyped-def]
    """The instant before each bearing of track i, and the share of the one after it, from the newest back to where its window ends.

    Returns: the oldest bearing that counts, W for none.
    """
    w, before = windows.time.shape[1], len(paths.time) - 2
    for k in range(w - 1, -1, -1):
        before, share[k] = _instant(paths.time, windows.time[i, k], before + 1)
        if before < 0 or math.isnan(windows.bearing[i, k] + windows.site[i, k, 0] + windows.site[i, k, 1]):
            at[k] = -1
            return k + 1
        at[k] = before
    return 0


@bare_part
def _looked(first, count, row, windows, paths, rule, at, said, still, frame, room):  # type: ignore[no-untyped-def]
    """What the bearings of tracks `first` on say, whoever they are compared with.

    Args: at: (TRACKS, W) the instant before each bearing, -1 where a window ends; said: (TRACKS, W, 4) share of the instant after it, sine
    and cosine of the bearing, what a position error keeps of itself since the next newer bearing; still: (TRACKS,) whether all were taken
    from one place; frame: (TRACKS, 7) where the newest was taken from. All are written, and room, (4, W), is written over.
    """
    w = windows.time.shape[1]
    for t in range(count):
        i = row[first + t]
        oldest = _ending(i, windows, paths, at[t], room[0])
        if oldest == w:
            continue
        x, y, z, sp, cp, sl, cl = centred(windows.site[i, w - 1, 0], windows.site[i, w - 1, 1])
        frame[t, 0], frame[t, 1], frame[t, 2], frame[t, 3], frame[t, 4], frame[t, 5], frame[t, 6] = x, y, z, sp, cp, sl, cl
        still[t] = True
        for k in range(oldest, w):
            room[1, k], room[2, k] = sine_cosine((windows.bearing[i, k] - windows.bias[i]) * (180.0 / math.pi))
            newer = windows.time[i, min(k + 1, w - 1)]
            room[3, k] = exponential(-abs(newer - windows.time[i, k]) / rule.memory)
        for k in range(oldest, w):
            still[t] &= (
                windows.site[i, k, 0] == windows.site[i, w - 1, 0] and windows.site[i, k, 1] == windows.site[i, w - 1, 1]
            )
            said[t, k, 0], said[t, k, 1], said[t, k, 2], said[t, k, 3] = room[0, k], room[1, k], room[2, k], room[3, k]


@bare_part
def _begun(c, r, i, p, slot, windows, rule, x, number_of):  # type: ignore[no-untyped-def]
    """Pair p, of the track wanted as r, which is track i, and of the vessel in a slot, into lane c."""
    number_of[WANTED, c], number_of[TRACK, c], number_of[PAIR, c], number_of[SLOT, c], number_of[USED, c] = r, i, p, slot, 0
    x[VARIANCE, c], x[REACH, c] = windows.variance[i], windows.reach[i]
    x[OFFSET, c], x[ERROR, c], x[P00, c], x[P01, c], x[P11, c] = 0.0, 0.0, windows.bias_variance[i], 0.0, 1.0
    x[ODDS, c] = rule.odds - windows.density[i]
    x[MARGIN, c], x[WORST, c], x[WEIGHTS, c], x[WEIGHTED, c] = -np.inf, -np.inf, 0.0, 0.0


@bare_part
def _moved(of, to, x, number_of):  # type: ignore[no-untyped-def]
    """What is in one lane into another one."""
    for k in range(ROWS):
        x[k, to] = x[k, of]
    for k in range(NUMBERS):
        number_of[k, to] = number_of[k, of]


@bare_part
def _ended(c, windows, rule, x, number_of, gain, residual):  # type: ignore[no-untyped-def]
    """The pair in lane c is looked at no further."""
    i, p = number_of[TRACK, c], number_of[PAIR, c]
    gain[p], residual[p] = x[MARGIN, c], np.nan
    if number_of[USED, c] > 0:
        residual[p] = x[WEIGHTED, c] / x[WEIGHTS, c] + windows.bias[i]
    if x[MARGIN, c] >= rule.give_up:
        gain[p] += less_heard(x[WORST, c], rule.heard, rule.odds, windows.outside[i])


@bare_part
def _place(before, after, share, x, y, z, sp, cp, sl, cl):  # type: ignore[no-untyped-def]
    """East, north and standard deviation of a vessel between two instants, from a site. Args: before, after: addresses."""
    dx = (1.0 - share) * number(before) + share * number(after) - x  # type: ignore[call-arg]
    dy = (1.0 - share) * number(before + 8) + share * number(after + 8) - y
    dz = (1.0 - share) * number(before + 16) + share * number(after + 16) - z
    sigma = (1.0 - share) * number(before + 24) + share * number(after + 24)
    return cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy), sigma


@bare_part
def _stepped(c, first, windows, null, paths, rule, at, said, still, frame, x, number_of):  # type: ignore[no-untyped-def]
    """Lane c to its next step. Returns: whether there is one: a window ends with its bearings, with the path, and when it is given up."""
    i, s, used, w = number_of[TRACK, c], number_of[SLOT, c], number_of[USED, c], windows.time.shape[1]
    r = number_of[WANTED, c]
    t, k = r - first, w - 1 - used
    if (used > 0 and x[MARGIN, c] < rule.give_up) or k < 0 or s < 0:
        return False
    here = at[t, k]
    if here < 0 or s >= min(paths.slots[here], paths.slots[here + 1]):
        return False
    before, after = paths.table[here] + s * PLACE_BYTES, paths.table[here + 1] + s * PLACE_BYTES
    fetch(paths.table[max(here - 1, 0)] + s * PLACE_BYTES)  # type: ignore[call-arg]
    if still[t]:
        f = frame[t, 0], frame[t, 1], frame[t, 2], frame[t, 3], frame[t, 4], frame[t, 5], frame[t, 6]
    else:
        f = centred(windows.site[i, k, 0], windows.site[i, k, 1])
    east, north, sigma = _place(before, after, said[t, k, 0], *f)
    if math.isnan(east):
        return False
    distance = max(math.sqrt(east * east + north * north), NEAREST)
    if windows.arc_width[i] < 2.0 * math.pi:
        past = beyond(distance, math.atan2(east, north), windows.reach[i], windows.arc_from[i], windows.arc_width[i])
        x[WORST, c] = max(x[WORST, c], past / max(sigma, NEAREST))
    x[EAST, c], x[NORTH, c], x[SIGMA, c], x[DISTANCE, c] = east, north, sigma, distance
    x[SINE, c], x[COSINE, c], x[RHO, c], x[NULL, c] = said[t, k, 1], said[t, k, 2], said[t, k, 3], null[r, used + 1]
    number_of[USED, c] = used + 1
    return True


@bare_part
def _compared(m, x):  # type: ignore[no-untyped-def]
    """One bearing more: offset + h * error + noise, where the error has kept `rho` of itself since the bearing before."""
    for c in range((m + VECTOR - 1) // VECTOR * VECTOR):
        east, north, sigma, distance, rho, variance = (
            x[EAST, c],
            x[NORTH, c],
            x[SIGMA, c],
            x[DISTANCE, c],
            x[RHO, c],
            x[VARIANCE, c],
        )
        h = sigma / distance
        x[WORST, c] = max(x[WORST, c], (distance - x[REACH, c]) / max(sigma, NEAREST))
        difference = angle(x[SINE, c] * north - x[COSINE, c] * east, x[COSINE, c] * north + x[SINE, c] * east)
        offset, error, p00 = x[OFFSET, c], rho * x[ERROR, c], x[P00, c]
        p01, p11 = rho * x[P01, c], rho * rho * x[P11, c] + 1.0 - rho * rho
        g0, g1 = p00 + h * p01, p01 + h * p11
        s = g0 + h * g1 + variance
        v = difference - offset - h * error
        shrunk = 1.0 / s
        x[OFFSET, c], x[ERROR, c] = offset + g0 * shrunk * v, error + g1 * shrunk * v
        x[P00, c], x[P01, c], x[P11, c] = p00 - g0 * g0 * shrunk, p01 - g0 * g1 * shrunk, p11 - g1 * g1 * shrunk
        odds = x[ODDS, c] - 0.5 * (LOG_2PI + logarithm(s) + v * v * shrunk)
        x[ODDS, c], x[MARGIN, c] = odds, odds - x[NULL, c]
        weight = 1.0 / (variance + h * h)
        x[WEIGHTS, c] += weight
        x[WEIGHTED, c] += weight * difference


@bare_part
def _walked(first, count, row, start, slot, windows, null, paths, rule, at, said, still, frame, x, number_of, gain, residual):  # type: ignore[no-untyped-def]
    """The pairs of tracks `first` on, after `_looked`."""
    p, r, m = start[first], first, 0
    while True:
        c = 0
        while c < LANES:
            if c < m:
                if _stepped(c, first, windows, null, paths, rule, at, said, still, frame, x, number_of):
                    c += 1
                    continue
                _ended(c, windows, rule, x, number_of, gain, residual)
            if p < start[first + count]:
                while p >= start[r + 1]:
                    r += 1
                _begun(c, r, row[r], p, slot[p], windows, rule, x, number_of)
                for age in range(1, min(3, len(paths.table) + 1)):
                    ahead = slot[min(p + AHEAD, start[first + count] - 1)]
                    fetch(paths.table[len(paths.table) - age] + ahead * PLACE_BYTES)  # type: ignore[call-arg]
                p, m = p + 1, max(m, c + 1)
            elif c < m:
                m -= 1
                _moved(m, c, x, number_of)
            else:
                break
        if m == 0:
            break
        _compared(m, x)


@arithmetic
def known_vessels(low, high, row, start, slot, windows, null, paths, rule, gain, residual):  # type: ignore[no-untyped-def]
    """Log odds of each pair, vessel against unknown vessel, and the mean of its bearing differences.

    Differences are white noise, plus the across-range error of the vessel's position, correlated over `rule.memory` seconds,
    plus a constant offset with `bias_variance`. A window ends where the vessel's own path does, and with `give_up`.
    Args:
        low, high: of row (R,), the tracks that are wanted. start: (R + 1,) where the pairs of each begin. slot: (A,) of the vessel of each
        pair in the paths, -1 for none. windows: Windows. null: (R, W + 1) of `unknown_vessels`. paths: Paths. rule: Rule.
        gain: (A,) written; -inf where nothing could be compared. residual: the same, NaN where nothing could be compared.
    """
    w = windows.time.shape[1]
    x, number_of = np.empty((ROWS, LANES)), np.empty((NUMBERS, LANES), np.int64)
    at, said, frame = np.empty((TRACKS, w), np.int64), np.empty((TRACKS, w, 4)), np.empty((TRACKS, 7))
    still, room = np.empty(TRACKS, np.bool_), np.empty((4, w))
    for first in range(low, high, TRACKS):
        count = min(TRACKS, high - first)
        _looked(first, count, row, windows, paths, rule, at, said, still, frame, room)
        _walked(
            first, count, row, start, slot, windows, null, paths, rule, at, said, still, frame, x, number_of, gain, residual
        )
