"""One estimate from the tracks of each vessel: convex combination, covariance intersection, weighted average.

Scalar code compiled by numba, vessel by vessel: a covariance is read once where it stands and written once where it stays, and nothing
is allocated a vessel. What each computes stands beside it in `tests/contracts/fused_by_arrays.py`, in numpy.
Arguments that all of them take:
    start, row: the tracks of each vessel, of `counting_sort`.
    tracks: position (N, 2) degrees, velocity (N, 2), covariance (N, 4, 4), its lower triangle is read, and report_covariance (N, 2, 2),
        which stands in with `sigma` of the velocity where any number of a covariance is not finite.
    out: position (V, 2), velocity (V, 2), covariance (V, 4, 4): rows low to high are written.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.filters.symmetric4 import (
    determinant,
    inverse,
    less,
    lower,
    put,
    times,
    towards,
)
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch

RATIO = (math.sqrt(5.0) - 1.0) / 2.0
AHEAD = 24  # tracks: memory is asked for those of so many on, which vessels have scattered over it
FLAT = 1e-13  # of a determinant: what is left of it by rounding


@jit
def ask(tracks, row, at, end):  # type: ignore[no-untyped-def]
    """Asks memory for what will be read of the tracks at `at` to `end` in AHEAD tracks' time."""
    for k in range(at + AHEAD, min(end + AHEAD, len(row))):
        fetch(tracks[0], row[k])
        fetch(tracks[1], row[k])
        fetch(tracks[2], row[k])


@jit
def _complete(covariance, n):  # type: ignore[no-untyped-def]
    """Whether every number of one of (N, 4, 4) is finite."""
    c = covariance
    upper = (c[n, 0, 0] + c[n, 0, 1]) + (c[n, 0, 2] + c[n, 0, 3]) + ((c[n, 1, 0] + c[n, 1, 1]) + (c[n, 1, 2] + c[n, 1, 3]))
    under = (c[n, 2, 0] + c[n, 2, 1]) + (c[n, 2, 2] + c[n, 2, 3]) + ((c[n, 3, 0] + c[n, 3, 1]) + (c[n, 3, 2] + c[n, 3, 3]))
    return 0.0 * (upper + under) == 0.0


@jit
def known(tracks, n, sigma):  # type: ignore[no-untyped-def]
    """The covariance of a track; that of one report and of a velocity known to sigma where the source gives none."""
    if _complete(tracks[2], n):
        return lower(tracks[2], n)
    report, var = tracks[3], sigma * sigma
    return report[n, 0, 0], report[n, 1, 0], report[n, 1, 1], 0.0, 0.0, var, 0.0, 0.0, 0.0, var


@jit
def alone(tracks, n, sigma, out, v):  # type: ignore[no-untyped-def]
    """A vessel of one track is that track, to the bit where it has a covariance."""
    out[0][v, 0], out[0][v, 1] = tracks[0][n, 0], tracks[0][n, 1]
    out[1][v, 0], out[1][v, 1] = tracks[1][n, 0], tracks[1][n, 1]
    if _complete(tracks[2], n):
        for i in range(4):
            for j in range(4):
                out[2][v, i, j] = tracks[2][n, i, j]
    else:
        put(known(tracks, n, sigma), out[2], v)


@jit
def _doubted(a, share, report):  # type: ignore[no-untyped-def]
    """A covariance with a share of that of a report added to the place."""
    return (
        a[0] + share * report[0, 0],
        a[1] + share * report[1, 0],
        a[2] + share * report[1, 1],
        a[3],
        a[4],
        a[5],
        a[6],
        a[7],
        a[8],
        a[9],
    )


@jit
def read(tracks, n, sigma, doubt):  # type: ignore[no-untyped-def]
    """What a track is weighed with."""
    a = known(tracks, n, sigma)
    if doubt[0] > 0.0 and doubt[1][n] < 0:
        return _doubted(a, doubt[0], tracks[3][n])
    return a


@jit
def precise_first(tracks, sigma, doubt, row, begin, end, order, size):  # type: ignore[no-untyped-def]
    """The rows of a vessel into `order`, the smallest determinant first, equal ones as they come; `size` is to work in."""
    for k in range(end - begin):
        n = row[begin + k]
        now = determinant(read(tracks, n, sigma, doubt))
        at = k
        while at > 0 and size[at - 1] > now:
            order[at], size[at] = order[at - 1], size[at - 1]
            at -= 1
        order[at], size[at] = n, now


@jit
def _moved(tracks, n, place, speed):  # type: ignore[no-untyped-def]
    """A track less a place (lat, lon) and a speed: east, north, east rate, north rate."""
    position, velocity = tracks[0], tracks[1]
    east, north = enu_offset(position[n, 0], position[n, 1], place[0], place[1])
    return east, north, velocity[n, 0] - speed[0], velocity[n, 1] - speed[1]


@jit
def _write(place, speed, covariance, out, v):  # type: ignore[no-untyped-def]
    out[0][v, 0], out[0][v, 1] = place[0], place[1]
    out[1][v, 0], out[1][v, 1] = speed[0], speed[1]
    put(covariance, out[2], v)


@jit
def _best_share(b, change, steps):  # type: ignore[no-untyped-def]
    """The share w of the first at which det(B + w (A - B)) of the inverses is largest, by golden section; a half where all are alike."""
    nothing, half, all_of_it = determinant(b), determinant(towards(b, change, 0.5)), determinant(towards(b, change, 1.0))
    if abs(half - nothing) <= FLAT * half and abs(half - all_of_it) <= FLAT * half:
        return 0.5
    low, high = 0.0, 1.0
    left, right = 1.0 - RATIO, RATIO
    at_left, at_right = determinant(towards(b, change, left)), determinant(towards(b, change, right))
    for _ in range(steps):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - RATIO * (high - low)
            at_left = determinant(towards(b, change, left))
        else:
            low, left, at_left = left, right, at_right
            right = low + RATIO * (high - low)
            at_right = determinant(towards(b, change, right))
    middle = 0.5 * (low + high)
    best = determinant(towards(b, change, middle))
    if nothing > best:
        return 0.0 if all_of_it <= nothing else 1.0
    return 1.0 if all_of_it > best else middle


@jit
def _intersected(a, b, shift, steps):  # type: ignore[no-untyped-def]
    """Mean relative to the first and covariance of the intersection of two estimates whose determinant is smallest."""
    first, second = inverse(a), inverse(b)
    w = _best_share(second, less(first, second), steps)
    if w == 1.0:
        return (0.0, 0.0, 0.0, 0.0), a
    out = inverse(towards(second, less(first, second), w))
    x = times(second, shift)
    left = 1.0 - w
    return times(out, (left * x[0], left * x[1], left * x[2], left * x[3])), out


@jit
def intersection(low, high, which, start, row, tracks, sigma, steps, out):  # type: ignore[no-untyped-def]
    """Vessels which[low:high] by covariance intersection, the most precise track first. Args: steps: of the search of the weight.

    Their rows of `out` are written.
    """
    most = 1
    for k in range(low, high):
        most = max(most, start[which[k] + 1] - start[which[k]])
    _intersection(low, high, which, start, row, tracks, sigma, steps, np.empty(most, np.int32), np.empty(most), out)


@jit
def _intersection(low, high, which, start, row, tracks, sigma, steps, order, size, out):  # type: ignore[no-untyped-def]
    """The same with room to work in, `order` and `size`."""
    doubt = (0.0, row)
    for v in range(low, high):
        begin, end = start[which[v]], start[which[v] + 1]
        ask(tracks, row, begin, end)
        if end - begin == 1:
            alone(tracks, row[begin], sigma, out, which[v])
            continue
        precise_first(tracks, sigma, doubt, row, begin, end, order, size)
        n = order[0]
        place, speed = (tracks[0][n, 0], tracks[0][n, 1]), (tracks[1][n, 0], tracks[1][n, 1])
        covariance = known(tracks, n, sigma)
        for k in range(1, end - begin):
            n = order[k]
            mean, covariance = _intersected(covariance, known(tracks, n, sigma), _moved(tracks, n, place, speed), steps)
            place, speed = add_enu_offset(place[0], place[1], mean[0], mean[1]), (speed[0] + mean[2], speed[1] + mean[3])
        _write(place, speed, covariance, out, which[v])
