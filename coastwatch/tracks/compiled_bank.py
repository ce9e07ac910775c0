"""The filters of many tracks by the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.tracks import stepwise
from coastwatch.tracks.motion import Filters, Parameters


@dataclass(frozen=True)
class CompiledBank:
    """The filters of many tracks by the kernel."""

    parameters: Parameters

    def predict(self, filters: Filters, dt_s: Floats) -> Filters:
        p = self.parameters
        after = kernels.filters.imm.imm_predict(*filters, dt_s, p.kind, p.noise, p.turn_noise, p.turn_sigma, p.sojourn_s)
        return Filters(*after)

    def update(self, filters: Filters, position_m: Floats, covariance: Floats) -> tuple[Filters, Floats]:
        n = len(position_m)
        z, noise = np.zeros((n, 4)), np.zeros((n, 4, 4))
        z[:, :2], noise[:, :2, :2] = position_m, covariance
        *after, fit = kernels.filters.imm.imm_update(*filters, z, noise, np.zeros(n, np.bool_))
        return Filters(*after), fit

    def estimate(self, filters: Filters) -> tuple[Floats, Floats]:
        mean, covariance = kernels.filters.imm.imm_estimate(*filters)
        return mean, covariance

    def foresee(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        return stepwise.foresee(self, filters, dt_s)

    def absorb(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        return stepwise.absorb(self, filters, rows, dt_s, position_m, covariance)
