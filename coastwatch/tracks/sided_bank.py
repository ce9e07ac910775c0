"""The filters of many tracks with a turn to each side and a change of speed, by the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.tracks.motion import Filters


@dataclass(frozen=True)
class SidedBank:
    """The filters of many tracks by the kernel."""

    renewal_s: float
    models: Floats  # (J, 6)

    def foresee(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        mean, covariance = kernels.filters.manoeuvre_imm.sided_foresee(*filters, dt_s, self.renewal_s, self.models)
        return mean, covariance

    def absorb(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        done = kernels.filters.manoeuvre_imm.sided_absorb(
            *filters, rows, dt_s, position_m, covariance, self.renewal_s, self.models
        )
        return Filters(*done[:3]), done[3], done[4]
