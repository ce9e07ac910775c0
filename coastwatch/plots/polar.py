"""Radar reports to plots: unbiased polar conversion at the antenna, then to the plane of its region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Bools, Floats, Plots, RadarCorrections, RadarReports, Sensors
from coastwatch.geodesy import from_plane, to_plane, turn
from coastwatch.kernels.geometry.polar import polar_to_plane
from coastwatch.stage import Method


@dataclass(frozen=True)
class PolarMemory:
    """Count of the reports that were dropped."""

    dropped: int  # reports that are not finite, of negative range, or of an unknown radar


class PolarConversion(Method):
    """Plots with covariance by the unbiased conversion. Registration errors, known or estimated online, are subtracted first."""

    method: Literal["polar"] = "polar"
    azimuth_bias_deg: dict[str, float] = Field(default_factory=dict)
    range_bias_m: dict[str, float] = Field(default_factory=dict)
    time_lag_s: dict[str, float] = Field(default_factory=dict)

    def init(self) -> PolarMemory:
        """The memory before the first cycle."""
        return PolarMemory(0)

    def step(
        self, memory: PolarMemory, reports: RadarReports, sensors: Sensors, corrections: RadarCorrections
    ) -> tuple[PolarMemory, Plots]:
        """Plots of the usable reports, in their order of arrival.

        Args: reports: what arrived; sensors: the radars by their specification; corrections: on top of the settings.
        Returns: the memory with the dropped reports counted; plots in the plane of the region of each radar.
        Raises: ValueError where a correction names a radar that the scenario does not have.
        """
        good = _usable(reports, len(sensors.radars))
        kept = reports.take(good)
        radar = kept.sensor
        lag_s, bias_m, bias_deg = (
            _per_radar(name, getattr(self, name), sensors)[radar] for name in ("time_lag_s", "range_bias_m", "azimuth_bias_deg")
        )
        lag_s = lag_s + corrections.time_lag_s[radar]
        bias_m = bias_m + corrections.range_bias_m[radar]
        bias_deg = bias_deg + np.degrees(corrections.azimuth_bias_rad[radar])
        range_sigma, azimuth_sigma = sensors.radars.range_sigma_m[radar], sensors.radars.azimuth_sigma_rad[radar]
        distance = np.maximum(kept.range_m - bias_m, 0.0)
        azimuth = np.radians(kept.azimuth_deg - bias_deg)
        metres, covariance = polar_to_plane(distance, azimuth, range_sigma, azimuth_sigma)
        region = sensors.radars.region[radar]
        origin = sensors.region_origin_deg[region]
        rotation = turn(kept.site_deg, origin)
        plots = Plots(
            sensor=radar,
            region=region,
            time_s=kept.time_s - lag_s,
            position_m=to_plane(from_plane(metres, kept.site_deg), origin),
            covariance=rotation @ covariance @ rotation.swapaxes(-1, -2),
            site_m=to_plane(kept.site_deg, origin),
            origin=kept.origin,
        )
        return PolarMemory(memory.dropped + len(reports) - len(kept)), plots


def _usable(reports: RadarReports, radars: int) -> Bools:
    """Which reports are finite, of a range that is not negative and of a known radar. (M,)"""
    numbers = np.column_stack([reports.time_s, reports.range_m, reports.azimuth_deg, reports.site_deg])
    known = (reports.sensor >= 0) & (reports.sensor < radars)
    good: Bools = np.isfinite(numbers).all(axis=1) & known & (reports.range_m >= 0.0)
    return good


def _per_radar(setting: str, by_name: dict[str, float], sensors: Sensors) -> Floats:
    """The correction of each radar, 0 where none is named. (R,)"""
    names = sensors.radars.name.tolist()
    for name in by_name:
        if name not in names:
            raise ValueError(f"plots.{setting}: got radar {name!r}, needed one of {names}")
    return np.array([by_name.get(name, 0.0) for name in names], float)
