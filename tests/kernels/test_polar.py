"""The unbiased polar conversion: no bias, and the covariance that it says, over many draws."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.kernels.geometry.polar import polar_to_plane

DRAWS = 200_000


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
