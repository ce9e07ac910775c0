"""Windowed scores of 20,000 pairs: scalar code compiled by numba against numpy batches of the same arithmetic."""

import numpy as np
import pytest

from coastwatch.geodesy import scale_m_deg
from coastwatch.kernels.windows import windowed_scores

TRACKS, PAIRS, WINDOW = 20_000, 20_000, 20


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng([1, 0])
    position = np.array([-23.0, -43.0]) + rng.normal(0.0, 1e-4, (TRACKS, WINDOW, 2))
    velocity = rng.normal(0.0, 1.0, (TRACKS, WINDOW, 2))
    first, second = rng.integers(0, TRACKS, (2, PAIRS))
    phi = np.tile(np.diag([400.0, 400.0, 1.0, 1.0]), (PAIRS, 1, 1))
    return (
        first,
        second,
        position,
        velocity,
        np.ones((TRACKS, WINDOW, 2)),
        np.full(TRACKS, WINDOW),
        phi,
        np.zeros((PAIRS, 2, 2)),
        np.full(PAIRS, 1e-6),
    )


def by_numpy(first, second, position, velocity, variance, length, phi, registration, density):
    """The d2 part alone, batched: less than what the kernel does."""
    north, east = scale_m_deg(position[first, -1, 0])
    d = position[second] - position[first]
    delta = np.concatenate([d[..., 1:] * east[:, None, None], d[..., :1] * north[:, None, None]], axis=2)
    delta = np.concatenate([delta, velocity[second] - velocity[first]], axis=2)
    return (delta * np.linalg.solve(phi[:, None], delta[..., None])[..., 0]).sum(axis=2)


@pytest.mark.benchmark(group="windows: scores of pairs")
def test_ours(benchmark, problem):
    benchmark.extra_info["rows"] = PAIRS
    benchmark(windowed_scores, *problem, 10.0, 0.5, 2.0, 0.9, 20.0, 0.01, 4.0)


@pytest.mark.benchmark(group="windows: scores of pairs")
def test_baseline_numpy(benchmark, problem):
    benchmark.extra_info["rows"] = PAIRS
    benchmark.pedantic(by_numpy, args=problem, rounds=3)
