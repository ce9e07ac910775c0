"""Octants: the vessels of each 45 degree sector around a sensor of bearings, with the bearing tracks in it."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import BearingTracks, Floats, Ints, Octants, Picture, Sensors
from coastwatch.geodesy import wrap_rad
from coastwatch.spots.inputs import OctantInput
from coastwatch.stage import Method, NoMemory, NotNegative

MOST_VESSELS = 200
"""Vessels that a bearing track is compared with. In an octant of more each track is compared with those nearest in direction."""


class OctantSpots(Method):
    """Each bearing track with all vessels in its own octant of its sensor, and in a strip of the octants beside it.

    The octant of a pair is that of the bearing track, so that each pair stands once. A vessel is in an octant if its direction
    is no more than `overlap_deg`, and `position_sigmas` standard deviations of its position, outside; and its distance no more
    than the range of the sensor times `range_margin`, and the same tolerance. The published octants: `overlap_deg = 0`,
    `position_sigmas = 0`, `range_margin = 1` (they lose 1.9 points of recall at their borders).
    In an octant of more than `MOST_VESSELS` vessels each track is compared with those nearest in direction.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, section III-D.
    """

    method: Literal["octants"] = "octants"
    overlap_deg: Annotated[float, Field(ge=0.0, le=22.5)] = 6.0
    position_sigmas: NotNegative = 3.0
    range_margin: Annotated[float, Field(ge=1.0)] = 1.05

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: OctantInput) -> tuple[NoMemory, Octants]:
        """Pairs of rows to compare, sorted by row."""
        bearing_tracks, sensors = given.bearing_tracks, given.sensors
        if not len(bearing_tracks):
            return memory, Octants.empty()
        candidates = kernels.bearings.candidates
        sensor = bearing_tracks.source - sensors.sonar_source(0)
        vessels = self._vessels_by_octant(sensor, bearing_tracks, given.picture, sensors)
        bearing_rad = bearing_tracks.bearing_rad
        if given.bias_rad is not None and len(given.bias_rad):
            bearing_rad = wrap_rad(bearing_rad - given.bias_rad[sensor])
        bearing_deg = np.degrees(bearing_rad)
        sector = candidates.sector_of(bearing_deg)
        octant, from_middle_deg = sensor * candidates.SECTORS + sector, candidates.from_middle_deg(bearing_deg, sector)
        track, vessel = candidates.pairs_of_tracks(octant, from_middle_deg, vessels, MOST_VESSELS)
        left_out = int(np.diff(vessels[0])[octant].sum()) - len(track)
        return memory, Octants(track, vessel, octant[track], left_out)

    def _vessels_by_octant(
        self, sensor: Ints, tracks: BearingTracks, picture: Picture, sensors: Sensors
    ) -> tuple[Ints, Ints, Floats]:
        """Where each octant begins, the rows of the vessels in it, and their directions from its middle."""
        order, active = np.lexsort((tracks.updated_s, sensor)), np.unique(sensor)
        newest = order[np.searchsorted(sensor[order], active, side="right") - 1]  # its track has the position of the sensor
        covariance = picture.covariance
        sigma_m: Floats = np.sqrt(np.nan_to_num(0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])))  # 0 without a covariance
        range_m, tolerance_m = sensors.sonars.range_m[active] * self.range_margin, self.position_sigmas * sigma_m
        row, site, offset = kernels.geometry.sensor_coverage.pairs_in_range(
            tracks.site_deg[newest], range_m, picture.position_deg, tolerance_m
        )
        distance, direction = np.hypot(offset[:, 0], offset[:, 1]), np.arctan2(offset[:, 0], offset[:, 1])
        tolerance_deg = np.degrees(np.arctan2(tolerance_m[row], distance)) + self.overlap_deg
        rows: tuple[Ints, Ints, Floats] = kernels.bearings.candidates.vessels_by_octant(
            np.degrees(direction), tolerance_deg, active[site], row, len(sensors.sonars)
        )
        return rows
