"""Which points lie near which centres: a sweep along the first axis, scalar code compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@jit
def _sweep(centre, radius, points, low, high, first, second):  # type: ignore[no-untyped-def]
    """Count the near pairs, and write them where there is room; points are sorted by the first axis."""
    count = 0
    for n in range(len(centre)):
        reach = radius[n] * radius[n]
        for m in range(low[n], high[n]):
            x, y = points[m, 0] - centre[n, 0], points[m, 1] - centre[n, 1]
            if x * x + y * y <= reach:
                if count < len(first):
                    first[count], second[count] = n, m
                count += 1
    return count


def near_pairs(centre: Floats, radius: Floats, points: Floats) -> tuple[Ints, Ints]:
    """Pairs of a centre and a point not farther from it than its radius, sorted by centre, then point.

    Args: centre: (N, 2); radius: (N,), not negative; points: (M, 2). All finite.
    Returns: (A,) rows of centres and (A,) rows of points.
    """
    order = np.argsort(points[:, 0], kind="stable")
    ordered = np.ascontiguousarray(points[order])
    low = np.searchsorted(ordered[:, 0], centre[:, 0] - radius, side="left")
    high = np.searchsorted(ordered[:, 0], centre[:, 0] + radius, side="right")
    first, second = np.empty(2 * len(centre) + 16, np.int64), np.empty(2 * len(centre) + 16, np.int64)
    inputs = np.ascontiguousarray(centre), np.ascontiguousarray(radius), ordered, low, high
    count = _sweep(*inputs, first, second)
    if count > len(first):
        first, second = np.empty(count, np.int64), np.empty(count, np.int64)
        _sweep(*inputs, first, second)
    first, second = first[:count], order[second[:count]]
    by = np.lexsort((second, first))
    return first[by], second[by]
