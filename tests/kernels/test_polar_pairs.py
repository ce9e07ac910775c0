"""Pairs of plots and vessels in polar cells against all pairs, and their differences against numpy over frames of every pair."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from coastwatch.geodesy import from_plane, offset_deg, to_plane, turn, wrap_rad
from coastwatch.kernels.association.polar_pairs import differences, near_pairs, sweeps

pytestmark = pytest.mark.oracle

EDGE = 1e-9  # m, rad: pairs so near the limit of the search may be in or out
DIFFERENCE_M, DIFFERENCE_RAD, VARIANCE_M2 = 1e-6, 1e-9, 1e-6  # rounding of Earth-centred coordinates


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 300), st.integers(0, 30), st.sampled_from([300.0, 5_000.0, 60_000.0]))
def test_near_pairs_are_those_of_all_pairs(seed, plots, vessels, reach):
    rng = np.random.default_rng([seed, 5])
    radar, of_vessel = rng.integers(0, 3, plots), np.sort(rng.integers(0, 3, vessels))
    distance, azimuth = rng.uniform(-50.0, reach, plots), rng.uniform(-7.0, 7.0, plots)
    place = np.column_stack([rng.uniform(0.0, reach, vessels), rng.uniform(-np.pi, np.pi, vessels)])
    search = np.column_stack([rng.uniform(1.0, 600.0, vessels), rng.uniform(0.01, 4.0, vessels)])
    got = near_pairs(radar, distance, azimuth, of_vessel, place, search)
    off = np.abs(distance - place[:, :1]), np.abs(wrap_rad(azimuth - place[:, 1:]))
    near = (of_vessel[:, None] == radar) & (off[0] <= search[:, :1]) & (off[1] <= search[:, 1:])
    on_edge = (np.abs(off[0] - search[:, :1]) < EDGE) | (np.abs(off[1] - search[:, 1:]) < EDGE)
    assert set(zip(got[1].tolist(), got[0].tolist(), strict=True)) ^ set(
        zip(*(k.tolist() for k in np.nonzero(near)), strict=True)
    ) <= set(zip(*(k.tolist() for k in np.nonzero(on_edge)), strict=True))
    assert (np.diff(got[1]) >= 0).all()
    assert len(set(zip(*(k.tolist() for k in got), strict=True))) == len(got[0])


def by_frames(vessel, plots, vessels):
    """The same differences by numpy, a frame for every pair."""
    time, distance, azimuth, site = plots
    vessel_time, position, velocity, covariance = (values[vessel] for values in vessels)
    rotation = turn(position, site)
    speed, ahead = (rotation @ velocity[:, :, None])[..., 0], time - vessel_time
    at = to_plane(position, site) + speed * ahead[:, None]
    r = np.hypot(at[:, 0], at[:, 1])
    along = at / r[:, None]
    across = np.column_stack([along[:, 1], -along[:, 0]])
    moved = covariance[:, :2, :2] + covariance[:, 2:, 2:] * (ahead**2)[:, None, None]
    moved = rotation @ moved @ rotation.swapaxes(-1, -2)
    rates = (speed * along).sum(axis=1), (speed * across).sum(axis=1) / r
    variances = (np.einsum("ki,kij,kj->k", axis, moved, axis) for axis in (along, across))
    return np.column_stack([distance - r, wrap_rad(azimuth - np.arctan2(at[:, 0], at[:, 1])), *rates, r, *variances])


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 84.0])
@pytest.mark.parametrize("moving", [False, True])
def test_differences_are_those_of_frames(latitude_deg, moving):
    rng = np.random.default_rng([6, int(latitude_deg) + 100, moving])
    vessels, n = 20, 300
    origin = np.array([latitude_deg, 179.95])
    at = np.column_stack([rng.uniform(2e3, 5e4, vessels), rng.uniform(2e3, 5e4, vessels)])
    root = rng.standard_normal((vessels, 4, 4))
    table = (
        rng.uniform(0.0, 3.0, vessels),
        from_plane(at, origin),
        rng.uniform(-15.0, 15.0, (vessels, 2)),
        root @ root.swapaxes(1, 2),
    )
    vessel = np.sort(rng.integers(0, vessels, n))
    site = offset_deg(np.tile(origin, (n, 1)), rng.uniform(-200.0, 200.0, (n, 2)) if moving else np.zeros((n, 2)))
    plots = rng.uniform(-10.0, 0.0, n), rng.uniform(1e3, 8e4, n), rng.uniform(-7.0, 7.0, n), site
    got, expected = differences(vessel, plots, table), by_frames(vessel, plots, table)
    for column, tolerance in enumerate(
        [DIFFERENCE_M, DIFFERENCE_RAD, DIFFERENCE_M, DIFFERENCE_RAD, DIFFERENCE_M, VARIANCE_M2, VARIANCE_M2]
    ):
        np.testing.assert_allclose(got[:, column], expected[:, column], rtol=0.0, atol=tolerance)


def test_differences_of_no_pair():
    none = np.zeros(0)
    vessels = none, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4, 4))
    assert differences(np.zeros(0, np.int64), (none, none, none, np.zeros((0, 2))), vessels).shape == (0, 7)


def test_sweeps_of_a_fixed_a_moving_and_a_silent_radar():
    radar, time = np.array([2, 0, 2, 0, 0]), np.array([5.0, 3.0, 4.0, 9.0, 1.0])
    site = np.array([[3.0, 4.0], [7.0, 7.0], [0.0, 0.0], [7.0, 7.0], [7.0, 7.0]])
    oldest, newest, shift = sweeps(radar, time, site, 3)
    assert oldest.tolist() == [4, -1, 2]
    assert newest.tolist() == [3, -1, 0]
    assert shift.tolist() == [0.0, 0.0, 5.0]
