"""Gates against the chi-square distribution, and squared distances against the inverse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from coastwatch.kernels.filters.gaussian import gate, squared_distance

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("dimensions", [1, 2, 4])
@pytest.mark.parametrize("probability", [0.5, 0.99, 0.9999])
def test_gate_is_the_chi_square_quantile(dimensions, probability):
    assert gate(probability, dimensions) == pytest.approx(chi2.ppf(probability, dimensions), rel=1e-9)


def test_squared_distance_of_a_turned_ellipse():
    covariance = np.array([[[2.0, 1.0], [1.0, 3.0]]])
    d = np.array([[1.0, -2.0]])
    assert squared_distance(d, covariance)[0] == pytest.approx(d[0] @ np.linalg.inv(covariance[0]) @ d[0])
    assert squared_distance(np.zeros((0, 2)), np.zeros((0, 2, 2))).shape == (0,)
