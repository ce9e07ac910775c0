"""The grid finds every point that may lie in an ellipse, and few others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.geometry import grid

pytestmark = pytest.mark.oracle


def scene(n: int, m: int, seed: int):
    """Points with isotropic covariances of unlike size, displaced by up to their drift, and long thin ellipses."""
    rng = np.random.default_rng([seed, 31])
    points = rng.uniform(-1000.0, 1000.0, (n, 2)) * rng.choice([0.1, 1.0, 3.0], (n, 1))
    sigma, drift = 10.0 ** rng.uniform(0.0, 2.5, n), rng.uniform(0.0, 60.0, n)
    centre, angle = rng.uniform(-1200.0, 1200.0, (m, 2)), rng.uniform(0.0, np.pi, m)
    long, across = np.column_stack([np.sin(angle), np.cos(angle)]), np.column_stack([np.cos(angle), -np.sin(angle)])
    size = 10.0 ** rng.uniform(0.0, 4.5, (2, m, 1, 1))
    covariance = size[0] * long[:, :, None] * long[:, None] + size[1] * across[:, :, None] * across[:, None]
    return points, sigma, drift, centre, covariance


@given(st.integers(0, 60), st.integers(0, 20), st.integers(0, 10**6))
def test_no_point_of_an_ellipse_is_missed(n, m, seed):
    points, sigma, drift, centre, covariance = scene(n, m, seed)
    cells = grid.build(points, sigma, drift, (-1000.0, -1000.0), (1000.0, 1000.0))
    start, found = grid.near(cells, centre, covariance, 13.8)
    direction = np.random.default_rng([seed, 32]).uniform(0.0, 2.0 * np.pi, n)
    moved = points + drift[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    for k in range(m):
        got = found[start[k] : start[k + 1]]
        assert len(np.unique(got)) == len(got)
        for points_now in (points, moved):
            gap = points_now - centre[k]
            both = covariance[k] + sigma[:, None, None] ** 2 * np.eye(2)
            square = (gap * np.linalg.solve(both, gap[..., None])[..., 0]).sum(axis=1)
            assert np.isin(np.flatnonzero(square <= 13.8), got).all()


def test_a_thin_ellipse_is_not_searched_as_a_square():
    """Plots of a far radar: 600 m across, 10 m along, turned by 30 degrees; a thousand certain points in 4 km2."""
    rng = np.random.default_rng([33, 1])
    points, n = rng.uniform(-1000.0, 1000.0, (1000, 2)), 1000
    cells = grid.build(points, np.full(n, 5.0), np.zeros(n), (-1000.0, -1000.0), (1000.0, 1000.0))
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    thin = turn @ np.diag([600.0**2, 10.0**2]) @ turn.T
    _, found = grid.near(cells, np.zeros((1, 2)), thin[None], 13.8)
    assert 20 < len(found) < 200


def test_one_uncertain_point_does_not_widen_the_search_for_the_others():
    rng = np.random.default_rng([34, 1])
    points, sigma = rng.uniform(-5000.0, 5000.0, (2000, 2)), np.full(2000, 10.0)
    sigma[0] = 1500.0
    cells = grid.build(points, sigma, np.zeros(2000), (-5000.0, -5000.0), (5000.0, 5000.0))
    _, found = grid.near(cells, np.zeros((1, 2)), np.diag([100.0, 100.0])[None], 13.8)
    assert len(found) < 10


def test_points_in_one_place_and_on_a_line():
    for points in (np.zeros((50, 2)), np.column_stack([np.arange(50.0), np.zeros(50)])):
        low, high = (points[:, 0].min(), points[:, 1].min()), (points[:, 0].max(), points[:, 1].max())
        cells = grid.build(points, np.ones(50), np.zeros(50), low, high)
        _, found = grid.near(cells, points[:1], np.eye(2)[None] * 1e4, 13.8)
        assert len(found) == 50
