"""Windowed scores of 20,000 pairs; baseline: numpy batches of the same arithmetic."""

import numpy as np
import pytest

from coastwatch.geodesy import scale_m_deg
from coastwatch.kernels.association.history import addresses, entries, wide_rows
from coastwatch.kernels.association.pair_features import COLUMNS
from coastwatch.kernels.association.pair_score import windowed_scores
from coastwatch.kernels.association.prune_pairs import Rule

TRACKS, PAIRS, WINDOW = 20_000, 20_000, 20
VARIANCE = np.array([400.0, 0.0, 400.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])  # of the difference, lower triangle row by row


@pytest.fixture(scope="module")
def problem():
    """Pairs of neighbouring tracks, and windows with the newest last. Returns: (A,), (A,), (N, W, 2), (N, W, 2)."""
    rng = np.random.default_rng([1, 0])
    position = np.array([-23.0, -43.0]) + rng.normal(0.0, 1e-4, (TRACKS, WINDOW, 2))
    velocity = rng.normal(0.0, 1.0, (TRACKS, WINDOW, 2))
    first = np.arange(PAIRS) % TRACKS
    second = (first + 1) % TRACKS
    return first, second, position, velocity


def by_numpy(first, second, position, velocity):
    """The squared distances alone, which is less than the kernel computes."""
    north, east = scale_m_deg(position[first, -1, 0])
    d = position[second] - position[first]
    delta = np.concatenate([d[..., 1:] * east[:, None, None], d[..., :1] * north[:, None, None]], axis=2)
    delta = np.concatenate([delta, velocity[second] - velocity[first]], axis=2)
    phi = np.diag([400.0, 400.0, 1.0, 1.0])
    return (delta * np.linalg.solve(phi, delta[..., None])[..., 0]).sum(axis=2)


@pytest.mark.benchmark(group="pair_score: windowed scores")
def test_ours(benchmark, problem):
    first, second, position, velocity = problem
    ring = tuple(entries(position[:, k], velocity[:, k], np.ones((TRACKS, 2))) for k in range(WINDOW))
    chain = np.tile(np.arange(TRACKS, dtype=np.int32)[:, None], (1, WINDOW - 1))
    record = wide_rows(TRACKS, COLUMNS, np.zeros)
    record[:, :10] = 0.5 * VARIANCE
    windows = addresses(ring), chain, np.full(TRACKS, WINDOW, np.int32), record
    rule = Rule(1000.0, 10.0, 0.5, 2.0, 0.9, 20.0, 0.01, 4.0, -np.inf)
    benchmark.extra_info["rows"] = PAIRS
    benchmark(windowed_scores, first, second, np.full(PAIRS, 1e-6), *windows, rule)


@pytest.mark.benchmark(group="pair_score: windowed scores")
def test_baseline_numpy(benchmark, problem):
    benchmark.extra_info["rows"] = PAIRS
    benchmark.pedantic(by_numpy, args=problem, rounds=3)
