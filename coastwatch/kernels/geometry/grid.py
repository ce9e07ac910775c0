"""A grid of square cells over uncertain points: which of them may lie in an ellipse. Scalar code, compiled by numba.

Points are sorted by cell, so the points of neighbouring cells of one row of the grid are consecutive. A grid has layers: a few points
that are far less certain than most have layers of their own, and do not widen the search for the others.

Source: C. Ericson, Real-Time Collision Detection, 2005, section 7.1 (uniform grids) and 7.2 (hierarchical grids: one a size of objects).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Rows
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import counting_sort

LAYERS = 3
MOST_SIDE_M = 1e8
WIDER = 3.0  # times the mean standard deviation, at which a layer ends: at 1 and at 3 times


class Grid(NamedTuple):
    """Points in cells."""

    low: tuple[float, float]  # corner; points beyond a side are in the cells along it
    side: float  # of a cell
    columns: int
    rows: int
    start: Rows  # (LAYERS rows columns + 1,) first point of each cell
    point: Rows  # (N,) rows of the points, sorted by layer and cell
    position: Floats  # (N, 2) of the sorted points
    variance: Floats  # (LAYERS,) largest of the layer
    drift: Floats  # (LAYERS,) largest of the layer


@jit
def _cell(value, low, side, count):  # type: ignore[no-untyped-def]
    """Column or row of a coordinate, on the edge where it is beyond it; the first where it is no number."""
    at = (value - low) / side
    if not at > 0.0:
        return 0
    return count - 1 if at >= count - 1.0 else int(at)


@jit
def build(position, sigma, drift, low, high):  # type: ignore[no-untyped-def]
    """The grid of points, about one a cell.

    Args: position: (N, 2); sigma: (N,) standard deviation along any axis, at most; drift: (N,) how far the point may have moved from its
    position; low, high: opposite corners of the area, (east, north) each.
    """
    n = len(position)
    width, height = max(high[0] - low[0], 1.0), max(high[1] - low[1], 1.0)
    if not width + height < MOST_SIDE_M:
        width, height = MOST_SIDE_M, MOST_SIDE_M  # also where a corner is no number
    side = max(math.sqrt(width * height / max(n, 1)), max(width, height) / max(n, 1))
    columns, rows = int(width / side) + 1, int(height / side) + 1
    mean = 0.0
    for k in range(n):
        mean += sigma[k] / n
    group = np.empty(n, np.int64)
    variance, moved = np.zeros(LAYERS), np.zeros(LAYERS)
    for k in range(n):
        layer = 0 if sigma[k] <= mean else (1 if sigma[k] <= WIDER * mean else 2)
        variance[layer] = max(variance[layer], sigma[k] * sigma[k])
        moved[layer] = max(moved[layer], drift[k])
        row, column = _cell(position[k, 1], low[1], side, rows), _cell(position[k, 0], low[0], side, columns)
        group[k] = (layer * rows + row) * columns + column
    start, point = counting_sort(group, LAYERS * rows * columns)
    ordered = np.empty((n, 2))
    for k in range(n):
        ordered[k, 0], ordered[k, 1] = position[point[k], 0], position[point[k], 1]
    return Grid(low, side, columns, rows, start, point, ordered, variance, moved)


@jit
def near(grid, centre, covariance, limit):  # type: ignore[no-untyped-def]
    """For each ellipse the points that may lie in it: all that do, and a few more.

    A point p with covariance P lies in the ellipse (c, R) if (p - c)' (P + R)^-1 (p - c) <= limit, with P at most variance I, and p
    moved by the drift at most.
    Args: centre: (M, 2); covariance: (M, 2, 2); limit: squared distance. Returns: start (M + 1,), point (A,): those of ellipse m are
    point[start[m]:start[m + 1]].
    """
    start, point, count = np.empty(len(centre) + 1, np.int64), np.empty(4 * len(centre) + 16, np.int32), 0
    for m in range(len(centre)):
        start[m] = count
        east, north = centre[m, 0], centre[m, 1]
        for layer in range(LAYERS):
            variance, drift = grid.variance[layer], grid.drift[layer]
            if variance == 0.0:
                continue
            s_ee, s_nn = covariance[m, 0, 0] + variance, covariance[m, 1, 1] + variance
            slope = covariance[m, 1, 0] / s_nn  # mean of east for each metre north
            half = math.sqrt(limit * max(s_ee - slope * covariance[m, 1, 0], 0.0)) + drift * (1.0 + abs(slope))
            reach_e, reach_n = math.sqrt(limit * s_ee) + drift, math.sqrt(limit * s_nn) + drift
            first = _cell(north - reach_n, grid.low[1], grid.side, grid.rows)
            last = _cell(north + reach_n, grid.low[1], grid.side, grid.rows)
            for row in range(first, last + 1):
                below, above = -reach_n, reach_n  # edges of this row, as seen from the centre
                if row > first:
                    below = max(below, grid.low[1] + row * grid.side - north)
                if row < last:
                    above = min(above, grid.low[1] + (row + 1) * grid.side - north)
                left = max(min(slope * below, slope * above) - half, -reach_e)
                right = min(max(slope * below, slope * above) + half, reach_e)
                cells = (layer * grid.rows + row) * grid.columns
                a = cells + _cell(east + left, grid.low[0], grid.side, grid.columns)
                b = cells + _cell(east + right, grid.low[0], grid.side, grid.columns)
                for k in range(grid.start[a], grid.start[b + 1]):
                    e, n = grid.position[k, 0] - east, grid.position[k, 1] - north
                    if abs(n) <= reach_n and abs(e) <= reach_e and abs(e - slope * n) <= half:
                        if count == len(point):
                            point = np.append(point, np.empty_like(point))
                        point[count] = grid.point[k]
                        count += 1
    start[len(centre)] = count
    return start, point[:count]
