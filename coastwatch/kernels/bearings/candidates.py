"""Candidate pairs of bearing tracks and vessels by octant, the 45 degree sector of a sensor. An octant is sensor * 8 + sector."""

from __future__ import annotations

import numpy as np

from coastwatch.geodesy import wrap_deg
from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.tables.groups import ranges

SECTORS = 8
SECTOR_DEG = 360.0 / SECTORS


def sector_of(direction_deg: Floats) -> Ints:
    """The sector, 0 to 7 clockwise from north, of each direction; a border belongs to the sector that begins there."""
    return np.floor(direction_deg / SECTOR_DEG).astype(np.int64) % SECTORS


def from_middle_deg(direction_deg: Floats, sector: Ints) -> Floats:
    """Each direction from the middle of its sector, clockwise."""
    return np.asarray(wrap_deg(direction_deg - (sector + 0.5) * SECTOR_DEG))


def vessels_by_octant(
    direction_deg: Floats, tolerance_deg: Floats, sensor: Ints, vessel_row: Ints, sensors: int
) -> tuple[Ints, Ints, Floats]:
    """The vessels of each octant: those in it, and those no farther outside than their tolerance.

    Args: direction_deg, tolerance_deg, sensor, vessel_row: (H,) a vessel seen from a sensor, sorted by vessel_row; sensors: K.
    Returns: (8 K + 1,) where each octant begins; (G,) its vessel rows, sorted; (G,) direction of each from the middle of the octant.
    """
    sector = np.arange(SECTORS)
    from_middle = from_middle_deg(direction_deg[:, None], sector)
    outside = np.abs(from_middle) - 0.5 * SECTOR_DEG
    h, inside = np.nonzero((outside <= tolerance_deg[:, None]) | (sector == sector_of(direction_deg)[:, None]))
    octant = SECTORS * sensor[h] + inside
    order = np.argsort(octant, kind="stable")
    start = np.searchsorted(octant[order], np.arange(SECTORS * sensors + 1))
    return start.astype(np.int64), vessel_row[h[order]], from_middle[h[order], inside[order]]


def pairs_of_tracks(octant: Ints, from_middle_deg: Floats, vessels: tuple[Ints, Ints, Floats], most: int) -> tuple[Ints, Ints]:
    """Each track with all vessels of its octant; if these are more than `most`, with those nearest in direction.

    Args: octant, from_middle_deg: (N,) of each track; vessels: of `vessels_by_octant`.
    Returns: (A,) tracks, sorted; (A,) vessel rows, sorted within a track.
    """
    start, vessel_row, direction = vessels
    first, count = start[octant], start[octant + 1] - start[octant]
    many = np.flatnonzero(count > most)
    if not len(many):
        return np.repeat(np.arange(len(octant)), count), vessel_row[ranges(first, count)]
    of_vessel = np.repeat(np.arange(len(start) - 1), np.diff(start))
    by_direction = np.lexsort((vessel_row, direction, of_vessel))  # within each octant
    first = first.copy()
    first[many] = first_of_nearest(from_middle_deg[many], direction[by_direction], start[octant[many]], count[many], most)
    near = np.minimum(count, most)
    track, place = np.repeat(np.arange(len(octant)), near), ranges(first, near)
    vessel = vessel_row[np.where((count > most)[track], by_direction[place], place)]
    order = np.lexsort((vessel, track))
    return track, vessel[order]


def first_of_nearest(value: Floats, sorted_values: Floats, start: Ints, count: Ints, most: int) -> Ints:
    """Where the `most` values begin that are nearest to each value, of its own part of the sorted values, by bisection.

    Args: value: (N,); start, count: (N,) its part, which has more than `most` values. Returns: (N,); of equally near ones the first.
    """
    low, high = start.copy(), start + count - most
    while (low < high).any():
        middle = (low + high) // 2
        beyond = np.minimum(middle + most, len(sorted_values) - 1)
        right = (low < high) & (value - sorted_values[middle] > sorted_values[beyond] - value)
        low, high = np.where(right, middle + 1, low), np.where(right, high, middle)
    return np.asarray(low)


def tracks_by_octant(bearing_row: Ints, octant: Ints) -> tuple[Ints, Ints]:
    """The tracks of each octant that has pairs. Args: (A,) sorted pairs. Returns: (T,) rows; (O + 1,) where each octant begins."""
    row, first_pair = np.unique(bearing_row, return_index=True)
    order = np.argsort(octant[first_pair], kind="stable")
    _, start = np.unique(octant[first_pair][order], return_index=True)
    return row[order], np.append(start, len(row)).astype(np.int64)
