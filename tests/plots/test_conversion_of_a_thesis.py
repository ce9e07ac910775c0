"""Polar to Cartesian as printed in a thesis: its bias and covariance are right, and the house's conversion agrees with them.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, (3.1) and (3.2); (3.1) with its brackets put right.
"""

from __future__ import annotations

import numpy as np
import pytest
from polar_textbook import polar_to_plane

pytestmark = pytest.mark.golden

CASES = [(5000.0, 0.5, 20.0, 0.02), (3000.0, 2.0, 10.0, 0.03)]


def bias(distance, azimuth, sigma):
    """(3.1): of north and east, that a plain conversion has."""
    return distance * np.array([np.cos(azimuth), np.sin(azimuth)]) * (np.exp(-(sigma**2)) - np.exp(-0.5 * sigma**2))


def covariance(distance, azimuth, distance_sigma, sigma):
    """(3.2): of north and east."""
    a, cos2, sin2 = sigma**2, np.cos(azimuth) ** 2, np.sin(azimuth) ** 2
    even, odd = np.cosh(2 * a) - np.cosh(a), np.sinh(2 * a) - np.sinh(a)
    even_r, odd_r = 2 * np.cosh(2 * a) - np.cosh(a), 2 * np.sinh(2 * a) - np.sinh(a)
    r2, s2 = distance**2, distance_sigma**2
    one = np.exp(-2 * a) * (r2 * (cos2 * even + sin2 * odd) + s2 * (cos2 * even_r + sin2 * odd_r))
    two = np.exp(-2 * a) * (r2 * (sin2 * even + cos2 * odd) + s2 * (sin2 * even_r + cos2 * odd_r))
    both = np.sin(azimuth) * np.cos(azimuth) * np.exp(-4 * a) * (s2 + (r2 + s2) * (1 - np.exp(a)))
    return np.array([[one, both], [both, two]])


@pytest.mark.parametrize(("distance", "azimuth", "distance_sigma", "sigma"), CASES)
def test_the_bias_and_the_covariance_are_those_of_many_draws(distance, azimuth, distance_sigma, sigma):
    rng, n = np.random.default_rng([31]), 400_000
    r, t = distance + distance_sigma * rng.standard_normal(n), azimuth + sigma * rng.standard_normal(n)
    true = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
    error = np.stack([r * np.cos(t), r * np.sin(t)]) - true[:, None] - bias(r, t, sigma)
    spread = np.cov(error)
    assert np.abs(error.mean(axis=1)).max() < 5.0 * np.sqrt(np.diag(spread).max() / n)
    want = np.mean([covariance(r[k], t[k], distance_sigma, sigma) for k in range(2000)], axis=0)
    assert spread == pytest.approx(want, rel=0.06)


@pytest.mark.parametrize(("distance", "azimuth", "distance_sigma", "sigma"), CASES)
def test_the_conversion_of_the_house_agrees(distance, azimuth, distance_sigma, sigma):
    point, spread = polar_to_plane(*(np.array([x]) for x in (distance, azimuth, distance_sigma, sigma)))
    north_east = distance * np.array([np.cos(azimuth), np.sin(azimuth)]) - bias(distance, azimuth, sigma)
    assert point[0, ::-1] == pytest.approx(north_east, abs=0.01)
    assert spread[0, ::-1, ::-1] == pytest.approx(covariance(distance, azimuth, distance_sigma, sigma), rel=0.02)
