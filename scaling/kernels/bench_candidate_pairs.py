"""Pairs within 1 km among 50,000 tracks of two sources; baseline: scipy's k-d tree, which finds the same pairs."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from coastwatch.geodesy import earth_centred
from coastwatch.kernels.association import prune_pairs as screening
from coastwatch.kernels.association.candidate_pairs import candidates
from coastwatch.kernels.geometry import bands

TRACKS, GATE_M = 50_000, 1000.0


@pytest.fixture(scope="module")
def tracks():
    """Positions along a strip of coast (N, 2), degrees, and sources (N,)."""
    rng = np.random.default_rng([1, 0])
    return np.column_stack([rng.uniform(-40.0, -25.0, TRACKS), rng.uniform(-60.0, -59.9, TRACKS)]), np.arange(TRACKS) % 2


def by_bands(position, source):
    """The candidate pairs of the kernel, after the gate."""
    key, row, _ = bands.in_order(position, GATE_M, np.empty)
    point = np.column_stack([earth_centred(position), source])[row]
    spots = np.zeros(TRACKS, np.int32), np.arange(TRACKS, dtype=np.int32), row, np.full(1, -1, np.int64)
    tracks = np.ones(TRACKS, np.int32), np.zeros((TRACKS, 16)), np.zeros((TRACKS, screening.COLUMNS))
    rule = screening.Rule(GATE_M, 10.0, 0.5, 2.0, 0.9, 20.0, 0.01, 4.0, -np.inf)
    return candidates(0, TRACKS, key, point, *spots, bands.height_deg(GATE_M), 1.0, *tracks, rule, screening.cuts(rule, 1))


def by_tree(position, source):
    """The pairs of a k-d tree per source."""
    point = earth_centred(position)
    radar, ais = (np.flatnonzero(source == k) for k in range(2))
    return cKDTree(point[radar]).sparse_distance_matrix(cKDTree(point[ais]), GATE_M, output_type="ndarray")


@pytest.mark.benchmark(group="candidate_pairs: the gate")
def test_ours(benchmark, tracks):
    benchmark.extra_info["rows"] = len(by_tree(*tracks))
    assert benchmark(by_bands, *tracks)[3] == len(by_tree(*tracks))


@pytest.mark.benchmark(group="candidate_pairs: the gate")
def test_baseline_scipy(benchmark, tracks):
    benchmark.extra_info["rows"] = len(by_tree(*tracks))
    benchmark.pedantic(by_tree, args=tracks, rounds=3)
