"""What a region reports, by compiled code, against `coastwatch.geodesy` and the polar conversion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.geodesy import from_plane, turn
from coastwatch.kernels.tracks import report
from coastwatch.kernels.tracks.columns import RadarColumns
from tests.oracles.polar_textbook import polar_to_plane

pytestmark = pytest.mark.oracle

ROUNDING_DEG = 1e-11  # 1 micrometre
ROUNDING_M2 = 1e-6  # differences of squares of distances of 1e4 m


@given(st.floats(-84.0, 84.0), st.floats(-180.0, 180.0), st.integers(0, 20), st.integers(0, 10**6))
def test_tracks_and_points_are_those_of_geodesy(latitude, longitude, n, seed):
    rng = np.random.default_rng([seed, 71])
    mean, a = rng.normal(size=(n, 5)) * np.array([5e4, 5e4, 5.0, 5.0, 1.0]), rng.normal(size=(n, 5, 7))
    covariance = a @ a.swapaxes(-1, -2)
    origin = np.array([latitude, longitude])
    degrees, velocity, turned = report.geodetic_tracks(mean, covariance, latitude, longitude)
    want = from_plane(mean[:, :2], origin)
    np.testing.assert_allclose(degrees, want, rtol=0.0, atol=ROUNDING_DEG)
    back = turn(want, origin).swapaxes(-1, -2)
    both = np.zeros((n, 4, 4))
    both[:, :2, :2] = both[:, 2:, 2:] = back
    np.testing.assert_allclose(velocity, (back @ mean[:, 2:4, None])[..., 0], atol=1e-9)
    np.testing.assert_allclose(turned, both @ covariance[:, :4, :4] @ both.swapaxes(-1, -2), atol=1e-9)
    points, spread = report.geodetic_points(mean[:, :2], covariance[:, :2, :2], latitude, longitude)
    assert np.array_equal(points, degrees)
    np.testing.assert_allclose(spread, turned[:, :2, :2], atol=1e-12)


def test_a_plot_is_worth_what_the_best_radar_that_covers_it_gives():
    rng = np.random.default_rng([72, 1])
    site, reach = np.array([[0.0, 0.0], [5000.0, 0.0], [0.0, 5000.0]]), np.array([6000.0, 4000.0, 9000.0])
    sigma, azimuth = np.array([10.0, 5.0, 60.0]), np.radians([0.3, 0.1, 3.0])
    position = np.vstack([rng.uniform(-9000.0, 9000.0, (200, 2)), site])
    radars = RadarColumns(site, reach, np.ones(3), np.zeros(3))
    got = report.plot_covariances(position, radars, sigma, azimuth)
    for k, place in enumerate(position):
        gap = place - site
        distance = np.hypot(*gap.T)
        each = polar_to_plane(distance, np.arctan2(*gap.T), sigma, azimuth)[1]
        worth = np.trace(each, axis1=1, axis2=2)
        best = np.argmin(np.where(distance <= reach, worth, worth + worth.max()))
        np.testing.assert_allclose(got[k], each[best], rtol=0.0, atol=ROUNDING_M2)


@pytest.mark.parametrize(
    ("origins", "hits", "want"),
    [([5, 6, 6, 5, 6], 9, 6), ([5, 6, 6, 5, -1], 4, 5), ([-1, 3, -1, -1, -1], 2, -1), ([4, -1, -1, -1, -1], 1, 4)],
)
def test_the_origin_of_a_track_is_the_most_frequent_of_its_newest_plots(origins, hits, want):
    got = report.most_frequent_origins(np.array([[9] * 5, origins]), np.array([5, hits]), np.array([1]))
    assert got.tolist() == [want]
