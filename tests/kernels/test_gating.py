"""Near pairs against all pairs, and gates against the chi-square distribution."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from coastwatch.kernels.filters.gaussian import gate, squared_distance
from coastwatch.kernels.geometry.neighbours import near_pairs


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 10**6))
def test_near_pairs_are_all_that_are_near(n, m, seed):
    rng = np.random.default_rng([seed, 5])
    centre, points = rng.integers(-9, 10, (n, 2)).astype(float), rng.integers(-9, 10, (m, 2)).astype(float)
    radius = rng.integers(0, 8, n).astype(float)
    first, second = near_pairs(centre, radius, points)
    square = ((centre[:, None] - points) ** 2).sum(axis=-1)
    want = np.nonzero(square <= (radius**2)[:, None])
    assert np.array_equal(first, want[0])
    assert np.array_equal(second, want[1])


@pytest.mark.parametrize("dimensions", [1, 2, 4])
@pytest.mark.parametrize("probability", [0.5, 0.99, 0.9999])
def test_gate_is_the_chi_square_quantile(dimensions, probability):
    assert gate(probability, dimensions) == pytest.approx(chi2.ppf(probability, dimensions), rel=1e-9)


def test_squared_distance_of_a_turned_ellipse():
    covariance = np.array([[[2.0, 1.0], [1.0, 3.0]]])
    d = np.array([[1.0, -2.0]])
    assert squared_distance(d, covariance)[0] == pytest.approx(d[0] @ np.linalg.inv(covariance[0]) @ d[0])
    assert squared_distance(np.zeros((0, 2)), np.zeros((0, 2, 2))).shape == (0,)
