"""Radar reports to plots: unbiased polar conversion at the antenna, then to the plane of its region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Plots, RadarCorrections, RadarReports, Sensors
from coastwatch.geodesy import from_plane
from coastwatch.stage import Method


@dataclass(frozen=True)
class PolarMemory:
    """Count of the reports that were dropped."""

    dropped: int  # reports that are not finite, of negative range, or of an unknown radar


class PolarConversion(Method):
    """Plots with covariance by the unbiased conversion. Registration errors, known or estimated online, are subtracted first."""

    method: Literal["polar"] = "polar"
    azimuth_bias_deg: dict[str, float] = Field(default_factory=dict)
    """By radar, subtracted from its azimuths: positive where they are clockwise of the truth. E.g. {north = 3.0} turns 93 to 90."""
    range_bias_m: dict[str, float] = Field(default_factory=dict)
    """By radar, subtracted from its ranges: positive where they are too long. E.g. {north = 40.0} makes 5,040 m 5,000 m."""
    time_lag_s: dict[str, float] = Field(default_factory=dict)
    """By radar, subtracted from its time stamps: positive where they are late. E.g. {north = 1.5} dates a plot 1.5 s earlier."""

    def init(self) -> PolarMemory:
        return PolarMemory(0)

    def step(
        self, memory: PolarMemory, reports: RadarReports, sensors: Sensors, corrections: RadarCorrections
    ) -> tuple[PolarMemory, Plots]:
        """Plots of the usable reports, in their order of arrival.

        Args: reports: what arrived; sensors: the radars by their specification; corrections: on top of the settings.
        Returns: the memory with the dropped reports counted; plots in the plane of the region of each radar.
        """
        radars = sensors.radars
        good = _usable(reports, len(radars))
        kept = reports if good.all() else reports.take(good)
        radar = kept.sensor
        names = radars.name.tolist()
        lag_s, bias_m, bias_deg = (
            np.array([by_name.get(name, 0.0) for name in names], float)
            for by_name in (self.time_lag_s, self.range_bias_m, self.azimuth_bias_deg)
        )
        distance = np.maximum(kept.range_m - (bias_m + corrections.range_bias_m)[radar], 0.0)
        if corrections.range_scale.any():
            distance /= 1.0 + corrections.range_scale[radar]
        azimuth = np.radians(kept.azimuth_deg) - (np.radians(bias_deg) + corrections.azimuth_bias_rad)[radar]
        row, sigma = _sigmas(kept, sensors, corrections)
        origin = sensors.region_origin_deg[radars.region if row is radar else radars.region[radar]]
        convert = kernels.geometry.radar_plane.to_region
        site_deg = kept.site_deg
        if corrections.site_error_m.any():
            site_deg = from_plane(-corrections.site_error_m[radar], site_deg)
        position, covariance, site = convert(row, distance, azimuth, site_deg, sigma, origin)
        plots = Plots(
            sensor=radar,
            region=radars.region[radar],
            time_s=kept.time_s - (lag_s + corrections.time_lag_s)[radar],
            position_m=position,
            covariance=covariance,
            site_m=site,
            range_m=distance,
            azimuth_rad=azimuth,
            origin=kept.origin,
            extent=_turned(kept.extent, position - site),
            weight=kept.weight,
        )
        return PolarMemory(memory.dropped + len(reports) - len(kept)), plots


def _sigmas(reports: RadarReports, sensors: Sensors, corrections: RadarCorrections) -> tuple[Ints, Floats]:
    """Standard deviations of range and azimuth, and the row of them for each plot: that of its radar, or its own. (M,), (R or M, 2)

    The learnt factor of noise is in those of the radars already.
    """
    specified = np.column_stack([sensors.radars.range_sigma_m, sensors.radars.azimuth_sigma_rad])
    own = np.column_stack([reports.range_sigma_m, np.radians(reports.azimuth_sigma_deg)])
    given = own > 0.0
    if not given.any():
        return reports.sensor, specified
    return np.arange(len(reports)), np.where(given, own * corrections.noise_factor[reports.sensor], specified[reports.sensor])


def _turned(extent: Floats, off_m: Floats) -> Floats:
    """Second moments along and across the beam, turned to the plane. (M, 3) m2 Args: off_m: (M, 2) from the antenna."""
    if np.isnan(extent).all():
        return extent
    east, north = (off_m / np.maximum(np.hypot(off_m[:, 0], off_m[:, 1]), 1e-9)[:, None]).T
    along, both, across = extent.T
    both_turned = 2.0 * east * north * both
    return np.column_stack(
        [
            east**2 * along + both_turned + north**2 * across,
            east * north * (along - across) + (north**2 - east**2) * both,
            north**2 * along - both_turned + east**2 * across,
        ]
    )


def _usable(reports: RadarReports, radars: int) -> Bools:
    """Which reports are finite, of a range that is not negative and of a known radar. (M,)"""
    good: Bools = (reports.sensor >= 0) & (reports.sensor < radars) & (reports.range_m >= 0.0)
    for numbers in (reports.time_s, reports.range_m, reports.azimuth_deg, reports.site_deg[:, 0], reports.site_deg[:, 1]):
        good &= np.isfinite(numbers)
    return good
