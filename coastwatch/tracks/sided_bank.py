"""The filters of many tracks with a turn to each side and a change of speed, by the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats
from coastwatch.kernels.imm import imm_estimate
from coastwatch.kernels.sided_imm import sided_predict, sided_update
from coastwatch.tracks.motion import Filters


@dataclass(frozen=True)
class SidedBank:
    """The filters of many tracks by the kernel."""

    renewal_s: float
    models: Floats  # (J, 6)

    def predict(self, filters: Filters, dt_s: Floats) -> Filters:
        return Filters(*sided_predict(*filters, dt_s, self.renewal_s, self.models))

    def update(self, filters: Filters, position_m: Floats, covariance: Floats) -> tuple[Filters, Floats]:
        n = len(position_m)
        z, noise = np.zeros((n, 4)), np.zeros((n, 4, 4))
        z[:, :2], noise[:, :2, :2] = position_m, covariance
        *after, fit = sided_update(*filters, z, noise, np.zeros(n, np.bool_))
        return Filters(*after), fit

    def estimate(self, filters: Filters) -> tuple[Floats, Floats]:
        mean, covariance = imm_estimate(*filters)
        return mean, covariance
