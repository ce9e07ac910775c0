"""Octants: the vessels of each 45 degree sector around a sensor of bearings, with the bearing tracks in it."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import BearingTracks, Floats, Ints, Octants, Picture, Sensors
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
        vessel_row, start = self._vessels(sonar, bearing_tracks, picture, sensors)
        octant = sonar * SECTORS + sector(np.degrees(bearing_tracks.bearing_rad))
        return memory, Octants(*kernels.bearings.candidates.paired(octant, start, vessel_row))

    def _vessels(self, sonar: Ints, tracks: BearingTracks, picture: Picture, sensors: Sensors) -> tuple[Ints, Ints]:
        """The rows of the vessels in each octant, and where each octant begins."""

        sonars, newest = _newest_of_each(sonar, tracks.updated_s)
        reach_m, site_deg = sensors.sonars.range_m[sonars] * self.range_margin, tracks.site_deg[newest]
        near = kernels.geometry.sensor_coverage.near_sites(
            picture.position_deg, site_deg, reach_m, picture.covariance, self.position_sigmas
        )
        row, site, east_north = near
        distance = np.hypot(east_north[:, 0], east_north[:, 1])
        direction = np.degrees(np.arctan2(east_north[:, 0], east_north[:, 1]))
        tolerance_m = self.position_sigmas * position_sigma_m(picture.covariance, row)
        tolerance_deg = np.degrees(np.arctan2(tolerance_m, distance)) + self.overlap_deg
        h = np.flatnonzero(distance <= reach_m[site] + tolerance_m)
        out: tuple[Ints, Ints] = kernels.bearings.candidates.within_sectors(
            direction[h], tolerance_deg[h], sonars[site[h]], row[h], len(sensors.sonars)
        )
        return out


def sector(direction_deg: Floats) -> Ints:
    """The sector, 0 to 7 clockwise from north, of each direction; a border belongs to the sector that begins there."""
    return np.floor(direction_deg / SECTOR_DEG).astype(np.int64) % SECTORS


def position_sigma_m(covariance: Floats, row: Ints) -> Floats:
    """Standard deviation per axis of these rows, 0 where there is no covariance. Args: covariance: (V, 4, 4). Returns: as row."""
    out: Floats = np.sqrt(np.nan_to_num(0.5 * (covariance[row, 0, 0] + covariance[row, 1, 1])))
    return out


def _newest_of_each(sonar: Ints, updated_s: Floats) -> tuple[Ints, Ints]:
    """The sonars that have tracks, sorted, and the row of the newest track of each: it knows where the sonar is now."""
    order = np.lexsort((updated_s, sonar))
    sonars = np.unique(sonar)
    return sonars, order[np.searchsorted(sonar[order], sonars, side="right") - 1]
