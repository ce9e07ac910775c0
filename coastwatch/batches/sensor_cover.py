"""Where sensors of a kind should see a vessel, by their ranges."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from coastwatch import kernels
from coastwatch.batches import Sensors

if TYPE_CHECKING:
    from coastwatch.kernels.geometry.sensor_coverage import Coverage  # numba takes half a second to load


@lru_cache(maxsize=4)
def coverages(sensors: Sensors, margin: float) -> tuple[Coverage, Coverage]:
    """Coverage of AIS stations and of radars. It is cached: the sensors are the same object throughout a run."""
    coverage_of = kernels.geometry.sensor_coverage.coverage_of
    ais = coverage_of(sensors.stations.site_deg, margin * sensors.stations.range_m, 0.0)
    return ais, coverage_of(sensors.radars.site_deg, margin * sensors.radars.range_m, 0.0)
