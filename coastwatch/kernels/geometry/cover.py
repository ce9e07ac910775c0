"""Whether places are within range of any of many sites: the Earth in cells, each wholly in range, or with the sites to be asked.

Scalar code compiled by numba. A place is within range where its distance in the tangent plane at the site is, as in
`coastwatch.geodesy.within_any`.
"""

from __future__ import annotations

import math

from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, SHORTEST_RADIUS, ecef_and_axes
from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch

CELLS = 10  # a degree
ROWS, COLUMNS = 180 * CELLS, 360 * CELLS
RADIUS = 1.001 * SEMI_MAJOR * DEGREE * math.sqrt(0.5) / CELLS  # of a cell about its centre, no cell is wider
WITHIN = -1  # of a cell: all of it is in range


@jit
def framed(site, reach, out):  # type: ignore[no-untyped-def]
    """Sites (R, 2) in degrees and their ranges as `in_range` takes them, into `out` (R, 9)."""
    for k in range(len(site)):
        x, y, z, sp, cp, sl, cl = ecef_and_axes(site[k, 0], site[k, 1])
        out[k, 0], out[k, 1], out[k, 2] = x, y, z
        out[k, 3], out[k, 4], out[k, 5], out[k, 6] = sp, cp, sl, cl
        out[k, 7], out[k, 8] = site[k, 0], reach[k]


@jit
def _cell(lat, lon):  # type: ignore[no-untyped-def]
    """The number of the cell of a place."""
    return min(max(int((lat + 90.0) * CELLS), 0), ROWS - 1) * COLUMNS + int((lon + 180.0) * CELLS) % COLUMNS


@jit
def ask(lat, lon, head):  # type: ignore[no-untyped-def]
    """Asks memory for the cell of a place that will be looked up."""
    fetch(head, _cell(lat, lon))


@jit
def _block(site, reach):  # type: ignore[no-untyped-def]
    """First and last row, first column and number of columns of the cells that may be in range of a site."""
    angle = math.asin(min(1.0, reach / SHORTEST_RADIUS)) + 0.02 * DEGREE
    low = max(int((site[0] - angle / DEGREE + 90.0) * CELLS) - 1, 0)
    high = min(int((site[0] + angle / DEGREE + 90.0) * CELLS) + 1, ROWS - 1)
    if abs(site[0]) * DEGREE + angle >= 0.5 * math.pi - 0.01:
        return low, high, 0, COLUMNS
    wide = math.asin(math.sin(angle) / math.cos(site[0] * DEGREE)) / DEGREE
    first = math.floor((site[1] - wide + 180.0) * CELLS) - 1
    return low, high, first, min(int(2.0 * wide * CELLS) + 4, COLUMNS)


@jit
def cells(site, reach, frame, head, entry):  # type: ignore[no-untyped-def]
    """Enters every site into the cells that it may reach.

    Args: site: (R, 2); reach: (R,); frame: of `framed`.
        head: (ROWS * COLUMNS,) all 0: WITHIN, or the number of the cell's last entry: written; entry: (E, 2) the site and the number of
        the entry before it: written as far as it goes.
    Returns: how many entries there are; more than E: nothing is right yet, and a longer list is needed.
    """
    count = 0
    for k in range(len(site)):
        low, high, first, wide = _block(site[k], reach[k])
        for i in range(low, high + 1):
            for j in range(first, first + wide):
                cell = i * COLUMNS + j % COLUMNS
                x, y, z, _, _, _, _ = ecef_and_axes((i + 0.5) / CELLS - 90.0, (j + 0.5) / CELLS - 180.0)
                away = math.sqrt((x - frame[k, 0]) ** 2 + (y - frame[k, 1]) ** 2 + (z - frame[k, 2]) ** 2)
                least = max(away - RADIUS, 0.0)
                seen = least * math.sqrt(max(1.0 - 0.25 * (least / SHORTEST_RADIUS) ** 2, 0.0))
                if head[cell] == WITHIN or seen > 1.001 * reach[k]:
                    continue
                if away + RADIUS <= reach[k]:
                    head[cell] = WITHIN
                    continue
                count += 1
                if count < len(entry):
                    entry[count, 0], entry[count, 1] = k, head[cell]
                    head[cell] = count
    return count


@jit
def in_range(lat, lon, frame, head, entry):  # type: ignore[no-untyped-def]
    """Whether a place is within range of any site. Args: degrees; frame, head, entry: of `framed` and `cells`."""
    at = head[_cell(lat, lon)]
    if at <= 0:
        return at == WITHIN
    x, y, z, _, _, _, _ = ecef_and_axes(lat, lon)
    while at > 0:
        k = entry[at, 0]
        dx, dy, dz, reach = x - frame[k, 0], y - frame[k, 1], z - frame[k, 2], frame[k, 8]
        east = frame[k, 6] * dy - frame[k, 5] * dx
        north = frame[k, 4] * dz - frame[k, 3] * (frame[k, 6] * dx + frame[k, 5] * dy)
        near = abs(lat - frame[k, 7]) * 110_000.0 <= 1.02 * reach + 100.0
        if near and math.sqrt(east * east + north * north) <= reach:
            return True
        at = entry[at, 1]
    return False


@jit
def all_in_range(low, high, position, frame, head, entry, out):  # type: ignore[no-untyped-def]
    """`in_range` of places low to high of (V, 2), into `out` (V,)."""
    for v in range(low, high):
        out[v] = in_range(position[v, 0], position[v, 1], frame, head, entry)
