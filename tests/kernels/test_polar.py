"""The unbiased polar conversion: no bias, and the covariance that it says, over many draws; the compiled twin that goes to a region."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.geodesy import from_plane, offset_deg, to_plane, turn
from coastwatch.kernels.geometry.radar_plane import to_region
from tests.oracles.polar_textbook import polar_to_plane

pytestmark = pytest.mark.oracle

DRAWS = 200_000
POSITION_M = 1e-6  # rounding of Earth-centred coordinates, twice
COVARIANCE = 1e-9  # of its trace: the same formula, other order of operations


def drawn(distance: float, azimuth: float, range_sigma: float, azimuth_sigma: float):
    rng = np.random.default_rng([17, int(distance)])
    measured = distance + range_sigma * rng.standard_normal(DRAWS), azimuth + azimuth_sigma * rng.standard_normal(DRAWS)
    sigmas = np.full(DRAWS, range_sigma), np.full(DRAWS, azimuth_sigma)
    points, covariance = polar_to_plane(*measured, *sigmas)
    return points - distance * np.array([np.sin(azimuth), np.cos(azimuth)]), covariance


@pytest.mark.parametrize("azimuth_sigma_deg", [0.3, 1.5, 10.0])
@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0, 135.0, 250.0])
def test_no_bias_and_consistent(azimuth_sigma_deg, azimuth_deg):
    error, covariance = drawn(9000.0, np.radians(azimuth_deg), 10.0, np.radians(azimuth_sigma_deg))
    sigma_of_mean = error.std(axis=0) / np.sqrt(DRAWS)
    assert (np.abs(error.mean(axis=0)) < 5.0 * sigma_of_mean).all()  # 5 sigma: red means wrong
    nees = (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=1)
    # 2 + 5 sqrt(4 / DRAWS) for Gaussian errors; the arc of a wide beam is no ellipse, hence 10 % there
    band = 5.0 * np.sqrt(4.0 / DRAWS) + (0.2 if azimuth_sigma_deg > 5.0 else 0.01)
    assert nees.mean() == pytest.approx(2.0, abs=band)


def test_plain_conversion_would_be_biased():
    """The test above can see the bias that it denies: at 10 deg the plain conversion is 137 m short."""
    error, _ = drawn(9000.0, 0.0, 10.0, np.radians(10.0))
    short = np.exp(-0.5 * np.radians(10.0) ** 2)
    plain = (error[:, 1] + 9000.0) * short - 9000.0
    assert plain.mean() == pytest.approx(-9000.0 * (1.0 - short), abs=5.0)


def test_covariance_is_symmetric_positive_even_at_no_range():
    rng = np.random.default_rng(5)
    distance = np.concatenate([np.zeros(10), rng.uniform(0.0, 30.0, 50), rng.uniform(30.0, 3e4, 50)])
    azimuth = rng.uniform(-10.0, 10.0, len(distance))
    _, covariance = polar_to_plane(distance, azimuth, np.full(len(distance), 10.0), np.full(len(distance), 0.005))
    assert np.array_equal(covariance[:, 0, 1], covariance[:, 1, 0])
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_small_noise_is_range_along_and_azimuth_across():
    _, covariance = polar_to_plane(np.array([5000.0]), np.array([0.0]), np.array([10.0]), np.array([0.001]))
    np.testing.assert_allclose(covariance[0], [[25.0, 0.0], [0.0, 100.0]], atol=1e-2)  # azimuth 5 m across, range 10 m along


def test_no_report():
    points, covariance = polar_to_plane(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))
    assert points.shape == (0, 2)
    assert covariance.shape == (0, 2, 2)


def over_degrees(radar, distance, azimuth, site, sigma, origin):
    """The general way: at the antenna, to latitude and longitude, to the plane of the region."""
    metres, covariance = polar_to_plane(distance, azimuth, sigma[radar, 0], sigma[radar, 1])
    rotation = turn(site, origin[radar])
    position = to_plane(from_plane(metres, site), origin[radar])
    return position, rotation @ covariance @ rotation.swapaxes(-1, -2), to_plane(site, origin[radar])


@pytest.mark.parametrize("latitude_deg", [-84.9, -23.0, 0.0, 44.0, 60.0, 84.9])
@pytest.mark.parametrize("moving", [False, True])
def test_to_the_region_in_one_pass(latitude_deg, moving):
    """Two regions across the antimeridian, three radars up to 100 km from their origins, ranges up to 120 km."""
    rng = np.random.default_rng([3, int(latitude_deg * 10) + 1000, moving])
    origin = np.array([[latitude_deg, 179.9], [latitude_deg, 179.9], [latitude_deg + 0.1, -179.8]])
    antenna = offset_deg(origin, rng.uniform(-1e5, 1e5, (3, 2)))
    sigma = np.column_stack([rng.uniform(5.0, 50.0, 3), np.radians(rng.uniform(0.1, 2.0, 3))])
    n = 400
    radar, distance, azimuth = rng.integers(0, 3, n), 1.2e5 * rng.random(n), rng.uniform(-7.0, 7.0, n)
    distance[:3] = 0.0
    site = offset_deg(antenna[radar], rng.uniform(-500.0, 500.0, (n, 2)) if moving else np.zeros((n, 2)))
    given = radar, distance, azimuth, site, sigma, origin
    got, expected = to_region(*given), over_degrees(*given)
    np.testing.assert_allclose(got[0], expected[0], rtol=0.0, atol=POSITION_M)
    size = np.trace(expected[1], axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose(got[1] / size, expected[1] / size, rtol=0.0, atol=COVARIANCE)
    np.testing.assert_allclose(got[2], expected[2], rtol=0.0, atol=POSITION_M)


def test_to_the_region_without_plots():
    empty = np.zeros(0)
    got = to_region(np.zeros(0, np.int64), empty, empty, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    assert [part.shape for part in got] == [(0, 2), (0, 2, 2), (0, 2)]
