"""Rows in the order of a curve through their places: neighbours on the curve are neighbours at sea."""

import numpy as np

from coastwatch.kernels.jit import jit

SIDE = 256  # cells along each side of the box around all places


@jit
def _along(x, y):  # type: ignore[no-untyped-def]
    """Number of a cell along Hilbert's curve."""
    out = 0
    s = SIDE // 2
    while s > 0:
        right, up = 1 if x & s else 0, 1 if y & s else 0
        out += s * s * ((3 * right) ^ up)
        if up == 0:
            if right == 1:
                x, y = SIDE - 1 - x, SIDE - 1 - y
            x, y = y, x
        s //= 2
    return out


@jit
def _cell(value, low, scale):  # type: ignore[no-untyped-def]
    """Cell of a coordinate; 0 for what is no number."""
    at = (value - low) * scale
    return min(int(at), SIDE - 1) if at >= 0.0 else 0


@jit
def extent(place):  # type: ignore[no-untyped-def]
    """South, west, north, east of what is a number in (N, 2); NaN where nothing is."""
    south, west, north, east = np.nan, np.nan, np.nan, np.nan
    for i in range(len(place)):
        latitude, longitude = place[i, 0], place[i, 1]
        if not latitude >= south:
            south = latitude if latitude == latitude else south
        if not latitude <= north:
            north = latitude if latitude == latitude else north
        if not longitude >= west:
            west = longitude if longitude == longitude else west
        if not longitude <= east:
            east = longitude if longitude == longitude else east
    return south, west, north, east


@jit
def curve_order(place, out):  # type: ignore[no-untyped-def]
    """Rows along Hilbert's curve, those of one cell in their own order: a counting sort. Args: place: (N, 2); out: (N,) int64."""
    south, west, north, east = extent(place)
    per_row = SIDE / (north - south) if north > south else 0.0
    per_column = SIDE / (east - west) if east > west else 0.0
    start = np.zeros(SIDE * SIDE + 1, np.int64)
    cell = np.empty(len(place), np.int64)
    for i in range(len(place)):
        cell[i] = _along(_cell(place[i, 1], west, per_column), _cell(place[i, 0], south, per_row))
        start[cell[i] + 1] += 1
    for c in range(SIDE * SIDE):
        start[c + 1] += start[c]
    for i in range(len(place)):
        out[start[cell[i]]] = i
        start[cell[i]] += 1
