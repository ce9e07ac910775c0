"""Which places are near which sites: against every distance."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.geodesy import earth_centred, to_plane
from coastwatch.kernels.geometry.sensor_coverage import MARGIN, SLACK_M, near_sites
from coastwatch.kernels.threads import threads


def world(seed: int, middle_deg: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places, some of them hardly known, and sites with reaches of their own."""
    rng = np.random.default_rng([seed, 5])
    place = np.array(middle_deg) + rng.uniform(-1.0, 1.0, (9000, 2))
    site = np.array(middle_deg) + rng.uniform(-1.0, 1.0, (40, 2))
    for where in (place, site):
        where[:, 1] = (where[:, 1] + 180.0) % 360.0 - 180.0
    sigma = np.where(rng.uniform(size=9000) < 0.01, rng.uniform(SLACK_M / 3.0, 9000.0, 9000), rng.uniform(1.0, 100.0, 9000))
    sigma[::50] = np.nan
    covariance = np.eye(4) * sigma[:, None, None] ** 2
    return place, site, rng.uniform(500.0, 9000.0, 40), covariance


@pytest.mark.parametrize("middle_deg", [(-22.9, -43.1), (0.0, 180.0), (88.9, 10.0), (0.0, 0.0)])
@pytest.mark.parametrize("sigmas", [0.0, 3.0])
def test_no_pair_is_left_out(middle_deg: tuple[float, float], sigmas: float) -> None:
    place, site, reach, covariance = world(1, middle_deg)
    apart = np.linalg.norm(earth_centred(place)[:, None] - earth_centred(site), axis=2)
    most = reach + sigmas * np.sqrt(np.nan_to_num(covariance[:, 0, 0]))[:, None]
    row, found, east_north = near_sites(place, site, reach, covariance, sigmas)
    np.testing.assert_allclose(east_north, to_plane(place[row], site[found]), rtol=0.0, atol=1e-6)
    order = np.lexsort((found, row))
    assert (order == np.arange(len(order))).all()
    pairs = row * 40 + found
    assert np.isin(np.ravel_multi_index(np.nonzero(apart <= most), apart.shape), pairs).all()
    assert (apart[row, found] <= MARGIN * most[row, found] + 1e-6).all()
    assert len(pairs) > 500
    with threads(3):
        again = near_sites(place, site, reach, covariance, sigmas)
    for one, other in zip(again, (row, found, east_north), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("reach_m", [300_000.0, 4_000_000.0])
def test_no_pair_is_left_out_of_those_far_apart(reach_m: float) -> None:
    rng = np.random.default_rng([int(reach_m), 6])
    place, site = (np.column_stack([rng.uniform(-90.0, 90.0, n), rng.uniform(-180.0, 180.0, n)]) for n in (5000, 20))
    place[0], place[1], site[0] = (90.0, 0.0), (-90.0, 180.0), (-90.0, 0.0)
    reach = rng.uniform(0.1, 1.0, 20) * reach_m
    apart = np.linalg.norm(earth_centred(place)[:, None] - earth_centred(site), axis=2)
    row, found, _ = near_sites(place, site, reach)
    assert np.isin(np.ravel_multi_index(np.nonzero(apart <= reach), apart.shape), row * 20 + found).all()
    assert (apart[row, found] <= MARGIN * reach[found] + 1e-6).all()
    assert len(row) > 20


def test_nothing_near_nothing() -> None:
    place, site, reach, _ = world(2, (10.0, 10.0))
    for some, where, far in (
        (place[:0], site, reach),
        (place, site[:0], reach[:0]),
        (place + np.array([0.0, 90.0]), site, reach),
    ):
        assert [a.tolist() for a in near_sites(some, where, far)] == [[], [], []]
