"""k-means spots: a partition with a halo that loses no pair."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial import cKDTree

from coastwatch.batches import Tracks
from coastwatch.geodesy import earth_centred, from_plane
from coastwatch.kernels.threads import threads
from coastwatch.server.checkpoint import load, save
from coastwatch.spots import KMeansSpots
from coastwatch.spots.kmeans import assigned

pytestmark = pytest.mark.contract


def tracks(seed, n, spread_m=20e3, origin=(58.0, 179.9)):
    rng = np.random.default_rng([seed, 0])
    position = from_plane(rng.normal(0.0, spread_m, (n, 2)), np.array(origin))
    zero = np.zeros(n)
    return Tracks(
        np.arange(n),
        np.arange(n) % 2,
        zero,
        position,
        np.zeros((n, 2)),
        np.zeros((n, 4, 4)),
        np.zeros((n, 2, 2)),
        zero,
        zero,
        np.full(n, -1),
        np.arange(n),
    )


@given(st.integers(0, 10**6), st.integers(1, 120), st.integers(1, 30), st.floats(0.0, 8000.0))
def test_every_pair_within_reach_is_in_the_spot_of_either(seed, n, count, halo_m):
    t = tracks(seed, n)
    method = KMeansSpots(count=count, halo_m=halo_m)
    _, spots = method.step(method.init(), t)
    points = earth_centred(t.position_deg)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= halo_m
    in_spot = np.zeros((len(spots.centre_m), n), bool)
    in_spot[spots.spot, np.arange(n)] = True
    in_spot[spots.halo_spot, spots.halo_row] = True
    a, b = np.nonzero(near)
    assert in_spot[spots.spot[a], b].all()


@given(st.integers(0, 10**6), st.integers(1, 300), st.integers(1, 60), st.sampled_from([0.0, 500.0, 20e3]))
def test_spots_and_halos_are_those_of_a_tree_whatever_the_guess(seed, n, count, halo_m):
    rng = np.random.default_rng([seed, 3])
    points, centre = rng.normal(0.0, 20e3, (n, 3)), rng.normal(0.0, 20e3, (count, 3))
    spot, halo_spot, halo_row = assigned(points, rng.integers(0, count, n), centre, halo_m)
    distance, nearest = cKDTree(centre).query(points)
    np.testing.assert_array_equal(spot, nearest)
    near = cKDTree(centre).query_ball_point(points, distance + 2.0 * halo_m)
    wanted = sorted((k, row) for row in range(n) for k in near[row] if k != spot[row]) if halo_m else []
    assert list(zip(halo_spot.tolist(), halo_row.tolist(), strict=True)) == wanted


def test_tracks_of_one_source_alone_are_one_spot():
    t = tracks(1, 900)
    method = KMeansSpots()
    _, spots = method.step(method.init(), replace(t, source=np.full(900, 3)))
    assert spots.spot.tolist() == [0] * 900
    np.testing.assert_allclose(spots.centre_m, earth_centred(t.position_deg).mean(axis=0, keepdims=True))
    assert len(spots.halo_row) == 0


def test_every_track_is_in_the_nearest_spot():
    t = tracks(1, 200)
    method = KMeansSpots(count=7)
    _, spots = method.step(method.init(), t)
    distance = np.linalg.norm(earth_centred(t.position_deg)[:, None] - spots.centre_m[None], axis=2)
    np.testing.assert_array_equal(spots.spot, distance.argmin(axis=1))


def test_seeded_resumable_and_fitted_again_when_due():
    method = KMeansSpots(count=5, fit_every=2)
    memory, first = method.step(method.init(), tracks(1, 200))
    _, same = method.step(method.init(), tracks(1, 200))
    np.testing.assert_array_equal(first.centre_m, same.centre_m)
    memory, second = method.step(memory, tracks(2, 210))
    np.testing.assert_array_equal(first.centre_m, second.centre_m)
    frozen = save(memory)
    _, a = method.step(memory, tracks(2, 210))
    _, b = method.step(load(frozen), tracks(2, 210))
    np.testing.assert_array_equal(a.centre_m, b.centre_m)
    assert save(memory) == frozen
    moved = np.linalg.norm(a.centre_m - first.centre_m, axis=1)
    assert 0.0 < moved.max() < 20e3


@pytest.mark.parametrize(("n", "count", "want"), [(0, 0, 0), (1, 0, 1), (1, 5, 1), (900, 0, 3), (900, 4, 4)])
def test_number_of_spots(n, count, want):
    method = KMeansSpots(count=count)
    _, spots = method.step(method.init(), tracks(1, n))
    assert len(spots.centre_m) == want


def test_the_number_of_spots_follows_that_of_the_tracks_with_a_delay():
    method = KMeansSpots(tracks_per_spot=10)
    memory, counts = method.init(), []
    for n in (200, 209, 191, 250, 251, 200, 190, 1, 5):
        memory, spots = method.step(memory, tracks(1, n))
        counts.append(len(spots.centre_m))
    assert counts == [20, 20, 20, 20, 26, 26, 19, 1, 1]


def test_threads_and_the_order_of_tracks_change_nothing():
    t, method = tracks(1, 9000), KMeansSpots(tracks_per_spot=20)
    order = np.random.default_rng([1, 1]).permutation(len(t))
    found = []
    for count, rows in ((1, np.arange(len(t))), (2, np.arange(len(t))), (1, order)):
        with threads(count):
            _, spots = method.step(method.init(), t.take(rows))
        spot = np.empty(len(t), np.int64)
        spot[rows] = spots.spot
        by = np.lexsort((rows[spots.halo_row], spots.halo_spot))
        found.append(
            [spots.centre_m.tobytes(), spot.tobytes(), spots.halo_spot[by].tobytes(), rows[spots.halo_row][by].tobytes()]
        )
    assert found[0] == found[1] == found[2]


def test_no_halo_where_none_is_asked_for():
    _, spots = KMeansSpots(count=7, halo_m=0.0).step(KMeansSpots().init(), tracks(1, 200))
    assert len(spots.halo_row) == 0


def test_tracks_in_one_place_are_one_spot_and_empty_ones():
    t = tracks(1, 9)
    _, spots = KMeansSpots(count=3).step(KMeansSpots().init(), replace(t, position_deg=np.tile(t.position_deg[:1], (9, 1))))
    assert len(np.unique(spots.spot)) == 1
