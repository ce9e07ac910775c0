"""Random combined estimates and plots for tests of the kernels of radar trackers."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import PlotColumns

SIZE = 800.0  # m, of the square


def estimates_of(n: int, seed: int) -> Estimates:
    """Tracks last updated up to 12 s before 0 s, and a few after it."""
    rng = np.random.default_rng([seed, 41])
    a = rng.normal(size=(n, 4, 6)) * np.array([20.0, 20.0, 1.0, 1.0])[:, None] * 10.0 ** rng.uniform(-0.5, 0.7, (n, 1, 1))
    mean = np.hstack([rng.uniform(-0.5, 0.5, (n, 2)) * SIZE, rng.normal(size=(n, 2)) * 8.0])
    return Estimates(rng.uniform(-12.0, 8.0, n), mean, a @ a.swapaxes(-1, -2), 10.0 ** rng.uniform(-3.0, 0.0, n))


def columns_of(m: int, seed: int) -> PlotColumns:
    """Plots of one radar within a second."""
    rng = np.random.default_rng([seed, 42])
    a = rng.normal(size=(m, 2, 3)) * 10.0 ** rng.uniform(0.5, 2.0, (m, 1, 1))
    return PlotColumns(
        rng.uniform(0.0, 1.0, m), rng.uniform(-0.7, 0.7, (m, 2)) * SIZE, a @ a.swapaxes(-1, -2), *np.zeros((2, m), np.int64)
    )
