"""Sensors and simulations that the tests of the simulator and of the scores share."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from coastwatch.batches import Radars, Recording, Sensors, Sonars, Stations
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg
from coastwatch.sensors.simulated.simulation import Simulated
from coastwatch.stage import Plan

CENTRE_DEG = np.array([-23.0, -43.1])
START_S = 1.7e9
LEVEL = 1e-6  # probability with which a statistical test of right code is red
GEOMETRY_NM = {"near": (2.0, 2.92), "mid": (2.5, 6.0), "far": (13.0, 18.0)}  # of each radar from the centre, and its range


def sensors(geometry: str = "mid", range_nm: float | None = None, **sonar: float) -> Sensors:
    """Two radars east and west of the centre, no station, one sonar in the middle."""
    away, reach = GEOMETRY_NM[geometry]
    sites = offset_deg(np.tile(CENTRE_DEG, (2, 1)), np.array([[-away, 0.0], [away, 0.0]]) * NAUTICAL_MILE_M)
    radars = Radars(
        name=np.array(["west", "east"], "U32"),
        region=np.zeros(2, np.int64),
        site_deg=sites,
        range_m=np.full(2, (range_nm or reach) * NAUTICAL_MILE_M),
        period_s=np.array([4.0, 3.0]),
        range_sigma_m=np.full(2, 10.0),
        azimuth_sigma_rad=np.full(2, np.radians(0.3)),
    )
    listener = Sonars(
        name=np.array(["sonar"], "U32"),
        site_deg=CENTRE_DEG[None],
        range_m=np.array([4.0 * NAUTICAL_MILE_M]),
        bearing_sigma_rad=np.array([np.radians(1.0)]),
        interval_s=np.array([3.0]),
        arc_from_deg=np.array([sonar.get("arc_from_deg", 0.0)]),
        arc_to_deg=np.array([sonar.get("arc_to_deg", 360.0)]),
    )
    return Sensors(radars, Stations.empty(), listener, ("region",), CENTRE_DEG[None])


def simulated(count: int = 60, **settings: Any) -> Simulated:
    """A simulation around the centre."""
    lat, lon = CENTRE_DEG
    return Simulated(area_latitude_deg=lat, area_longitude_deg=lon, count=count, **settings)


def recorded(count: int = 60, cycles: int = 40, seed: int = 1, where: Sensors | None = None, **settings: Any) -> Recording:
    """What such a simulation gives."""
    plan = Plan(start_s=START_S, period_s=3.0, cycles=cycles)
    return simulated(count, **settings).load(where or sensors(), seed, plan)


def assert_unit_normal(draws: np.ndarray) -> None:
    """The draws are independent standard normal: their sum of squares and their mean lie in their bands."""
    n = draws.size
    low, high = chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], n)
    assert low < (draws**2).sum() < high
    assert abs(draws.mean()) * np.sqrt(n) < 5.0  # 5 sigma: 6e-7
