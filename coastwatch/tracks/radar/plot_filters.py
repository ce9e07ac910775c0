"""Filters of plots alone: columns of slots beside the table of radar tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.batches.struct import Batch, column
from coastwatch.tracks.radar.motion import HasFilters


@dataclass(frozen=True, eq=False)
class PlotFilters(HasFilters, Batch):
    """A filter of plots alone for each slot of the table of tracks, J = 0 where none is kept. A slot without one has the time -inf."""

    updated_s: Floats = column(np.float64, "S", new=-np.inf)  # newest plot
    state: Floats = column(np.float64, "S", "J", 5)  # at updated_s
    covariance: Floats = column(np.float64, "S", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "S", "J")
    combined_mean: Floats = column(np.float64, "S", 4)  # over the models
    combined_covariance: Floats = column(np.float64, "S", 4, 4)
    noise_m2_s3: Floats = column(np.float64, "S")
    left_mmsi: Ints = column(np.int64, "S", new=-1)  # whose messages the track has left, -1: nobody's
    left_s: Floats = column(np.float64, "S", new=-np.inf)  # when, -inf: never
    doubted_s: Floats = column(np.float64, "S", new=np.nan)  # since then its plots contradict its messages, NaN: they do not
    # The newest plot of a track with messages, and the one before; -inf: none, NaN: not known
    plots_s: Floats = column(np.float64, "S", 2, new=np.nan)

    @property
    def models(self) -> int:
        """J; 0: no filter is kept."""
        return int(self.mode_probability.shape[1])

    def has_filter(self, slots: Ints) -> Bools:
        """Which of these slots have a filter. (N,)"""
        return np.isfinite(self.updated_s[slots])
