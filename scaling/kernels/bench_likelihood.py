"""Log odds of 2,000 bearing tracks and 40 vessels each, windows of 100 bearings; baseline: numpy, one time step at a time."""

from typing import NamedTuple

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from coastwatch.batches import Floats
from coastwatch.geodesy import earth_centred, from_plane, to_plane, wrap_rad
from coastwatch.kernels.bearings.likelihood import Hypotheses, TrackPairs, log_odds
from coastwatch.kernels.bearings.null_hypothesis import UnknownVessel
from coastwatch.kernels.bearings.windows import BearingWindows, PositionWindows

TRACKS, CANDIDATES, WINDOW, BASELINE_TRACKS = 2000, 40, 100, 50
SITE_DEG = np.array([-22.9, -43.1])
SIGMA, BIAS_SIGMA, CORRELATION_S, DETECTION_PROBABILITY = 0.02, 0.005, 20.0, 0.95


class Problem(NamedTuple):
    """Times (s), bearings (rad), positions (m) of V vessels, and the candidates of each of N tracks."""

    time: np.ndarray  # (N, W)
    bearing: np.ndarray  # (N, W)
    metres: np.ndarray  # (W, V, 2)
    slot: np.ndarray  # (N * CANDIDATES,)


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Vessels on straight courses around a sonar; each track is of one of them and is compared with its neighbours."""
    rng = np.random.default_rng([1, 0])
    azimuth, distance = np.sort(rng.uniform(-np.pi, np.pi, TRACKS)), rng.uniform(3e3, 1e4, TRACKS)
    start = distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    instant = 3.0 * np.arange(WINDOW)
    metres = start + instant[:, None, None] * rng.normal(0.0, 3.0, (TRACKS, 2))
    bearing = np.arctan2(metres[:, :, 0], metres[:, :, 1]).T + rng.normal(0.0, SIGMA, (TRACKS, WINDOW))
    slot = (np.arange(TRACKS)[:, None] + np.arange(CANDIDATES) * 8) % TRACKS  # 40 of an octant's 250
    return Problem(np.tile(instant, (TRACKS, 1)), bearing, metres, slot.ravel())


def by_numpy(p: Problem) -> Floats:
    """The filter recursion alone, all pairs at each step: no null hypothesis, no coverage, no interpolation in time."""
    bearing = np.repeat(p.bearing[:BASELINE_TRACKS], CANDIDATES, axis=0)
    n = len(bearing)
    offset, error, odds = np.zeros(n), np.zeros(n), np.zeros(n)
    p00, p01, p11 = np.full(n, BIAS_SIGMA**2), np.zeros(n), np.ones(n)
    rho = np.exp(-3.0 / CORRELATION_S)
    for k in range(WINDOW - 1, -1, -1):
        position = p.metres[k, p.slot[:n]]
        h = 10.0 / np.hypot(position[:, 0], position[:, 1])
        g0, g1 = p00 + h * p01, p01 + h * p11
        s = g0 + h * g1 + SIGMA**2
        v = wrap_rad(bearing[:, k] - np.arctan2(position[:, 0], position[:, 1])) - offset - h * error
        offset, error = offset + g0 / s * v, rho * (error + g1 / s * v)
        p00, p01, p11 = p00 - g0 * g0 / s, rho * (p01 - g0 * g1 / s), rho * rho * (p11 - g1 * g1 / s) + 1.0 - rho * rho
        odds -= 0.5 * (np.log(2.0 * np.pi * s) + v * v / s)
    return odds


@pytest.mark.benchmark(group="likelihood: bearing tracks against vessels")
def test_ours(benchmark: BenchmarkFixture, problem: Problem) -> None:
    n, row = TRACKS, np.arange(TRACKS)
    instants = np.append(problem.time[0], problem.time[0, -1] + 3.0)
    metres = np.concatenate([problem.metres, problem.metres[-1:]])
    value = np.stack([np.column_stack([earth_centred(from_plane(m, SITE_DEG)), np.full(n, 10.0)]) for m in metres], axis=1)
    assert np.abs(to_plane(from_plane(metres[0], SITE_DEG), SITE_DEG) - metres[0]).max() < 1e-3
    site, full = np.broadcast_to(SITE_DEG, (n, WINDOW, 2)).copy(), np.full
    windows = BearingWindows(
        problem.time, problem.bearing, site, full(n, 5.0), full(n, 0.5), full(n, 2e4), full(n, 0.0), full(n, 2.0 * np.pi),
        full(n, 0.0), full(n, BIAS_SIGMA**2), full(n, SIGMA**2),
    )  # fmt: skip
    positions = PositionWindows(instants, np.arange(len(instants)), value)
    unknown = UnknownVessel(np.array([1.0, 0.5, 0.25, 0.1]), np.array([0.75, 0.19, 0.05, 0.01]), 3.6, 0.01)
    pairs, out = TrackPairs(row, np.arange(n + 1) * CANDIDATES, problem.slot), np.empty((n * CANDIDATES, 2))
    benchmark.extra_info["rows"] = n * CANDIDATES
    benchmark(log_odds, 0, n, pairs, windows, positions, Hypotheses(DETECTION_PROBABILITY, CORRELATION_S, -25.0, unknown), out)
    assert (out[:, 0].reshape(n, CANDIDATES).argmax(axis=1) == 0).mean() > 0.8


@pytest.mark.benchmark(group="likelihood: bearing tracks against vessels")
def test_baseline_numpy(benchmark: BenchmarkFixture, problem: Problem) -> None:
    benchmark.extra_info["rows"] = BASELINE_TRACKS * CANDIDATES
    benchmark.pedantic(by_numpy, args=(problem,), rounds=3)
