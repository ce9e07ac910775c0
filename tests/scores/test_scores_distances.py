"""NEES, OSPA, GOSPA against brute force and by hand."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from nees_band import band
from scipy.stats import chi2

from coastwatch.scores.nees import nees
from coastwatch.scores.ospa import gospa, ospa

pytestmark = pytest.mark.oracle

SEED = 20240117
TIGHT = 1e-9  # of sums of a few powers


def points(count, seed, spread=30.0):
    return np.random.default_rng([SEED, seed]).uniform(0.0, spread, (count, 2))


def by_all_assignments(x, y, cutoff, order):
    """GOSPA from its definition: over all partial assignments."""
    best = np.inf
    for k in range(min(len(x), len(y)) + 1):
        for rows in combinations(range(len(x)), k):
            for columns in permutations(range(len(y)), k):
                d = np.linalg.norm(x[list(rows)] - y[list(columns)], axis=1) if k else np.zeros(0)
                best = min(best, float((d**order).sum()) + 0.5 * cutoff**order * (len(x) + len(y) - 2 * k))
    return best ** (1.0 / order)


@given(
    st.integers(0, 4), st.integers(0, 4), st.integers(0, 10**6), st.sampled_from([5.0, 15.0, 60.0]), st.sampled_from([1.0, 2.0])
)
def test_gospa_is_the_least_over_all_assignments(n, v, seed, cutoff, order):
    x, y = points(n, seed), points(v, seed + 1)
    got = gospa(x, y, cutoff, order)
    assert got.total_m == pytest.approx(by_all_assignments(x, y, cutoff, order), abs=TIGHT)
    assert got.assigned_count + got.missed_count == v
    assert got.assigned_count + got.false_count == n
    parts = got.localisation + 0.5 * cutoff**order * (got.missed_count + got.false_count)
    assert got.total_m**order == pytest.approx(parts, abs=TIGHT)


def test_gospa_by_hand():
    got = gospa(np.array([[0.0, 0.0], [100.0, 0.0]]), np.array([[3.0, 4.0]]), 20.0, 2.0)
    assert got == pytest.approx((np.sqrt(25.0 + 200.0), 25.0, 1, 0, 1))
    assert gospa(np.zeros((0, 2)), np.zeros((0, 2)), 20.0, 2.0).total_m == 0.0


def test_gospa_of_many():
    y = points(3000, 5, 50_000.0)
    got = gospa(y[::-1] + 1.0, y, 20.0, 2.0)
    assert got.assigned_count == 3000
    assert got.localisation <= 6000.0 + TIGHT


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 10**6), st.sampled_from([1.0, 2.0]))
def test_ospa_is_the_least_over_all_assignments(n, v, seed, order):
    x, y = points(n, seed), points(v, seed + 1)
    got = ospa(gospa(x, y, 12.0, order), 12.0, order)
    few, many = (x, y) if n <= v else (y, x)
    costs = [
        sum(min(np.linalg.norm(a - many[j]), 12.0) ** order for a, j in zip(few, p, strict=True))
        for p in permutations(range(len(many)), len(few))
    ]
    most = max(n, v)
    want = ((min(costs) + 12.0**order * (most - len(few))) / most) ** (1.0 / order) if most else 0.0
    assert got.total_m == pytest.approx(want, abs=TIGHT)
    assert got.total_m**order == pytest.approx(got.localisation_m**order + got.cardinality_m**order, abs=TIGHT)
    assert got == pytest.approx(ospa(gospa(y, x, 12.0, order), 12.0, order), abs=TIGHT)


def test_nees_of_normal_errors_is_in_its_band():
    rng = np.random.default_rng([SEED, 1])
    root = rng.normal(size=(500, 4, 4)) + 3.0 * np.eye(4)
    covariance = root @ root.transpose(0, 2, 1)
    error = np.einsum("nij,nj->ni", root, rng.normal(size=(500, 4)))
    values = nees(error, covariance)
    low, high = band(500, 4, 1e-6)
    assert low < values.mean() < high
    assert not low < nees(error, 0.5 * covariance).mean() < high


def test_a_singular_covariance_has_no_nees():
    """`coastwatch reproduce rangel` ended with a traceback of it."""
    along = np.array([0.25, 0.5, -1.0, 2.0])  # exact in binary: elimination ends with a zero
    values = nees(np.ones((3, 4)), np.stack([np.eye(4), np.outer(along, along), 2.0 * np.eye(4)]))
    assert values[[0, 2]].tolist() == [4.0, 2.0]
    assert np.isnan(values[1])


def test_nees_by_hand_and_missing():
    values = nees(np.array([[3.0, 4.0], [np.nan, 0.0]]), np.array([np.diag([9.0, 4.0]), np.eye(2)]))
    assert values[0] == pytest.approx(1.0 + 4.0)
    assert np.isnan(values[1])
    asymmetric = np.array([[[2.0, 1.0], [1.0, 3.0]]])
    assert nees(np.array([[1.0, 2.0]]), asymmetric)[0] == pytest.approx(
        np.array([1, 2]) @ np.linalg.inv(asymmetric[0]) @ [1, 2]
    )


def test_band_is_chi_square():
    low, high = band(40, 2, 0.05)
    np.testing.assert_allclose([low, high], chi2.ppf([0.025, 0.975], 80) / 40)
