"""What a bank of filters does in one go, step by step, for banks whose sums are not written for it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.kernels.filters.gaussian import squared_distance
from coastwatch.tracks.motion import Filters


class Steps(Protocol):
    """The single steps of a bank, see `coastwatch.tracks.table.Bank`."""

    def predict(self, filters: Filters, dt_s: Floats) -> Filters: ...
    def update(self, filters: Filters, position_m: Floats, covariance: Floats) -> tuple[Filters, Floats]: ...
    def estimate(self, filters: Filters) -> tuple[Floats, Floats]: ...


def foresee(bank: Steps, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
    """As `Bank.foresee`."""
    return bank.estimate(bank.predict(filters, dt_s))


def absorb(
    bank: Steps, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
) -> tuple[Filters, Floats, Floats]:
    """As `Bank.absorb`."""
    late = np.minimum(dt_s, 0.0)
    predicted = bank.predict(filters.take(rows), np.maximum(dt_s, 0.0))
    mean, spread = bank.estimate(predicted)
    z = position_m - mean[:, 2:4] * late[:, None]
    noise = covariance + spread[:, 2:4, 2:4] * (late**2)[:, None, None]
    after, fit = bank.update(predicted, z, noise)
    return after, fit, squared_distance(z - mean[:, :2], spread[:, :2, :2] + noise)
