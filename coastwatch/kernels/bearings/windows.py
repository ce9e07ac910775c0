"""What windows of bearings say, whoever they are compared with, and which vessels their newest bearings rule out. Compiled by numba.

A window is walked from the newest bearing back. Its steps are counted from the newest, and end where there is no bearing, or no instant of
the paths before and after it: a step without slots stands there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.association.history import number
from coastwatch.kernels.bearings.null_hypothesis import LOG_2PI
from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes, sine_cosine
from coastwatch.kernels.jit import jit
from coastwatch.kernels.vectorised_math import exponential

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLACES = 4  # numbers of a vessel at an instant: Earth-centred position, standard deviation per axis
PLACE_BYTES = 8 * PLACES
LANES, VECTOR = 64, 8  # pairs at once, and what is computed in one go
SHARE, SINE, COSINE, RHO, NULL, SAID = range(6)  # of a step: `looked`
BEFORE, AFTER, SLOTS, WHERE = range(4)  # of a step: addresses of two arrays of the paths, and how many bytes of both there are
CLEAR = 1e-6  # log odds by which a pair must be ruled out by a bound: rounding is a million times less
ASIDE, ROOM = 2 * PLACES, 2 * PLACES + 1  # of a lane: `_aside`; its vessel at the instants before and after


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


@jit
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


@jit
def _steps(i, first, windows, paths, said, where):  # type: ignore[no-untyped-def]
    """The instants around each bearing of track i, into the steps from `first` on. Returns: how many steps there are."""
    w, before = windows.time.shape[1], len(paths.time) - 2
    for n in range(w):
        k = w - 1 - n
        before, share = _instant(paths.time, windows.time[i, k], before + 1)
        if before < 0 or math.isnan(windows.bearing[i, k] + windows.site[i, k, 0] + windows.site[i, k, 1]):
            where[first + n, BEFORE], where[first + n, SLOTS] = 0, 0
            return n
        said[first + n, SHARE] = share
        where[first + n, BEFORE], where[first + n, AFTER] = paths.table[before], paths.table[before + 1]
        where[first + n, SLOTS] = PLACE_BYTES * min(paths.slots[before], paths.slots[before + 1])
    where[first + w, BEFORE], where[first + w, SLOTS] = 0, 0
    return w


@jit
def looked(first, count, row, windows, null, paths, rule, said, where, still, frame, room):  # type: ignore[no-untyped-def]
    """What the bearings of tracks `first` on say.

    Args: null: of `unknown_vessels`; said: (count * (W + 1), SAID) of each step: share of the instant after it, sine and cosine of the
    bearing, what a position error keeps of itself since the next newer bearing, log density of an unknown vessel so far; where: (count *
    (W + 1), WHERE); still: (count,) whether all were taken from one place; frame: (count, 7) where the newest was taken from. All are
    written, and room, (3, W), is written over.
    """
    w = windows.time.shape[1]
    for t in range(count):
        i, at = row[first + t], t * (w + 1)
        steps = _steps(i, at, windows, paths, said, where)
        still[t] = True
        if steps == 0:
            continue
        x, y, z, sp, cp, sl, cl = ecef_and_axes(windows.site[i, w - 1, 0], windows.site[i, w - 1, 1])
        frame[t, 0], frame[t, 1], frame[t, 2], frame[t, 3], frame[t, 4], frame[t, 5], frame[t, 6] = x, y, z, sp, cp, sl, cl
        for n in range(steps):
            k = w - 1 - n
            room[0, n] = (windows.bearing[i, k] - windows.bias[i]) * (180.0 / math.pi)
            room[2, n] = -abs(windows.time[i, min(k + 1, w - 1)] - windows.time[i, k]) / rule.memory
        for n in range(steps):
            room[0, n], room[1, n] = sine_cosine(room[0, n])
            room[2, n] = exponential(room[2, n])
        for n in range(steps):
            k = w - 1 - n
            still[t] &= (
                windows.site[i, k, 0] == windows.site[i, w - 1, 0] and windows.site[i, k, 1] == windows.site[i, w - 1, 1]
            )
            said[at + n, SINE], said[at + n, COSINE], said[at + n, RHO] = room[0, n], room[1, n], room[2, n]
            said[at + n, NULL] = null[first + t, n + 1]


@jit
def gathered(before, after, c, x):  # type: ignore[no-untyped-def]
    """A vessel at two instants into lane c of the first rows of x. Args: before, after: addresses."""
    x[0, c], x[1, c], x[2, c], x[3, c] = number(before), number(before + 8), number(before + 16), number(before + 24)  # type: ignore[call-arg]
    x[4, c], x[5, c], x[6, c], x[7, c] = number(after), number(after + 8), number(after + 16), number(after + 24)


@jit
def _aside(m, share, sine, cosine, frame, least, most, x):  # type: ignore[no-untyped-def]
    """Into ASIDE, more than nought where a vessel lies so far beside the bearing that it cannot be of it.

    What is left of the bearing is no less than the sine of the angle between; its variance, `least` and that of the place across.
    """
    x0, y0, z0, sp, cp, sl, cl = frame
    for c in range((m + VECTOR - 1) // VECTOR * VECTOR):
        dx = (1.0 - share) * x[0, c] + share * x[4, c] - x0
        dy = (1.0 - share) * x[1, c] + share * x[5, c] - y0
        dz = (1.0 - share) * x[2, c] + share * x[6, c] - z0
        sigma = (1.0 - share) * x[3, c] + share * x[7, c]
        east, north = cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy)
        across = sine * north - cosine * east
        x[ASIDE, c] = across * across - most * (least * (east * east + north * north) + sigma * sigma)


@jit
def sifted(first, count, row, start, slot, windows, rule, said, where, frame, kept, gain, residual):  # type: ignore[no-untyped-def]
    """The pairs of tracks `first` on that their newest bearing alone does not bring under `rule.give_up`, and those without any bearing.

    Args: start, slot, gain, residual: as in `known_vessels`; the others are written as for a pair that is given up. said, where, frame: of
    `looked`. kept: (A, 2) the track, from 0 on, and the pair: written. Returns: how many.
    """
    x, found, w = np.empty((ROOM, LANES)), 0, windows.time.shape[1]
    for t in range(count):
        r, at = first + t, t * (w + 1)
        place = frame[t, 0], frame[t, 1], frame[t, 2], frame[t, 3], frame[t, 4], frame[t, 5], frame[t, 6]
        least = windows.variance[row[r]] + windows.bias_variance[row[r]]
        odds = rule.odds - windows.density[row[r]] - said[at, NULL] - rule.give_up + CLEAR
        most = max(2.0 * odds - LOG_2PI - math.log(least), 0.0)
        for base in range(start[r], start[r + 1], LANES):
            m = min(LANES, start[r + 1] - base)
            for c in range(m):
                at_byte = slot[base + c] * PLACE_BYTES
                x[0, c] = np.nan
                if 0 <= at_byte < where[at, SLOTS]:
                    gathered(where[at, BEFORE] + at_byte, where[at, AFTER] + at_byte, c, x)
            _aside(m, said[at, SHARE], said[at, SINE], said[at, COSINE], place, least, most, x)
            for c in range(m):
                gain[base + c], residual[base + c] = rule.give_up - 1.0, np.nan
                kept[found, 0], kept[found, 1] = t, base + c
                found += not x[ASIDE, c] > 0.0
    return found
