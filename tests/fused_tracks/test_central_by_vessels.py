"""`CentralImm` in arrays against one vessel after the other, whatever joins, parts, ends and is not measured."""

import numpy as np
import pytest
from as_bytes import as_bytes
from central_by_vessels import ByVessels
from hypothesis import given, strategies as st

from coastwatch.batches import Associations, Measurements, Tracks
from coastwatch.fused_tracks import CentralImm, FusionInput
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.threads import threads
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.oracle

KINDS = np.array([0, 0, 1], np.int64)  # two regions of radars, AIS
SITE = np.array([57.9, 179.9])
CLOSE = 1e-6  # of the largest number of a covariance, and metres: what is left of rounding after some cycles of filters


def cycle_of(rng, vessels, now, trouble):
    """Tracks of three sources, mostly together, and most of what they were updated with."""
    here = rng.random((vessels, 3)) < 0.7
    who, source = np.nonzero(here)
    order = rng.permutation(len(who)) if rng.random() < 0.3 else np.lexsort((who, source))
    who, source = who[order], source[order]
    n, ais = len(who), source == 2
    generation = (rng.random(n) < trouble) * rng.integers(1, 10**6, n)
    place = offset_deg(np.array([58.0, 179.99]), np.column_stack([4.0 * now + 0.0 * who, 2500.0 * who]))
    apart, other = rng.random(n) < trouble, np.where(rng.random(n) < trouble, rng.integers(0, max(vessels, 1), n), who)
    vessel = np.unique(np.where(apart, vessels + np.arange(n), other), return_inverse=True)[1]
    covariance = np.tile(np.diag([90.0, 120.0, 0.3, 0.2]), (n, 1, 1)) * rng.uniform(0.5, 2.0, (n, 1, 1))
    covariance[rng.random(n) < 0.05] = np.nan
    ids, updated = 1000 * source + who + 10_000 * generation, now - rng.uniform(0.0, 3.0, n)
    report, mmsi = np.eye(2) * rng.uniform(50.0, 150.0, (n, 1, 1)), np.where(ais, who, -1)
    at = offset_deg(place, rng.normal(0.0, 10.0, (n, 2)))
    velocity = np.tile([4.0, 0.0], (n, 1)) + rng.normal(0.0, 0.2, (n, 2))
    tracks = Tracks(ids, source, np.full(n, now), at, velocity, covariance, report, updated, np.zeros(n), mmsi, who)
    return tracks, measured(rng, tracks, place, trouble), vessel


def measured(rng, tracks, place, trouble):
    """What the tracks were updated with, and something besides that is older, or of no track."""
    rows = np.flatnonzero(rng.random(len(tracks)) > trouble)
    rows = np.append(rows, rng.choice(rows, len(rows) // 2)) if len(rows) else rows
    n, ais = len(rows), tracks.source[rows] == 2
    late = np.where(np.arange(n) < len(rows) - len(rows) // 3, 0.0, rng.uniform(-1.0, 4.0, n))
    covariance = np.full((n, 4, 4), np.nan)
    root = rng.normal(0.0, 10.0, (n, 2, 2))
    covariance[:, :2, :2] = root @ root.transpose(0, 2, 1) + 9.0 * np.eye(2)
    covariance[ais, 2:, 2:] = 0.01 * np.eye(2)
    velocity = np.where(ais[:, None], [4.0, 0.0], np.nan)
    ids = np.where(rng.random(n) < 0.02, -5, tracks.track_id[rows])
    at, time = offset_deg(place[rows], rng.normal(0.0, 10.0, (n, 2))), tracks.updated_s[rows] - late
    made = Measurements(
        ids, np.where(ais, -1, tracks.source[rows]), time, at, velocity, covariance, np.where(ais[:, None], np.nan, SITE)
    )
    return made.take(rng.permutation(n) if rng.random() < 0.3 else np.lexsort((time, ids)))


@given(st.integers(0, 15), st.integers(0, 10**6), st.sampled_from([0.0, 0.03, 0.2]))
def test_arrays_are_one_vessel_after_the_other(vessels, seed, trouble):
    method, rng = CentralImm(learning_memory_s=0.0), np.random.default_rng([seed, 61])
    memory, oracle, none = method.init(), ByVessels(method), np.zeros(0, np.int64)
    for cycle in range(6):
        now = 3.0 * cycle
        tracks, made, vessel = cycle_of(rng, vessels, now, trouble)
        joined = Associations(none, none, np.zeros(0), vessel)
        before = save(memory)
        after, fused = method.step(memory, FusionInput(tracks, made, joined, now, KINDS))
        assert save(memory) == before
        memory = load(save(after))
        wanted = oracle.step(tracks, made, vessel, now, KINDS)
        assert len(memory.mode_probability) == len(oracle.filters)
        assert np.abs(difference_m(fused.position_deg, wanted.position_deg)).max(initial=0.0) < CLOSE
        np.testing.assert_allclose(fused.velocity_m_s, wanted.velocity_m_s, rtol=0.0, atol=CLOSE)
        size = np.abs(wanted.covariance).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(fused.covariance / size, wanted.covariance / size, rtol=0.0, atol=CLOSE)


def test_threads_change_no_bit():
    said = []
    for number in (1, 3):
        method, rng, none = CentralImm(), np.random.default_rng(7), np.zeros(0, np.int64)
        memory = method.init()
        with threads(number):
            for cycle in range(3):
                tracks, made, vessel = cycle_of(rng, 6000, 3.0 * cycle, 0.03)
                joined = Associations(none, none, np.zeros(0), vessel)
                memory, fused = method.step(memory, FusionInput(tracks, made, joined, 3.0 * cycle, KINDS))
        said.append(as_bytes((memory, fused)))
    assert said[0] == said[1]
