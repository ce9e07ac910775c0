"""Candidate pairs of bearing tracks and vessels by octant, the 45 degree sector of a sensor. An octant is sensor * 8 + sector."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.geodesy import wrap_deg

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SECTORS = 8
SECTOR_DEG = 360.0 / SECTORS


def sector_of(direction_deg: Floats) -> Ints:
    """The sector, 0 to 7 clockwise from north, of each direction; a border belongs to the sector that begins there."""
    return np.floor(direction_deg / SECTOR_DEG).astype(np.int64) % SECTORS


def vessels_by_octant(
    direction_deg: Floats, tolerance_deg: Floats, sensor: Ints, vessel_row: Ints, sensors: int
) -> tuple[Ints, Ints]:
    """The vessels of each octant: those in it, and those no farther outside than their tolerance.

    Args: direction_deg, tolerance_deg, sensor, vessel_row: (H,) a vessel seen from a sensor, sorted by vessel_row; sensors: K.
    Returns: (8 K + 1,) where each octant begins; (G,) its vessel rows, sorted.
    """
    sector = np.arange(SECTORS)
    outside = np.abs(wrap_deg(direction_deg[:, None] - (sector + 0.5) * SECTOR_DEG)) - 0.5 * SECTOR_DEG
    h, inside = np.nonzero((outside <= tolerance_deg[:, None]) | (sector == sector_of(direction_deg)[:, None]))
    octant = SECTORS * sensor[h] + inside
    order = np.argsort(octant, kind="stable")
    start = np.searchsorted(octant[order], np.arange(SECTORS * sensors + 1))
    return start.astype(np.int64), vessel_row[h[order]]


def ranges(first: Ints, count: Ints) -> Ints:
    """The numbers first[k], first[k] + 1, ... of which there are count[k], of all k one after the other."""
    return np.asarray(np.arange(count.sum()) + np.repeat(first - (np.cumsum(count) - count), count))


def pairs_of_tracks(octant: Ints, start: Ints, vessel_row: Ints) -> tuple[Ints, Ints]:
    """Each track with all vessels of its octant. Args: octant: (N,) of each track; start, vessel_row: of `vessels_by_octant`.

    Returns: (A,) tracks, sorted; (A,) vessel rows, sorted within a track.
    """
    count = start[octant + 1] - start[octant]
    return np.repeat(np.arange(len(octant)), count), vessel_row[ranges(start[octant], count)]


def tracks_by_octant(bearing_row: Ints, octant: Ints) -> tuple[Ints, Ints]:
    """The tracks of each octant that has pairs. Args: (A,) sorted pairs. Returns: (T,) rows; (O + 1,) where each octant begins."""
    row, first_pair = np.unique(bearing_row, return_index=True)
    order = np.argsort(octant[first_pair], kind="stable")
    _, start = np.unique(octant[first_pair][order], return_index=True)
    return row[order], np.append(start, len(row)).astype(np.int64)


def median_of_groups(group: Ints, value: Floats, groups: int) -> tuple[Ints, Floats]:
    """How many values each group has, and their median, NaN for none. Args: (A,) 0 to groups - 1, (A,). Returns: (groups,), (groups,)."""
    order = np.lexsort((value, group))
    count = np.bincount(group, minlength=groups)
    median = np.full(groups, np.nan)
    some = np.flatnonzero(count)
    first = (np.cumsum(count) - count)[some]
    middle = value[order[first + (count[some] - 1) // 2]], value[order[first + count[some] // 2]]
    median[some] = 0.5 * (middle[0] + middle[1])
    return count, median
