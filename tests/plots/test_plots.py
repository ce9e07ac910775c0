"""Radar reports to plots: the place is right on the ellipsoid, corrections are taken out, bad rows are counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from radar_world import two_radars

from coastwatch.batches import RadarCorrections, RadarReports
from coastwatch.geodesy import difference_m, from_plane, offset_deg, to_plane
from coastwatch.plots import PolarConversion
from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

ELLIPSOID_M = 0.3  # a range along the tangent plane at the antenna against one along the ground, at 18 NM


def reports(n: int = 6, **columns) -> RadarReports:
    sensors = two_radars()
    base = {
        "sensor": np.arange(n) % 2,
        "time_s": np.arange(n, dtype=float),
        "received_s": np.arange(n, dtype=float),
        "range_m": np.linspace(500.0, 9000.0, n),
        "azimuth_deg": np.linspace(0.0, 350.0, n),
        "site_deg": sensors.radars.site_deg[np.arange(n) % 2],
        "origin": np.arange(n),
    }
    return RadarReports(**{**base, **columns})


NOTHING = RadarCorrections.empty(R=2)


def converted(given: RadarReports, sensors=None, found=NOTHING, **settings):
    method = PolarConversion(**settings)
    return method.step(method.init(), given, sensors or two_radars(), found)


def test_the_place_is_where_the_antenna_points():
    sensors = two_radars()
    far = replace(sensors, radars=replace(sensors.radars, azimuth_sigma_rad=np.full(2, 1e-9)))
    given = reports(range_m=np.full(6, 18.0 * 1852.0))
    _, plots = converted(given, far)
    ahead = np.radians(given.azimuth_deg)
    want = from_plane(given.range_m[:, None] * np.column_stack([np.sin(ahead), np.cos(ahead)]), given.site_deg)
    got = from_plane(plots.position_m, sensors.region_origin_deg[0])
    assert np.abs(difference_m(got, want)).max() < ELLIPSOID_M


def test_north_at_the_antenna_is_not_north_of_the_region():
    """At 60 deg an antenna 18 NM east of the origin sees its north turned by 0.5 deg, and the ellipse of the plot with it."""
    sensors = two_radars()
    origin = np.array([[60.0, 10.0]])
    site = offset_deg(origin, np.array([[18.0 * 1852.0, 0.0]]))
    sensors = replace(sensors, region_origin_deg=origin)
    given = reports(1, sensor=np.zeros(1, np.int64), site_deg=site, range_m=np.array([9000.0]), azimuth_deg=np.zeros(1))
    _, plots = converted(given, sensors)
    gap = plots.position_m[0] - to_plane(site[0], origin[0])
    bearing = np.degrees(np.arctan2(gap[0], gap[1]))
    assert bearing == pytest.approx(-np.degrees(18.0 * 1852.0 / 6.39e6) * np.tan(np.radians(60.0)), abs=0.01)
    _, axes = np.linalg.eigh(plots.covariance[0])
    along = axes[:, 0] * np.sign(axes[1, 0])  # the narrow axis is the range
    assert np.degrees(np.arctan2(along[0], along[1])) == pytest.approx(bearing, abs=0.02)


def test_known_errors_are_taken_out():
    clean = converted(reports())[1]
    given = reports()
    late = given.sensor == 0
    bent = replace(
        given,
        azimuth_deg=given.azimuth_deg + np.where(late, 0.7, 0.0),
        range_m=given.range_m + np.where(late, 40.0, 0.0),
        time_s=given.time_s + np.where(late, 1.5, 0.0),
    )
    settings = {"azimuth_bias_deg": {"north": 0.7}, "range_bias_m": {"north": 40.0}, "time_lag_s": {"north": 1.5}}
    mended = converted(bent, **settings)[1]
    np.testing.assert_allclose(mended.position_m, clean.position_m, atol=1e-6)
    np.testing.assert_allclose(mended.time_s, clean.time_s)
    found = replace(
        NOTHING,
        azimuth_bias_rad=np.radians([0.4, 0.0]),
        range_bias_m=np.array([-10.0, 0.0]),
        time_lag_s=np.array([0.5, 0.0]),
    )
    settings = {"azimuth_bias_deg": {"north": 0.3}, "range_bias_m": {"north": 50.0}, "time_lag_s": {"north": 1.0}}
    both = converted(bent, found=found, **settings)[1]
    np.testing.assert_allclose(both.position_m, clean.position_m, atol=1e-6)
    np.testing.assert_allclose(both.time_s, clean.time_s)


def test_plots_of_a_radar_whose_site_is_stated_wrong_are_moved():
    clean, given = converted(reports())[1], reports()
    north = given.sensor == 0
    stated = np.where(north[:, None], from_plane(np.array([50.0, -20.0]), given.site_deg), given.site_deg)
    found = replace(NOTHING, site_error_m=np.array([[50.0, -20.0], [0.0, 0.0]]))
    mended = converted(replace(given, site_deg=stated), found=found)[1]
    np.testing.assert_allclose(mended.position_m, clean.position_m, atol=0.01)
    np.testing.assert_allclose(mended.site_m, clean.site_m, atol=0.01)


def test_ranges_that_grow_too_fast_are_shortened():
    clean, given = converted(reports())[1], reports()
    wrong = np.where(given.sensor == 0, 1.01 * given.range_m + 30.0, given.range_m)
    found = replace(NOTHING, range_bias_m=np.array([30.0, 0.0]), range_scale=np.array([0.01, 0.0]))
    mended = converted(replace(given, range_m=wrong), found=found)[1]
    np.testing.assert_allclose(mended.position_m, clean.position_m, atol=1e-6)


def test_a_correction_of_no_radar_is_refused():
    with pytest.raises(ScenarioError, match=r"plots\.azimuth_bias_deg: got radar 'est', needed one of .*'radar-1'"):
        load_scenario("context-driven-100", {"plots.azimuth_bias_deg.est": "1.0"})
    with pytest.raises(ValidationError, match="range_bias"):
        PolarConversion(range_bias={"north": 1.0})


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("range_m", np.nan),
        ("range_m", np.inf),
        ("range_m", -1.0),
        ("azimuth_deg", np.nan),
        ("time_s", np.inf),
        ("site_deg", np.nan),
        ("sensor", 2),
        ("sensor", -1),
    ],
)
def test_what_is_no_place_is_dropped_and_counted(column, value):
    given = reports()
    bad = getattr(given, column).copy()
    bad[2] = value
    memory, plots = converted(replace(given, **{column: bad}))
    assert memory.dropped == 1
    assert plots.origin.tolist() == [0, 1, 3, 4, 5]
    want = converted(given.take(np.array([0, 1, 3, 4, 5])))[1]
    assert np.array_equal(plots.position_m, want.position_m)


def test_no_report_and_memory():
    method = PolarConversion()
    memory, plots = method.step(method.init(), RadarReports.empty(), two_radars(), NOTHING)
    assert len(plots) == 0
    again, _ = method.step(load(save(memory)), reports(range_m=np.full(6, np.nan)), two_radars(), NOTHING)
    assert (memory.dropped, again.dropped) == (0, 6)


def test_a_moving_antenna_sees_a_standing_buoy_standing():
    sensors = two_radars()
    buoy = sensors.region_origin_deg[0]
    site = offset_deg(buoy, np.column_stack([np.linspace(-3000.0, 2000.0, 6), np.full(6, 700.0)]))
    gap = to_plane(np.broadcast_to(buoy, site.shape), site)
    given = reports(site_deg=site, range_m=np.hypot(*gap.T), azimuth_deg=np.degrees(np.arctan2(gap[:, 0], gap[:, 1])) % 360.0)
    _, plots = converted(given)
    assert np.abs(plots.position_m).max() < ELLIPSOID_M
    np.testing.assert_allclose(from_plane(plots.site_m, buoy), site, atol=1e-9)


def test_a_plot_with_a_standard_deviation_of_its_own_has_its_own_covariance():
    sensors = two_radars()
    plain = converted(reports(), sensors)[1]
    sigma = np.full(6, np.nan)
    sigma[2] = 55.0
    angle = np.full(6, np.nan)
    angle[4] = 2.0
    own = converted(reports(range_sigma_m=sigma, azimuth_sigma_deg=angle), sensors)[1]
    same = [0, 1, 3, 5]
    np.testing.assert_allclose(own.covariance[same], plain.covariance[same], rtol=1e-12)
    np.testing.assert_allclose(own.position_m[same], plain.position_m[same], rtol=1e-12)
    for row, radars in (
        (2, replace(sensors.radars, range_sigma_m=np.full(2, 55.0))),
        (4, replace(sensors.radars, azimuth_sigma_rad=np.full(2, np.radians(2.0)))),
    ):
        wanted = converted(reports(), replace(sensors, radars=radars))[1]
        np.testing.assert_allclose(own.covariance[row], wanted.covariance[row], rtol=1e-12)


def test_the_extent_of_a_ship_is_turned_from_the_beam_to_the_plane():
    """A ship that lies along its beam points away from the antenna in the plane; one across, to its right."""
    shape = np.array([[900.0, 0.0, 4.0], [4.0, 0.0, 900.0], [500.0, 300.0, 500.0]] * 2)
    given = reports(extent=shape, weight=np.full(6, 7.0))
    _, plots = converted(given)
    off_m = plots.position_m - plots.site_m
    along = off_m / np.hypot(*off_m.T)[:, None]
    across = along[:, ::-1] * [1.0, -1.0]
    turned = plots.extent[:, [[0, 1], [1, 2]]]
    for k, (one, other) in enumerate([(along, along), (along, across), (across, across)]):
        np.testing.assert_allclose(np.einsum("mi,mij,mj->m", one, turned, other), shape[:, k], atol=1e-6)
    assert (plots.weight == 7.0).all()
    _, plain = converted(reports())
    assert np.isnan(plain.extent).all()
