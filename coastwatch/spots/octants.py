"""Octants: the vessels of each 45 degree sector around a sensor of bearings, with the bearing tracks in it."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import BearingTracks, Bools, Floats, Ints, Octants, Picture, Sensors
from coastwatch.geodesy import earth_centred, to_plane, wrap_deg
from coastwatch.stage import Method

SECTOR_DEG = 45.0
SECTORS = 8


class OctantSpots(Method):
    """Each bearing track with all vessels in its own octant of its sensor, and in a strip of the octants beside it.

    The octant of a pair is that of the bearing track, so that each pair stands once. A vessel is in an octant if its direction
    is no more than `overlap_deg`, and `position_sigmas` standard deviations of its position, outside; and its distance no more
    than the range of the sensor times `range_margin`, and the same tolerance. The published octants: `overlap_deg = 0`,
    `position_sigmas = 0`, `range_margin = 1` (they lose 1.9 points of recall at their borders).
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, section III-D.
    """

    method: Literal["octants"] = "octants"
    overlap_deg: Annotated[float, Field(ge=0.0, le=22.5)] = 6.0
    position_sigmas: Annotated[float, Field(ge=0.0)] = 3.0
    range_margin: Annotated[float, Field(ge=1.0)] = 1.05

    def init(self) -> tuple[()]:
        return ()

    def step(
        self, memory: tuple[()], bearing_tracks: BearingTracks, picture: Picture, sensors: Sensors
    ) -> tuple[tuple[()], Octants]:
        """Pairs of rows to compare. Args: bearing_tracks: (N); picture: (V). Returns: memory and Octants sorted by row."""
        sonar = bearing_tracks.source - sensors.sonar_source(0)
        vessel_octant, vessel_row = self._vessels(sonar, bearing_tracks, picture, sensors)
        octant = sonar * SECTORS + sector(np.degrees(bearing_tracks.bearing_rad))
        start = np.searchsorted(vessel_octant, octant)
        count = np.searchsorted(vessel_octant, octant, side="right") - start
        bearing_row = np.repeat(np.arange(len(octant)), count)
        skipped = np.cumsum(count) - count
        entry = np.arange(len(bearing_row)) + np.repeat(start - skipped, count)
        return memory, Octants(bearing_row.astype(np.int64), vessel_row[entry], np.repeat(octant, count).astype(np.int64))

    def _vessels(self, sonar: Ints, tracks: BearingTracks, picture: Picture, sensors: Sensors) -> tuple[Ints, Ints]:
        """Octants and the rows of the vessels in them, sorted by octant, then row."""
        sonars, newest = _newest_of_each(sonar, tracks.updated_s)
        if len(sonars) == 0 or len(picture) == 0:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        tolerance_m = self.position_sigmas * position_sigma_m(picture.covariance)
        reach_m = sensors.sonars.range_m[sonars] * self.range_margin
        near = _within(picture.position_deg, tracks.site_deg[newest], reach_m + tolerance_m.max())
        parts = []
        for s, row, reach, rows in zip(sonars, newest, reach_m, near, strict=True):
            east_north = to_plane(picture.position_deg[rows], tracks.site_deg[row])
            distance = np.hypot(east_north[:, 0], east_north[:, 1])
            direction = np.degrees(np.arctan2(east_north[:, 0], east_north[:, 1]))
            tolerance_deg = np.degrees(np.arctan2(tolerance_m[rows], distance)) + self.overlap_deg
            outside = self._outside(direction, tolerance_deg) | (distance > reach + tolerance_m[rows])[:, None]
            at, octant = np.nonzero(~outside)
            parts.append((s * SECTORS + octant, rows[at]))
        octants, vessels = (np.concatenate([p[k] for p in parts]) for k in range(2))
        order = np.lexsort((vessels, octants))
        return octants[order].astype(np.int64), vessels[order].astype(np.int64)

    @staticmethod
    def _outside(direction_deg: Floats, tolerance_deg: Floats) -> Bools:
        """Whether each direction is farther outside each sector than its tolerance. Args: (R,), (R,). Returns: (R, 8)."""
        middle = (np.arange(SECTORS) + 0.5) * SECTOR_DEG
        off = np.abs(wrap_deg(direction_deg[:, None] - middle))
        far: Bools = off > SECTOR_DEG / 2.0 + tolerance_deg[:, None]
        own = np.arange(SECTORS) == sector(direction_deg)[:, None]
        out: Bools = far & ~own
        return out


def sector(direction_deg: Floats) -> Ints:
    """The sector, 0 to 7 clockwise from north, of each direction; a border belongs to the sector that begins there."""
    return np.floor(direction_deg / SECTOR_DEG).astype(np.int64) % SECTORS


def position_sigma_m(covariance: Floats) -> Floats:
    """Standard deviation per axis of each position, 0 where there is no covariance. Args: (V, 4, 4). Returns: (V,)."""
    return np.sqrt(np.nan_to_num(0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])))


def _newest_of_each(sonar: Ints, updated_s: Floats) -> tuple[Ints, Ints]:
    """The sonars that have tracks, sorted, and the row of the newest track of each: it knows where the sonar is now."""
    order = np.lexsort((updated_s, sonar))
    sonars = np.unique(sonar)
    return sonars, order[np.searchsorted(sonar[order], sonars, side="right") - 1]


def _within(position_deg: Floats, site_deg: Floats, reach_m: Floats) -> list[Ints]:
    """Rows, sorted, of the positions within reach of each site. Args: (V, 2), (S, 2), (S,)."""
    from scipy.spatial import cKDTree

    tree = cKDTree(earth_centred(position_deg))
    found = tree.query_ball_point(earth_centred(site_deg), reach_m, return_sorted=True)
    return [np.array(rows, np.int64) for rows in found]
