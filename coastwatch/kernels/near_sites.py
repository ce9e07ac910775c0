"""Which of many places are near which of some sites: sites stand in cells of space, each place looks into one. By numba, over threads."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coastwatch.kernels.compiling import arithmetic, arithmetic_part, part
from coastwatch.kernels.earth_centred import ECCENTRICITY2, ROWS, SEMI_MAJOR, centred_rows, sine_cosine
from coastwatch.kernels.elementary import WHOLE
from coastwatch.kernels.threads import in_blocks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK_M = 1000.0  # a place that is known worse asks every site
MARGIN = 1.001  # of a distance in a straight line, over that in a tangent plane
BITS = 21  # of a coordinate of a cell: the Earth is 2^20 cells of 13 m across
SPREAD = -7046029254386353131  # 2^64 over the golden ratio: neighbours fall far apart
NOWHERE = np.zeros((0, 4, 4))


@arithmetic_part
def _along(x, cell_m):  # type: ignore[no-untyped-def]
    """The cell that a coordinate falls in: the nearest whole number, without a call."""
    return np.int64((x * (1.0 / cell_m) + WHOLE) - WHOLE) + (1 << (BITS - 1))


@part
def _cell(i, j, k):  # type: ignore[no-untyped-def]
    return (i << (2 * BITS)) | (j << BITS) | k


@part
def _place(cell, key):  # type: ignore[no-untyped-def]
    """Where a cell is in the table, or would be."""
    last = len(key) - 1
    at = ((cell * SPREAD) >> 20) & last
    while key[at] >= 0 and key[at] != cell:
        at = (at + 1) & last
    return at


@njit(cache=True, nogil=True)
def _entered(centre, cell_m, key, head, after):  # type: ignore[no-untyped-def]
    """Every site into its cell and the 26 around it. Args: key, head: all -1, longer than there are entries; after: (27 S,)."""
    count = 0
    for s in range(len(centre) - 1, -1, -1):
        x, y, z = _along(centre[s, 0], cell_m), _along(centre[s, 1], cell_m), _along(centre[s, 2], cell_m)
        for n in range(27):
            cell = _cell(x + n // 9 - 1, y + n // 3 % 3 - 1, z + n % 3 - 1)
            at = _place(cell, key)
            key[at] = cell
            after[count], head[at] = head[at], count
            count += 1


@arithmetic_part
def _centred(position, first, count, cell_m, lat_lon, place, cell):  # type: ignore[no-untyped-def]
    """Earth-centred places of rows first to first + count, and their cells."""
    for i in range(count):
        lat_lon[0, i], lat_lon[1, i] = position[first + i, 0], position[first + i, 1]
    for i in range(ROWS):
        sp, cp = sine_cosine(lat_lon[0, i])
        sl, cl = sine_cosine(lat_lon[1, i])
        r = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sp * sp)
        x, y, z = r * cp * cl, r * cp * sl, r * (1.0 - ECCENTRICITY2) * sp
        place[0, i], place[1, i], place[2, i] = x, y, z
        cell[i] = _cell(_along(x, cell_m), _along(y, cell_m), _along(z, cell_m))


@arithmetic
def _near(low, high, position, covariance, sigmas, centre, plane, reach, cell_m, key, head, after):  # type: ignore[no-untyped-def]
    """Rows low to high: the row and the site of each pair, (2, P), and east and north of the place from the site, (2, P)."""
    lat_lon, place, cell = np.zeros((2, ROWS)), np.empty((3, ROWS)), np.empty(ROWS, np.int64)
    out, off, count = np.empty((2, 1024), np.int64), np.empty((2, 1024)), 0
    for first in range(low, high, ROWS):
        rows = min(ROWS, high - first)
        _centred(position, first, rows, cell_m, lat_lon, place, cell)
        for i in range(rows):
            tolerance = 0.0
            if sigmas > 0.0:
                variance = 0.5 * (covariance[first + i, 0, 0] + covariance[first + i, 1, 1])
                tolerance = sigmas * math.sqrt(variance) if variance > 0.0 else 0.0
            x, y, z = place[0, i], place[1, i], place[2, i]
            asks_all = tolerance > SLACK_M
            at = 0 if asks_all else head[_place(cell[i], key)]
            while 0 <= at < len(centre) if asks_all else at >= 0:
                s = at if asks_all else at // 27
                s = s if asks_all else len(centre) - 1 - s
                dx, dy, dz = x - centre[s, 0], y - centre[s, 1], z - centre[s, 2]
                most = MARGIN * (reach[s] + tolerance)
                if dx * dx + dy * dy + dz * dz <= most * most:
                    if count == out.shape[1]:
                        out, off = np.concatenate((out, out), axis=1), np.concatenate((off, off), axis=1)
                    out[0, count], out[1, count] = first + i, s
                    sp, cp, sl, cl = plane[s]
                    off[0, count], off[1, count] = cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy)
                    count += 1
                at = at + 1 if asks_all else after[at]
    return out[:, :count].copy(), off[:, :count].copy()


def near_sites(
    position_deg: Floats, site_deg: Floats, reach_m: Floats, covariance: Floats = NOWHERE, sigmas: float = 0.0
) -> tuple[Ints, Ints, Floats]:
    """Pairs of a place and a site that are no farther apart than the reach of the site, and so many standard deviations of the place.

    None is left out; some are a thousandth of the reach too far.
    Args: position_deg: (V, 2); site_deg: (S, 2); reach_m: (S,); covariance: (V, 4, 4), not looked at where sigmas is 0; NaN: known exactly.
    Returns: (P,) rows of places and (P,) sites, sorted; (P, 2) metres east and north of the place in the tangent plane at the site.
    """
    if len(site_deg) == 0 or len(position_deg) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2))
    centre = np.ascontiguousarray(centred_rows(site_deg, np.arange(len(site_deg))).T)
    cell_m = MARGIN * (float(reach_m.max()) + SLACK_M)
    size = 1 << int(4 * 27 * len(centre)).bit_length()
    key, head, after = np.full(size, -1, np.int64), np.full(size, -1, np.int64), np.empty(27 * len(centre), np.int64)
    _entered(centre, cell_m, key, head, after)
    plane = np.column_stack([f(np.radians(site_deg[:, k])) for k in range(2) for f in (np.sin, np.cos)])
    asked = np.ascontiguousarray(position_deg), covariance, sigmas, centre, plane, reach_m, cell_m, key, head, after
    pairs, off = zip(*in_blocks(_near, len(position_deg), *asked), strict=True)
    row, site = np.concatenate(pairs, axis=1)
    return row, site, np.ascontiguousarray(np.concatenate(off, axis=1).T)
