"""Nearest centroids, means, borders, seeds and groups against all distances and numpy; nothing depends on guess or threads."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.geodesy import earth_centred, from_plane
from coastwatch.kernels.geometry.centroids import divided, lay, means
from coastwatch.kernels.geometry.ellipsoid import ecef_of_rows
from coastwatch.kernels.geometry.seeding import seeds
from coastwatch.kernels.tables.sorting import by_key, joined, runs_by_key
from coastwatch.kernels.threads import threads

ROUNDING_M = 1e-8  # of places as far from the centre of the Earth as its surface
SUMMING_M = 2e-3  # sums are of parts of a millimetre


def water(seed, n, spread_m=20e3, origin=(58.0, 179.9)):
    rng = np.random.default_rng([seed, 0])
    return from_plane(rng.normal(0.0, spread_m, (n, 2)), np.array(origin))


def centroids(seed, position, count):
    """Some of the points, some other places, and one place twice."""
    rng = np.random.default_rng([seed, 1])
    points = earth_centred(position)
    centre = points[rng.integers(0, len(points), count)] + rng.normal(0.0, 3000.0, (count, 3)) * rng.integers(0, 2, (count, 1))
    centre[count // 2] = centre[0]
    return centre


def squared(position, centre):
    points = ecef_of_rows(position, np.arange(len(position)))
    d = points[:, None] - centre[None]
    return d[..., 0] ** 2 + d[..., 1] ** 2 + d[..., 2] ** 2


def rule_of_the_halo(d2, centre, spot, reach_m):
    """Every other centroid with |y - A| <= |y - B| + 2 r whose border with the own is no farther than r: (H,) spot, (H,) row."""
    distance = np.sqrt(d2)
    own = distance[np.arange(len(spot)), spot]
    gap = np.linalg.norm(centre[spot][:, None] - centre[None], axis=2)
    to_border = (d2 - (own**2)[:, None]) / (2.0 * np.maximum(gap, 1e-9))
    within = (distance <= own[:, None] + 2.0 * reach_m) & ((to_border <= reach_m) | (gap == 0.0))
    within[np.arange(len(spot)), spot] = False
    return np.nonzero(within.T)


@given(st.integers(0, 10**6), st.integers(1, 150), st.integers(1, 40), st.floats(0.0, 8000.0))
def test_nearest_centroid_and_halo_from_any_guess(seed, n, count, halo_m):
    position = water(seed, n)
    centre = centroids(seed, position, count)
    guess = np.random.default_rng([seed, 2]).integers(0, count, n)
    spot, halo_spot, halo_row = divided(lay(position, guess, count), centre, halo_m)
    d2 = squared(position, centre)
    np.testing.assert_array_equal(spot, d2.argmin(axis=1))
    want_spot, want_row = rule_of_the_halo(d2, centre, spot, halo_m)
    by = np.lexsort((halo_row, halo_spot))
    np.testing.assert_array_equal(halo_spot, np.sort(halo_spot))
    np.testing.assert_array_equal((halo_spot[by], halo_row[by]), (want_spot, want_row))


@given(st.integers(0, 10**6), st.integers(1, 150), st.integers(1, 40))
def test_means_are_those_of_the_nearest_points_whatever_the_guess(seed, n, count):
    position = water(seed, n)
    centre = centroids(seed, position, count)
    nearest, points = squared(position, centre).argmin(axis=1), earth_centred(position)
    want = np.array([points[nearest == k].mean(0) if (nearest == k).any() else centre[k] for k in range(count)])
    first = means(lay(position, np.zeros(n, np.int64), count), centre)
    np.testing.assert_allclose(first, want, rtol=0.0, atol=SUMMING_M)
    assert first.tobytes() == means(lay(position, nearest, count), centre).tobytes()


def test_threads_and_guesses_change_no_bit():
    position = water(5, 30_000, 100e3)
    centre = centroids(5, position, 300)
    rng = np.random.default_rng([5, 3])
    answers = []
    for count, guess in ((1, rng.integers(0, 300, 30_000)), (3, np.full(30_000, 299)), (2, np.zeros(30_000, np.int64))):
        with threads(count):
            laid = lay(position, guess, 300)
            spot, halo_spot, halo_row = divided(laid, means(laid, centre), 1500.0)
        by = np.lexsort((halo_row, halo_spot))
        answers.append((means(laid, centre).tobytes(), spot.tobytes(), halo_spot.tobytes(), halo_row[by].tobytes()))
    assert answers[0] == answers[1] == answers[2]
    assert len(halo_row) > 5_000


@given(st.integers(0, 10**6), st.integers(0, 300), st.integers(1, 30), st.integers(1, 3))
def test_groups(seed, n, count, workers):
    rng = np.random.default_rng([seed, 0])
    key, size = rng.integers(0, count, n), rng.integers(0, 5, n)
    with threads(workers):
        row, start = by_key(key, count)
        runs = runs_by_key(key, size, np.arange(size.sum()), count)
        both = joined(row, start, row + 1000, start)
    np.testing.assert_array_equal(row, np.argsort(key, kind="stable"))
    np.testing.assert_array_equal(start, np.searchsorted(np.sort(key), np.arange(count + 1)))
    run = np.repeat(np.arange(n), size)
    order = np.argsort(key[run], kind="stable")
    np.testing.assert_array_equal(runs, (key[run][order], order))
    parts = [np.concatenate([row[a:b], row[a:b] + 1000]) for a, b in pairwise(start)]
    np.testing.assert_array_equal(both[0], np.concatenate(parts))
    np.testing.assert_array_equal(both[1], 2 * start)


def test_seeds_reach_every_port_and_know_their_points():
    rng = np.random.default_rng([9, 0])
    ports = rng.uniform(-500e3, 500e3, (40, 3))
    points = np.ascontiguousarray((ports[np.repeat(np.arange(40), 100)] + rng.normal(0.0, 500.0, (4000, 3))).T)
    seed, nearest = seeds(points, rng.random(40))
    d2 = ((points[:, None] - points[:, seed][:, :, None]) ** 2).sum(0)
    np.testing.assert_array_equal(nearest, d2.argmin(axis=0))
    assert len(np.unique(seed // 100)) >= 38
    everywhere = np.zeros((3, 5))
    assert seeds(everywhere, rng.random(5))[1].tolist() == [0] * 5
