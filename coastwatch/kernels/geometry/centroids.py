"""Which of many centroids is nearest to each of many points, exactly, from a guess; the means; and which borders a point is near.

A centroid that is nearer to a point than centroid k lies within twice the point's distance from k. So the points are laid in groups by
their guess, and each group is compared only with the centroids around its own, a whole group at a time: no list, no tree, no bound is
kept. The guess, threads and blocks decide how long it takes, never what comes out: of centroids at the same distance the first is
taken, what is near is measured in one form throughout, and sums are of whole parts of a metre, so that their order does not matter.
Source: J. Newling, F. Fleuret, Fast k-means with accurate bounds, 2016 (the exponion); groups instead of its bounds, because the
halo needs the look at the borders anyway.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.geometry.ellipsoid import ecef_of_rows
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.sorting import by_key, runs_by_key
from coastwatch.kernels.threads import in_blocks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 1e-3  # m: a centroid so close to being nearer is measured; rounding is a million times less
UNIT = 1024.0  # parts of a metre in sums
LEAST = 16  # groups a thread


class Laid(NamedTuple):
    """Points laid in groups, those of group k from start[k] to start[k + 1], in the order of rows."""

    row: Ints  # (N,) of each place
    start: Ints  # (K + 1,)
    points: Floats  # (3, N) Earth-centred
    box: Floats  # (K, 6) that holds each group: least x, y, z, greatest x, y, z


class Sweep(NamedTuple):
    """Centroids in the order of the axis along which they are spread most."""

    axis: int
    order: Ints  # (K,) centroids
    rank: Ints  # (K,) of each centroid

    @staticmethod
    def of(centre: Floats) -> Sweep:
        axis = int(np.argmax(np.ptp(centre, axis=0)))
        order = np.argsort(centre[:, axis], kind="stable")
        rank = np.empty(len(centre), np.int64)
        rank[order] = np.arange(len(centre))
        return Sweep(axis, order, rank)


@jit
def _boxes(low, high, points, start, out):  # type: ignore[no-untyped-def]
    for k in range(low, high):
        out[k, :3], out[k, 3:] = math.inf, -math.inf
        for i in range(start[k], start[k + 1]):
            x, y, z = points[0, i], points[1, i], points[2, i]
            out[k, 0], out[k, 1], out[k, 2] = min(out[k, 0], x), min(out[k, 1], y), min(out[k, 2], z)
            out[k, 3], out[k, 4], out[k, 5] = max(out[k, 3], x), max(out[k, 4], y), max(out[k, 5], z)


def lay(position: Floats, guess: Ints, count: int) -> Laid:
    """The points in groups by their guess. Args: position: (N, 2) latitude, longitude; guess: (N,) from 0 to count - 1."""
    row, start = by_key(guess, count)
    return _laid(row, start, np.ascontiguousarray(ecef_of_rows(position, row).T))


def _laid(row: Ints, start: Ints, points: Floats) -> Laid:
    box = np.empty((len(start) - 1, 6))
    in_blocks(_boxes, len(box), points, start, box, least=LEAST)
    return Laid(row, start, points, box)


@jit
def _seen(points, first, count, centre, k, seen, nearest):  # type: ignore[no-untyped-def]
    """Points of a group as seen from centroid k, and their squared distances, into `seen`; k is the nearest so far."""
    cx, cy, cz = centre[k, 0], centre[k, 1], centre[k, 2]
    for i in range(count):
        x, y, z = points[0, first + i] - cx, points[1, first + i] - cy, points[2, first + i] - cz
        seen[0, i], seen[1, i], seen[2, i] = x, y, z
        seen[3, i] = x * x + y * y + z * z
        nearest[i] = k


@jit
def _around(k, sweep, centre, box, margin, found, towards):  # type: ignore[no-untyped-def]
    """Other centroids whose border with k may be within the margin of a point in the box of group k.

    Args: found, towards: written: centroids; unit vector to each (nought where they are in one place) and half the distance.
    Returns: how many.
    """
    count, farthest = 0, 0.0
    low, high = box[k, :3] - centre[k], box[k, 3:] - centre[k]
    for axis in range(3):
        farthest += max(-low[axis], high[axis]) ** 2
    reach = 2.0 * (math.sqrt(farthest) + margin + SLACK)
    for step in (-1, 1):
        at = sweep.rank[k] + step
        while 0 <= at < len(centre):
            j = sweep.order[at]
            if abs(centre[j, sweep.axis] - centre[k, sweep.axis]) > reach:
                break
            at += step
            x, y, z = centre[j, 0] - centre[k, 0], centre[j, 1] - centre[k, 1], centre[j, 2] - centre[k, 2]
            gap2 = x * x + y * y + z * z
            ahead = max(x * low[0], x * high[0]) + max(y * low[1], y * high[1]) + max(z * low[2], z * high[2])
            gap = math.sqrt(gap2)
            if 0.5 * gap2 - ahead > (margin + SLACK) * gap:
                continue
            scale = 1.0 / gap if gap > 0.0 else 0.0
            found[count] = j
            towards[count, 0], towards[count, 1], towards[count, 2], towards[count, 3] = (
                x * scale,
                y * scale,
                z * scale,
                0.5 * gap,
            )
            count += 1
    return count


@jit
def _beyond(seen, count, towards, e, margin, beyond):  # type: ignore[no-untyped-def]
    """How far each point is this side of the border with a centroid; returns how many are within the margin of it, and how many
    not this side."""
    tx, ty, tz, half = towards[e, 0], towards[e, 1], towards[e, 2], towards[e, 3]
    near = nearer = 0
    for i in range(count):
        b = half - seen[0, i] * tx - seen[1, i] * ty - seen[2, i] * tz
        beyond[i] = b
        near += b <= margin
        nearer += b <= SLACK
    return near, nearer


@jit
def _nearer(points, first, count, centre, j, beyond, seen, nearest):  # type: ignore[no-untyped-def]
    """Where centroid j is nearer than the nearest so far, or as near and before it, it is the nearest."""
    for i in range(count):
        if beyond[i] <= SLACK:
            x, y, z = (
                points[0, first + i] - centre[j, 0],
                points[1, first + i] - centre[j, 1],
                points[2, first + i] - centre[j, 2],
            )
            d = x * x + y * y + z * z
            if d < seen[3, i] or (d == seen[3, i] and j < nearest[i]):
                seen[3, i], nearest[i] = d, j


@jit
def _add(seen, count, nearest, k, total):  # type: ignore[no-untyped-def]
    """Add the points of a group whose nearest centroid is its own to the total of centroid k."""
    sx = sy = sz = kept = np.int64(0)
    for i in range(count):
        own = np.int64(nearest[i] == k)
        kept += own
        sx += own * np.int64(seen[0, i] * UNIT)
        sy += own * np.int64(seen[1, i] * UNIT)
        sz += own * np.int64(seen[2, i] * UNIT)
    total[k, 0] += sx
    total[k, 1] += sy
    total[k, 2] += sz
    total[k, 3] += kept
    return kept


@jit
def _sums(low, high, points, start, box, centre, sweep):  # type: ignore[no-untyped-def]
    """Of the points of these groups, for the centroid nearest to each: the sum as seen from it, in parts of a metre, and how many."""
    room = np.max(start[low + 1 : high + 1] - start[low:high])
    seen, beyond, nearest = np.empty((4, room)), np.empty(room), np.empty(room, np.int64)
    found, towards = np.empty(len(centre), np.int64), np.empty((len(centre), 4))
    total = np.zeros((len(centre), 4), np.int64)
    for k in range(low, high):
        first, count = start[k], start[k + 1] - start[k]
        if count == 0:
            continue
        _seen(points, first, count, centre, k, seen, nearest)
        for e in range(_around(k, sweep, centre, box, 0.0, found, towards)):
            if _beyond(seen, count, towards, e, SLACK, beyond)[1] > 0:
                _nearer(points, first, count, centre, found[e], beyond, seen, nearest)
        if _add(seen, count, nearest, k, total) == count:
            continue
        for i in range(count):
            j = nearest[i]
            if j != k:
                for axis in range(3):
                    total[j, axis] += np.int64((points[axis, first + i] - centre[j, axis]) * UNIT)
                total[j, 3] += 1
    return total


def means(laid: Laid, centre: Floats) -> Floats:
    """The means of the points that are nearest to each centroid; one that has none stays. Args: centre: (K, 3). Returns: (K, 3)."""
    parts = in_blocks(_sums, len(centre), laid.points, laid.start, laid.box, centre, Sweep.of(centre), least=LEAST)
    total = np.sum(parts, axis=0)
    mean: Floats = centre + total[:, :3] / (UNIT * np.maximum(total[:, 3:], 1))
    return mean


@jit
def _longer(values, least):  # type: ignore[no-untyped-def]
    if least <= len(values):
        return values
    out = np.empty(2 * least, np.int64)
    for k in range(len(values)):  # an array assigned whole compiles for 5 s
        out[k] = values[k]
    return out


@jit
def _keep_own(first, k, nearest, run_size, low, high, place, at):  # type: ignore[no-untyped-def]
    """Take the points that are nearest to other centroids out of the runs of group k; returns where the runs now end."""
    read = at
    for run in range(low, high):
        begun, end = at, read + run_size[run]
        while read < end:
            place[at] = place[read]
            at += nearest[place[read] - first] == k
            read += 1
        run_size[run] = at - begun
    return at


@jit
def _divide(low, high, row, start, points, box, centre, sweep, margin, spot):  # type: ignore[no-untyped-def]
    """The nearest centroid of the points of these groups, into their rows of `spot`.

    Returns: of the points that are nearest to the centroid of their group those within the margin of a border, in runs: the centroid
    beyond it, how many, their rows; and the places of the other points.
    """
    room = np.max(start[low + 1 : high + 1] - start[low:high])
    seen, beyond, nearest = np.empty((4, room)), np.empty(room), np.empty(room, np.int64)
    found, towards = np.empty(len(centre), np.int64), np.empty((len(centre), 4))
    run_spot, run_size, place, moved = (
        np.empty(64, np.int64),
        np.empty(64, np.int64),
        np.empty(64, np.int64),
        np.empty(64, np.int64),
    )
    runs = halo = strangers = 0
    for k in range(low, high):
        first, count, run, begun, others = start[k], start[k + 1] - start[k], runs, halo, strangers
        if count == 0:
            continue
        _seen(points, first, count, centre, k, seen, nearest)
        for e in range(_around(k, sweep, centre, box, margin, found, towards)):
            near, nearer = _beyond(seen, count, towards, e, margin, beyond)
            if nearer > 0:
                _nearer(points, first, count, centre, found[e], beyond, seen, nearest)
            if near > 0:
                run_spot, run_size, place = (
                    _longer(run_spot, runs + 1),
                    _longer(run_size, runs + 1),
                    _longer(place, halo + count + 1),
                )
                run_spot[runs], run_size[runs] = found[e], near
                runs += 1
                for i in range(count):  # without a branch: what is not within the margin is written over
                    place[halo] = first + i
                    halo += beyond[i] <= margin
        moved = _longer(moved, strangers + count)
        for i in range(count):
            spot[row[first + i]] = nearest[i]
            moved[strangers] = first + i
            strangers += nearest[i] != k
        if strangers > others:
            halo = _keep_own(first, k, nearest, run_size, run, runs, place, begun)
    return run_spot[:runs], run_size[:runs], row[place[:halo]], moved[:strangers]


def divided(laid: Laid, centre: Floats, margin: float) -> tuple[Ints, Ints, Ints]:
    """The nearest centroid of each row, and every other centroid whose border with it lies within the margin of the point.

    Args: centre: (K, 3); margin: m. Returns: (N,) centroid of each row; (H,) centroid and (H,) row of the halo, sorted by centroid.
    """
    spot, sweep = np.empty(len(laid.row), np.int64), Sweep.of(centre)
    found: list[Any] = []
    while len(laid.row):
        parts = in_blocks(_divide, len(centre), *laid, centre, sweep, margin, spot, least=LEAST)
        found.extend(parts)
        moved = np.concatenate([part[3] for part in parts])
        by, start = by_key(spot[laid.row[moved]], len(centre))
        moved = moved[by]
        laid = _laid(laid.row[moved], start, np.take(laid.points, moved, axis=1))
    run_spot, run_size, row = (np.concatenate([np.zeros(0, np.int64), *(part[k] for part in found)]) for k in range(3))
    return spot, *runs_by_key(run_spot, run_size, row, len(centre))
