"""Which positions are in range of which sensors, and of any, against every distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.geodesy import SEMI_MAJOR_M, axes, earth_centred, offset_deg, within_any
from coastwatch.kernels.geometry.sensor_coverage import SLACK_M, coverage_of, in_any_range, pairs_in_range
from coastwatch.kernels.threads import threads

pytestmark = pytest.mark.oracle


def offsets(position: np.ndarray, site: np.ndarray) -> np.ndarray:
    """East, north and up of each position from each site. Returns: (V, R, 3)."""
    apart = earth_centred(position)[:, None] - earth_centred(site)
    return np.einsum("rij,vrj->vri", axes(site), apart)


def pairs_by_every_distance(site: np.ndarray, reach: np.ndarray, position: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Pairs as position * R + sensor."""
    off = offsets(position, site)
    inside = (np.hypot(off[:, :, 0], off[:, :, 1]) <= reach + tolerance[:, None]) & (off[:, :, 2] > -SEMI_MAJOR_M)
    return np.flatnonzero(inside)


@pytest.mark.parametrize("middle_deg", [(-22.9, -43.1), (0.0, 180.0), (88.9, 10.0), (0.0, 0.0)])
@pytest.mark.parametrize("known_exactly", [True, False])
def test_pairs_are_those_of_every_distance(middle_deg: tuple[float, float], known_exactly: bool) -> None:
    rng = np.random.default_rng([1, 5])
    position, site = (np.array(middle_deg) + rng.uniform(-1.0, 1.0, (n, 2)) for n in (9000, 40))
    for where in (position, site):
        where[:, 1] = (where[:, 1] + 180.0) % 360.0 - 180.0
    tolerance = np.where(rng.uniform(size=9000) < 0.01, rng.uniform(SLACK_M, 27_000.0, 9000), rng.uniform(0.0, 300.0, 9000))
    tolerance = np.zeros(9000) if known_exactly else tolerance
    reach = rng.uniform(500.0, 9000.0, 40)
    row, sensor, offset = pairs_in_range(site, reach, position, tolerance)
    np.testing.assert_array_equal(row * 40 + sensor, pairs_by_every_distance(site, reach, position, tolerance))
    np.testing.assert_allclose(offset, offsets(position, site)[row, sensor, :2], rtol=0.0, atol=1e-6)
    assert len(row) > 500
    with threads(3):
        again = pairs_in_range(site, reach, position, tolerance)
    for one, other in zip(again, (row, sensor, offset), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("reach_m", [300_000.0, 4_000_000.0])
def test_pairs_far_apart(reach_m: float) -> None:
    rng = np.random.default_rng([int(reach_m), 6])
    position, site = (np.column_stack([rng.uniform(-90.0, 90.0, n), rng.uniform(-180.0, 180.0, n)]) for n in (5000, 20))
    position[0], position[1], site[0] = (90.0, 0.0), (-90.0, 180.0), (-90.0, 0.0)
    reach, exactly = rng.uniform(0.1, 1.0, 20) * reach_m, np.zeros(5000)
    row, sensor, _ = pairs_in_range(site, reach, position, exactly)
    np.testing.assert_array_equal(row * 20 + sensor, pairs_by_every_distance(site, reach, position, exactly))
    assert len(row) > 20


def around(site: np.ndarray, reach: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """Positions about the sites: near their limits, a little within or beyond, or anywhere in twice the range."""
    k = rng.integers(0, len(site), count)
    away = reach[k] * np.where(rng.random(count) < 0.5, rng.normal(1.0, 0.01, count), rng.uniform(0.0, 2.0, count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    at = offset_deg(site[k], np.column_stack([np.cos(angle), np.sin(angle)]) * away[:, None])
    return np.column_stack([np.clip(at[:, 0], -89.99, 89.99), at[:, 1]])


@given(st.integers(1, 12), st.integers(0, 10**6), st.sampled_from([300.0, 8e3, 60e3, 400e3]))
def test_in_any_range_is_what_every_sensor_says(sites: int, seed: int, reach_m: float) -> None:
    rng = np.random.default_rng([seed, 51])
    site = np.column_stack([rng.uniform(-86.0, 86.0, sites), rng.uniform(-180.0, 180.0, sites)])
    site[1::3] = offset_deg(site[:1], rng.normal(0.0, reach_m, (len(site[1::3]), 2)))
    site[::4, 1] = 179.999
    reach = reach_m * rng.uniform(0.3, 1.5, sites)
    at = around(site, reach, rng, 400)
    np.testing.assert_array_equal(in_any_range(coverage_of(site, reach, 0.0), at), within_any(at, site, reach))


@pytest.mark.parametrize("pole", [-90.0, 90.0])
def test_a_site_at_a_pole_is_asked_whatever_the_longitude(pole: float) -> None:
    site, reach = np.array([[pole, 0.0]]), np.array([50e3])
    at = np.array([[pole * k, lon] for k in (0.9945, 0.9952, 1.0) for lon in (-180.0, -91.0, 0.0, 77.0, 180.0)])
    found = in_any_range(coverage_of(site, reach, 0.0), at)
    np.testing.assert_array_equal(found, within_any(at, site, reach))
    assert found.any()
    assert not found.all()


def test_the_other_side_of_the_earth_is_out_of_range() -> None:
    """There the tangent plane at the site is as near as at the site itself."""
    coverage = coverage_of(np.array([[0.0, 0.0]]), np.array([50e3]), 0.0)
    assert in_any_range(coverage, np.array([[0.0, 180.0], [0.1, 0.1], [np.nan, 0.0]])).tolist() == [False, True, False]


def test_no_site_and_no_position() -> None:
    no_site, nowhere, somewhere = (np.zeros((0, 2)), np.zeros(0)), np.zeros((0, 2)), np.array([[0.0, 0.0], [90.0, 180.0]])
    assert in_any_range(coverage_of(*no_site, 0.0), somewhere).tolist() == [False, False]
    assert len(in_any_range(coverage_of(*no_site, 0.0), nowhere)) == 0
    one_site = np.array([[10.0, 10.0]]), np.array([1000.0])
    for site, position in ((no_site, somewhere), (one_site, nowhere), (one_site, somewhere)):
        assert [a.tolist() for a in pairs_in_range(*site, position, np.zeros(len(position)))] == [[], [], []]
