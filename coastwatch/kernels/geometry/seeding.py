"""Seeds of k-means by k-means++: points far from all seeds so far are likely the next. Scalar code compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 256  # points that are looked at, or passed over, together


@jit
def _boxes(points, box):  # type: ignore[no-untyped-def]
    for b in range(len(box)):
        for axis in range(3):
            part = points[axis, b * BLOCK : (b + 1) * BLOCK]
            box[b, axis], box[b, 3 + axis] = np.min(part), np.max(part)


@jit
def _toward(points, seed, label, far, nearest, first, last):  # type: ignore[no-untyped-def]
    """Points of a block that are nearer to the new seed are its own. Returns: sum and greatest of the squared distances."""
    x, y, z = points[0, seed], points[1, seed], points[2, seed]
    total, greatest = 0.0, 0.0
    for n in range(first, last):
        dx, dy, dz = points[0, n] - x, points[1, n] - y, points[2, n] - z
        d = dx * dx + dy * dy + dz * dz
        if d < far[n]:
            far[n], nearest[n] = d, label
        total += far[n]
        greatest = max(greatest, far[n])
    return total, greatest


@jit
def _drawn(draw, far, total):  # type: ignore[no-untyped-def]
    """The point at which this share of the sum of all squared distances is passed."""
    left = draw * np.sum(total)
    block = 0
    while block < len(total) - 1 and left >= total[block]:
        left -= total[block]
        block += 1
    n = block * BLOCK
    last = min(n + BLOCK, len(far)) - 1
    while n < last and left >= far[n]:
        left -= far[n]
        n += 1
    return n


@jit
def _seeds(points, draw, seed, nearest):  # type: ignore[no-untyped-def]
    count = points.shape[1]
    blocks = (count + BLOCK - 1) // BLOCK
    box, far = np.empty((blocks, 6)), np.full(count, np.inf)
    total, greatest = np.full(blocks, np.inf), np.full(blocks, np.inf)
    _boxes(points, box)
    for k in range(len(draw)):
        seed[k] = int(draw[0] * count) if k == 0 else _drawn(draw[k], far, total)
        for b in range(blocks):
            apart = 0.0
            for axis in range(3):
                at = points[axis, seed[k]]
                off = max(box[b, axis] - at, at - box[b, 3 + axis], 0.0)
                apart += off * off
            if apart < greatest[b]:
                last = min((b + 1) * BLOCK, count)
                total[b], greatest[b] = _toward(points, seed[k], k, far, nearest, b * BLOCK, last)


def seeds(points: Floats, draw: Floats) -> tuple[Ints, Ints]:
    """Which points are the seeds, and the nearest seed of each point.

    Args: points: (3, N), best in an order in which neighbours are near each other; draw: (K,) of uniform random numbers, K <= N.
    Returns: (K,) points, (N,) numbers of seeds.
    Source: D. Arthur, S. Vassilvitskii, k-means++: the advantages of careful seeding, 2007. A block of points is passed over where no
    point of it can be nearer to a new seed.
    """
    seed, nearest = np.empty(len(draw), np.int64), np.empty(points.shape[1], np.int64)
    _seeds(points, draw, seed, nearest)
    return seed, nearest
