"""The kernels of the fused tracks against the same in numpy: any number of tracks a vessel, anywhere on Earth."""

import dataclasses

import numpy as np
import pytest
from fused_by_arrays import Filtered, average, convex, intersection
from hypothesis import given, strategies as st

from coastwatch.batches import Associations, Measurements, Tracks
from coastwatch.fused_tracks import Convex, CovarianceIntersection, FusionInput, ImmOfTracks, WeightedAverage
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.threads import threads

pytestmark = pytest.mark.oracle

KINDS = np.array([0, 0, 1], np.int64)
SIGMA_M_S = 0.7
ROUNDING = 1e-9  # of the largest number of a covariance
ROUNDING_M = 1e-6


def world(count, seed, alike=False, near=False):
    """Tracks of vessels of one to five tracks, in any order; every fifth has no covariance where they may be alike.

    Vessels are anywhere on Earth, or near each other.
    """
    rng = np.random.default_rng([seed, 31])
    vessel = np.repeat(np.arange(count), rng.integers(1, 6, count)) if count else np.zeros(0, np.int64)
    vessel = rng.permutation(vessel)
    n = len(vessel)
    centre = np.column_stack([rng.uniform(-84.0, 84.0, count), rng.uniform(-180.0, 180.0, count)])
    centre[::3, 1] = 179.9995
    if near:
        centre = offset_deg(centre[:1], rng.normal(0.0, 300.0, (count, 2)))
    root = rng.normal(0.0, 1.0, (n, 4, 4)) * np.array([10.0, 10.0, 0.5, 0.5])[:, None] * rng.uniform(0.2, 3.0, (n, 1, 1))
    covariance = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(4)
    if alike:
        covariance[rng.random(n) < 0.2, 1, 3] = np.nan
    report = rng.normal(0.0, 10.0, (n, 2, 2))
    source, mmsi = rng.integers(0, 3, n), np.where(rng.random(n) < 0.5, -1, np.arange(n))
    position = offset_deg(centre[vessel], rng.normal(0.0, 60.0, (n, 2)))
    zero, clock, ids = np.zeros(n), np.zeros(n), np.arange(n)
    velocity, of_report = rng.normal(0.0, 5.0, (n, 2)), report @ report.transpose(0, 2, 1) + np.eye(2)
    tracks = Tracks(ids, source, clock, position, velocity, covariance, of_report, zero, zero, mmsi, ids)
    return tracks, vessel


def stepped(method, tracks, vessel):
    none = np.zeros(0, np.int64)
    given_to = Associations(none, none, np.zeros(0), vessel)
    return method.step(method.init(), FusionInput(tracks, Measurements.empty(), given_to, 0.0, KINDS))[1]


def same(fused, wanted):
    position, velocity, covariance = wanted
    assert np.abs(difference_m(fused.position_deg, position)).max(initial=0.0) < ROUNDING_M
    np.testing.assert_allclose(fused.velocity_m_s, velocity, rtol=0.0, atol=1e-9)
    size = np.abs(covariance).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(fused.covariance / size, covariance / size, rtol=0.0, atol=ROUNDING)
    np.testing.assert_array_equal(fused.covariance, fused.covariance.swapaxes(1, 2))


@given(st.integers(1, 40), st.integers(0, 10**6), st.sampled_from([0.0, 0.4]))
def test_convex(count, seed, registration):
    tracks, vessel = world(count, seed, alike=True)
    fused = stepped(Convex(registration=registration, unknown_velocity_sigma_m_s=SIGMA_M_S), tracks, vessel)
    same(fused, convex(tracks, tracks.known_covariance(SIGMA_M_S), vessel, registration))


def test_convex_does_not_depend_on_who_is_beside_a_vessel():
    tracks, vessel = world(200, 7, alike=True)
    together = stepped(Convex(registration=0.2), tracks, vessel)
    for v in range(200):
        rows = np.flatnonzero(vessel == v)
        alone = stepped(Convex(registration=0.2), tracks.take(rows), np.zeros(len(rows), np.int64))
        for column in ("position_deg", "velocity_m_s", "covariance"):
            assert getattr(alone, column)[0].tobytes() == getattr(together, column)[v].tobytes()


@pytest.mark.parametrize("of_vessel", [2, 3])
def test_convex_refuses_a_singular_sum(of_vessel):
    tracks, _ = world(10, 8)
    rows = np.arange(of_vessel)
    nothing = dataclasses.replace(tracks.take(rows), covariance=np.zeros((of_vessel, 4, 4)))
    with pytest.raises(ZeroDivisionError, match="singular"):
        stepped(Convex(), nothing, np.zeros(of_vessel, np.int64))


@given(st.integers(1, 40), st.integers(0, 10**6), st.integers(4, 16))
def test_intersection(count, seed, steps):
    """Beyond 20 steps determinants differ by less than their rounding, and weights by what is decided by it: 1e-6."""
    tracks, vessel = world(count, seed)
    same(stepped(CovarianceIntersection(steps=steps), tracks, vessel), intersection(tracks, tracks.covariance, vessel, steps))


@given(st.integers(1, 40), st.integers(0, 10**6), st.sampled_from([None, (0.2, 0.8), (0.0, 1.0)]))
def test_average(count, seed, shares):
    tracks, vessel = world(count, seed, alike=True)
    how = {"unknown_velocity_sigma_m_s": SIGMA_M_S}
    if shares is not None:
        how |= {"weights": "fixed", "radar_weight": shares[0], "ais_weight": shares[1]}
    fused = stepped(WeightedAverage(**how), tracks, vessel)
    same(fused, average(tracks, tracks.known_covariance(SIGMA_M_S), vessel, KINDS, shares))


@given(st.integers(1, 20), st.integers(0, 10**6))
def test_filters_of_tracks(count, seed):
    """Vessels swap and lose tracks from cycle to cycle."""
    tracks, vessel = world(count, seed, alike=True, near=True)
    method, rng, none = (
        ImmOfTracks(unknown_velocity_sigma_m_s=SIGMA_M_S),
        np.random.default_rng([seed, 32]),
        np.zeros(0, np.int64),
    )
    memory, oracle = method.init(), Filtered(method)
    for cycle in range(5):
        rows = rng.permutation(len(tracks))[: rng.integers(1, len(tracks) + 1)]
        others = rng.random(len(rows)) < 0.1
        of = np.unique(np.where(others, rng.integers(0, count, len(rows)), vessel[rows]), return_inverse=True)[1]
        now, some = 3.0 * cycle, tracks.take(rows)
        given_to = Associations(none, none, np.zeros(0), of)
        memory, fused = method.step(memory, FusionInput(some, Measurements.empty(), given_to, now, KINDS))
        wanted = oracle.step(some, some.known_covariance(SIGMA_M_S), of, now)
        assert np.abs(difference_m(fused.position_deg, wanted[0])).max() < ROUNDING_M
        np.testing.assert_allclose(fused.velocity_m_s, wanted[1], rtol=0.0, atol=ROUNDING_M)
        size = np.abs(wanted[2]).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(fused.covariance / size, wanted[2] / size, rtol=0.0, atol=ROUNDING_M)


@pytest.mark.parametrize("method", [Convex(registration=0.1), CovarianceIntersection(), WeightedAverage(), ImmOfTracks()])
def test_threads_change_no_bit(method):
    tracks, vessel = world(20_000, 5, alike=True)
    alone = stepped(method, tracks, vessel)
    with threads(3):
        together = stepped(method, tracks, vessel)
    for column in ("position_deg", "velocity_m_s", "covariance"):
        assert getattr(alone, column).tobytes() == getattr(together, column).tobytes()
