"""The instants of the cycles of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats, Ints


@dataclass(frozen=True)
class Timeline:
    """Cycle c ends at start_s + period_s * (c + 1)."""

    start_s: float
    period_s: float

    def cycle_at(self, time_s: Floats) -> Ints:
        """The cycle that ends at each instant. Args: (E,), each the end of a cycle. Returns: (E,)."""
        return np.rint((time_s - self.start_s) / self.period_s).astype(np.int64) - 1
