"""k-means spots: a partition with a halo that loses no pair."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.batches import Tracks
from coastwatch.geodesy import earth_centred, from_plane
from coastwatch.kernels.threads import threads
from coastwatch.server.checkpoint import load, save
from coastwatch.spots import KMeansSpots

SUMMING_M = 5e-3  # sums are of parts of a millimetre, three times over


def tracks(seed, n, spread_m=20e3, origin=(58.0, 179.9)):
    rng = np.random.default_rng([seed, 0])
    position = from_plane(rng.normal(0.0, spread_m, (n, 2)), np.array(origin))
    zero = np.zeros(n)
    return Tracks(
        np.arange(n),
        np.zeros(n, np.int64),
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


def test_every_track_is_in_the_nearest_spot():
    t = tracks(1, 200)
    method = KMeansSpots(count=7)
    _, spots = method.step(method.init(), t)
    distance = np.linalg.norm(earth_centred(t.position_deg)[:, None] - spots.centre_m[None], axis=2)
    np.testing.assert_array_equal(spots.spot, distance.argmin(axis=1))


def test_seeded_resumable_and_warm():
    method = KMeansSpots(count=5)
    memory, first = method.step(method.init(), tracks(1, 200))
    _, same = method.step(method.init(), tracks(1, 200))
    np.testing.assert_array_equal(first.centre_m, same.centre_m)
    frozen = save(memory)
    _, a = method.step(memory, tracks(2, 210))
    _, b = method.step(load(frozen), tracks(2, 210))
    np.testing.assert_array_equal(a.centre_m, b.centre_m)
    assert save(memory) == frozen
    moved = np.linalg.norm(a.centre_m - first.centre_m, axis=1)
    assert 0.0 < moved.max() < 20e3


def test_centroids_stay_when_told_to():
    method = KMeansSpots(count=5, warm_steps=0)
    memory, first = method.step(method.init(), tracks(1, 200))
    _, later = method.step(memory, tracks(2, 200))
    np.testing.assert_array_equal(first.centre_m, later.centre_m)


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


def test_threads_and_what_was_known_of_the_tracks_change_nothing():
    method = KMeansSpots(tracks_per_spot=20)
    answers = []
    for count, forgets in ((1, False), (2, False), (2, True)):
        memory = method.init()
        for cycle in range(3):
            t = tracks(1, 20_000)
            t = replace(t, position_deg=t.position_deg + 0.002 * cycle, track_id=t.track_id + (10**6 * cycle if forgets else 0))
            with threads(count):
                memory, spots = method.step(memory, t)
        by = np.lexsort((spots.halo_row, spots.halo_spot))
        answers.append(
            (spots.centre_m.tobytes(), spots.spot.tobytes(), spots.halo_spot.tobytes(), spots.halo_row[by].tobytes())
        )
    assert answers[0] == answers[1] == answers[2]


def test_warm_steps_are_those_of_lloyd():
    method, t = KMeansSpots(count=6, warm_steps=3), tracks(4, 300)
    memory, first = method.step(method.init(), t)
    moved = replace(t, position_deg=t.position_deg + np.random.default_rng([4, 1]).normal(0.0, 0.05, (300, 2)))
    _, spots = method.step(memory, moved)
    points, centre = earth_centred(moved.position_deg), first.centre_m
    for _ in range(3):
        nearest = np.linalg.norm(points[:, None] - centre[None], axis=2).argmin(axis=1)
        centre = np.array([points[nearest == k].mean(0) for k in range(6)])
    np.testing.assert_allclose(spots.centre_m, centre, rtol=0.0, atol=SUMMING_M)


@pytest.mark.parametrize(("seed", "n", "count"), [(3, 4000, 25), (4, 12000, 40), (5, 900, 60)])
def test_spots_after_some_cycles_are_as_compact_as_those_of_scikit_learn(seed, n, count):
    """Both find a local best of their own, from seeds of their own: within a tenth of each other."""
    from sklearn.cluster import KMeans

    t = tracks(seed, n)
    method = KMeansSpots(count=count)
    memory = method.init()
    for _ in range(10):
        memory, spots = method.step(memory, t)
    points = earth_centred(t.position_deg)
    ours = ((points - spots.centre_m[spots.spot]) ** 2).sum()
    shift = points.mean(0)
    theirs = KMeans(count, init="k-means++", n_init=1, random_state=seed).fit(points - shift).inertia_
    assert ours < 1.1 * theirs
