"""Radars that err more than they state: found from the scatter about AIS vessels, whatever some AIS does; and what it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import registration_world as world

from coastwatch.batches import Measurements, Members, RadarCorrections, RadarReports, Tracks
from coastwatch.batches.video import Videos
from coastwatch.geodesy import offset_deg
from coastwatch.plots import PolarConversion
from coastwatch.regional import reports_of_regions
from coastwatch.registration import RegistrationInput
from coastwatch.registration.noise import PlotScatter, noise_factors, scattered
from coastwatch.registration.references import References

pytestmark = pytest.mark.contract

SITE = world.CENTRE
NORTH_M = 8000.0  # of every vessel
RANGE_M, AZIMUTH_M = world.RANGE_SIGMA_M, world.AZIMUTH_SIGMA * NORTH_M
LEAST = 4


def sea(factors, vessels=40, cycles=20, drifting=0, alarmed=0, references=None):
    """The scatter after these cycles of one radar with so many times its noise; the first vessels' AIS drifts, or has an alarm."""
    rng, scatter = np.random.default_rng([1, 41]), PlotScatter.empty()
    v = np.arange(vessels)
    home = offset_deg(np.tile(SITE, (vessels, 1)), np.column_stack([np.zeros(vessels), np.full(vessels, NORTH_M)]))
    off = rng.normal(0.0, 5.0, (vessels, 2))  # of each antenna from its echo
    no_time, covariance = np.zeros(vessels), np.tile(np.diag([4.0, 4.0, 0.01, 0.01]), (vessels, 1, 1))
    drawn = References(np.zeros(vessels, np.int64), 100 + v) if references is None else references
    members = Members(np.repeat(v, 2), np.column_stack([v, 100 + v]).ravel(), np.tile([0, 1], vessels))
    for cycle in range(cycles):
        drift = np.where(v < drifting, 20.0 * cycle, 0.0)[:, None]
        none = np.zeros((vessels, 2))
        ais = Tracks(
            100 + v, np.ones(vessels, np.int64), no_time, offset_deg(home, off + drift), none, covariance,
            covariance[:, :2, :2], no_time, no_time, v, v,
        )  # fmt: skip
        noise = rng.normal(size=(vessels, 2)) * [factors[1] * AZIMUTH_M, factors[0] * RANGE_M]
        stated = np.full((vessels, 4, 4), np.nan)
        stated[:, :2, :2] = np.diag([AZIMUTH_M**2, RANGE_M**2])
        site = np.tile(SITE, (vessels, 1))
        m = Measurements(v, np.zeros(vessels, np.int64), no_time, offset_deg(home, noise), none * np.nan, stated, site)
        given = RegistrationInput(
            None, ais, None, m, None, members, None, None, 3.0 * cycle, world.sensors(), RadarCorrections.empty(R=1)
        )
        scatter = scattered(scatter, given, drawn, v < alarmed, 0.99)
    return scatter


def test_a_radar_is_taken_at_the_noise_that_it_shows():
    found = noise_factors(sea((2.0, 1.5)), 1, LEAST)
    np.testing.assert_allclose(found, [[2.0, 1.5]], rtol=0.12)
    np.testing.assert_array_equal(noise_factors(sea((1.0, 0.5)), 1, LEAST), [[1.0, 1.0]])


def test_few_vessels_and_ais_that_drifts_or_has_an_alarm_teach_nothing():
    np.testing.assert_array_equal(noise_factors(sea((2.0, 2.0), vessels=3), 1, LEAST), [[1.0, 1.0]])
    np.testing.assert_array_equal(noise_factors(sea((1.0, 1.0), drifting=12), 1, LEAST), [[1.0, 1.0]])
    assert len(sea((1.0, 1.0), alarmed=12)) == 28
    assert not len(sea((1.0, 1.0), references=References.empty()))


def test_plots_and_radars_of_a_region_have_the_noise_that_was_learnt():
    sensors = world.sensors()
    corrections = replace(RadarCorrections.empty(R=1), noise_factor=np.array([[2.0, 3.0]]))
    one = np.ones(2)
    reports = RadarReports(
        np.zeros(2, np.int64), 0.0 * one, 0.0 * one, 5000.0 * one, 0.0 * one, np.tile(SITE, (2, 1)), np.full(2, -1),
        range_sigma_m=np.array([np.nan, 5.0]), azimuth_sigma_deg=np.array([np.nan, 0.1]),
    )  # fmt: skip
    (given,), _ = reports_of_regions(reports, [None], corrections, 0.0, sensors, Videos())
    assert given.sensors.radars.range_sigma_m[0] == 2.0 * world.RANGE_SIGMA_M
    _, plots = PolarConversion().step(PolarConversion().init(), given.reports, given.sensors, given.corrections)
    np.testing.assert_allclose(np.sqrt(plots.covariance[:, 1, 1]), [20.0, 10.0], rtol=0.01)
    across = 3.0 * 5000.0 * np.array([world.AZIMUTH_SIGMA, np.radians(0.1)])
    np.testing.assert_allclose(np.sqrt(plots.covariance[:, 0, 0]), across, rtol=0.01)
