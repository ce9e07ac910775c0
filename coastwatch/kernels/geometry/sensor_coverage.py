"""Which of many places are near which of some sites: sites stand in cells of space, each place looks into one. By numba, over threads.

Most places of a national picture are near none: a mark for every cell of latitude and longitude that a site may reach leaves them out
before their cell of space is known, for the two sines of a place cost more than all the rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.geometry.ellipsoid import SEMI_MAJOR, SHORTEST_RADIUS, ecef_of_rows, sine_cosine
from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks
from coastwatch.kernels.vectorised_math import WHOLE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK_M = 1000.0  # a place that is known worse asks every site
MARGIN = 1.001  # of a distance in a straight line, over that in a tangent plane
BITS = 21  # of a coordinate of a cell: the Earth is 2^20 cells of 13 m across
SPREAD = -7046029254386353131  # 2^64 over the golden ratio: neighbours fall far apart
NOWHERE = np.zeros((0, 4, 4))
MARKS = 1 << 16  # they stay in the cache; a cell that shares the mark of another lets a few places through
MOST_COLUMNS = 7200  # of marked cells around the Earth
ROWS = 256  # at a time


@jit
def _along(x, cell_m):  # type: ignore[no-untyped-def]
    """The cell that a coordinate falls in: the nearest whole number, without a call."""
    return np.int64((x * (1.0 / cell_m) + WHOLE) - WHOLE) + (1 << (BITS - 1))


@jit
def _cell(i, j, k):  # type: ignore[no-untyped-def]
    return (i << (2 * BITS)) | (j << BITS) | k


@jit
def _place(cell, key):  # type: ignore[no-untyped-def]
    """Where a cell is in the table, or would be."""
    last = len(key) - 1
    at = ((cell * SPREAD) >> 20) & last
    while key[at] >= 0 and key[at] != cell:
        at = (at + 1) & last
    return at


@jit
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


@jit
def _mark(i, j, columns):  # type: ignore[no-untyped-def]
    """Where the mark is of a cell of row i, 0 at the South Pole, and column j, 0 at the antimeridian."""
    j = j if 0 <= j < columns else j % columns
    return (((i * columns + j) * SPREAD) >> 40) & (MARKS - 1)


@jit
def _marked(site, reach, columns, marks):  # type: ignore[no-untyped-def]
    """Marks every cell that has a place within reach of a site. Args: site: (S, 2); reach: (S,) m; marks: (MARKS,) False."""
    a_degree = columns / 360.0
    for s in range(len(site)):
        angle = math.degrees(math.asin(min(1.0, reach[s] / SHORTEST_RADIUS)))
        low, high = int(max(site[s, 0] - angle + 90.0, 0.0) * a_degree), int(min(site[s, 0] + angle + 90.0, 180.0) * a_degree)
        first, wide = 0, columns
        if abs(site[s, 0]) + angle < 89.0:
            around = math.degrees(math.asin(math.sin(math.radians(angle)) / math.cos(math.radians(site[s, 0]))))
            first, wide = math.floor((site[s, 1] - around + 180.0) * a_degree) - 1, int(2.0 * around * a_degree) + 4
        for i in range(max(low - 1, 0), high + 2):
            for j in range(first, first + min(wide, columns)):
                marks[_mark(i, j, columns)] = True


@jit
def _tolerance(covariance, row, sigmas):  # type: ignore[no-untyped-def]
    """So many standard deviations of a place, 0 where it has no covariance."""
    variance = 0.5 * (covariance[row, 0, 0] + covariance[row, 1, 1])
    return sigmas * math.sqrt(variance) if variance > 0.0 else 0.0


@jit
def _asking(first, high, position, covariance, sigmas, columns, marks, row):  # type: ignore[no-untyped-def]
    """Up to ROWS of the rows from `first` on that may be near a site, into `row`. Returns: how many, and where to go on."""
    a_degree, count, at = columns / 360.0, 0, first
    while at < high and count < ROWS:
        lat, lon = position[at, 0], position[at, 1]
        asks = True
        if abs(lat) <= 90.0 and abs(lon) <= 360.0:
            asks = marks[_mark(int((lat + 90.0) * a_degree), int((lon + 180.0) * a_degree + columns) - columns, columns)]
        if sigmas > 0.0:  # without asking whether it is needed: that is a guess which the processor gets wrong
            asks |= _tolerance(covariance, at, sigmas) > SLACK_M
        row[count] = at
        count, at = count + asks, at + 1
    return count, at


@jit
def _centred(position, row, count, cell_m, lat_lon, place, cell):  # type: ignore[no-untyped-def]
    """Earth-centred places of so many rows, and their cells."""
    for i in range(count):
        lat_lon[0, i], lat_lon[1, i] = position[row[i], 0], position[row[i], 1]
    for i in range(ROWS):
        sp, cp = sine_cosine(lat_lon[0, i])
        sl, cl = sine_cosine(lat_lon[1, i])
        r = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sp * sp)
        x, y, z = r * cp * cl, r * cp * sl, r * (1.0 - ECCENTRICITY2) * sp
        place[0, i], place[1, i], place[2, i] = x, y, z
        cell[i] = _cell(_along(x, cell_m), _along(y, cell_m), _along(z, cell_m))


@jit
def _paired(i, s, most, place, row, centre, plane, out, off, count):  # type: ignore[no-untyped-def]
    """A pair more, if the place is no farther than `most` metres from site s. Returns: how many pairs there are."""
    dx, dy, dz = place[0, i] - centre[s, 0], place[1, i] - centre[s, 1], place[2, i] - centre[s, 2]
    if not dx * dx + dy * dy + dz * dz <= most * most:
        return count
    out[0, count], out[1, count] = row[i], s
    sp, cp, sl, cl = plane[s, 0], plane[s, 1], plane[s, 2], plane[s, 3]
    off[0, count], off[1, count] = cl * dy - sl * dx, cp * dz - sp * (cl * dx + sl * dy)
    return count + 1


@jit
def _batch(i, rows, row, place, cell, covariance, sigmas, sites, table, out, off, count):  # type: ignore[no-untyped-def]
    """The pairs of rows i on, as long as there is room for those of one more. Returns: the row where to go on, how many pairs."""
    (centre, plane, reach), (key, head, after) = sites, table
    while i < rows and count + len(centre) <= out.shape[1]:
        tolerance = 0.0
        if sigmas > 0.0:
            tolerance = _tolerance(covariance, row[i], sigmas)
        if tolerance > SLACK_M:
            for s in range(len(centre)):
                most = MARGIN * (reach[s] + tolerance)
                count = _paired(i, s, most, place, row, centre, plane, out, off, count)
        else:
            at = head[_place(cell[i], key)]
            while at >= 0:
                s = len(centre) - 1 - at // 27
                most = MARGIN * (reach[s] + tolerance)
                count = _paired(i, s, most, place, row, centre, plane, out, off, count)
                at = after[at]
        i += 1
    return i, count


@jit
def _near(low, high, position, covariance, sigmas, sites, cell_m, columns, marks, table):  # type: ignore[no-untyped-def]
    """Rows low to high: the row and the site of each pair, (2, P), and east and north of the place from the site, (2, P)."""
    lat_lon, place, cell, row = np.zeros((2, ROWS)), np.empty((3, ROWS)), np.empty(ROWS, np.int64), np.empty(ROWS, np.int64)
    room, count = 1024 + len(sites[0]), 0
    out, off = np.empty((2, room), np.int64), np.empty((2, room))
    while low < high:
        rows, low = _asking(low, high, position, covariance, sigmas, columns, marks, row)
        _centred(position, row, rows, cell_m, lat_lon, place, cell)
        i = 0
        while True:
            i, count = _batch(i, rows, row, place, cell, covariance, sigmas, sites, table, out, off, count)
            if i == rows:
                break
            out, off = np.concatenate((out, out), axis=1), np.concatenate((off, off), axis=1)
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
    centre = ecef_of_rows(site_deg, np.arange(len(site_deg)))
    most_m = MARGIN * (reach_m + SLACK_M)
    cell_m, marks = float(most_m.max()), np.zeros(MARKS, np.bool_)
    columns = min(max(int(4.0 * np.pi * SHORTEST_RADIUS / cell_m), 8), MOST_COLUMNS)
    _marked(site_deg, most_m, columns, marks)
    size = 1 << int(4 * 27 * len(centre)).bit_length()
    key, head, after = np.full(size, -1, np.int64), np.full(size, -1, np.int64), np.empty(27 * len(centre), np.int64)
    _entered(centre, cell_m, key, head, after)
    plane = np.column_stack([f(np.radians(site_deg[:, k])) for k in range(2) for f in (np.sin, np.cos)])
    sites, table = (centre, plane, reach_m), (key, head, after)
    asked = np.ascontiguousarray(position_deg), covariance, sigmas, sites, cell_m, columns, marks, table
    pairs, off = zip(*in_blocks(_near, len(position_deg), *asked), strict=True)
    row, site = np.concatenate(pairs, axis=1)
    return row, site, np.ascontiguousarray(np.concatenate(off, axis=1).T)
