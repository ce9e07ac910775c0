"""Filters of plots alone: columns of slots beside the table of radar tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.batches.struct import Batch, column, optional_column
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.tracks.radar.motion import Filters


@dataclass(frozen=True, eq=False)
class PlotFilters(Batch):
    """A filter of plots alone for each slot of the table of tracks, J = 0 where none is kept. A slot without one has the time -inf."""

    updated_s: Floats = column(np.float64, "S")  # newest plot
    state: Floats = column(np.float64, "S", "J", 5)  # at updated_s
    covariance: Floats = column(np.float64, "S", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "S", "J")
    combined_mean: Floats = column(np.float64, "S", 4)  # over the models
    combined_covariance: Floats = column(np.float64, "S", 4, 4)
    noise_m2_s3: Floats = column(np.float64, "S")
    left_mmsi: Ints = column(np.int64, "S")  # whose messages the track has left, -1: nobody's
    left_s: Floats = column(np.float64, "S")  # when, -inf: never
    doubted_s: Floats = optional_column("S")  # since then its plots contradict its messages, NaN: they do not
    plots_s: Floats = optional_column(
        "S", 2
    )  # the newest plot of a track with messages, and the one before; -inf: none, NaN: not known

    @property
    def models(self) -> int:
        """J; 0: no filter is kept."""
        return int(self.mode_probability.shape[1])

    @property
    def filters(self) -> Filters:
        """The filter of each slot."""
        return Filters(self.state, self.covariance, self.mode_probability)

    @property
    def estimates(self) -> Estimates:
        """The combined estimate of each slot."""
        return Estimates(self.updated_s, self.combined_mean, self.combined_covariance, self.noise_m2_s3)

    def has_filter(self, slots: Ints) -> Bools:
        """Which of these slots have a filter. (N,)"""
        return np.isfinite(self.updated_s[slots])

    def with_slots(self, count: int) -> PlotFilters:
        """These filters with room for so many slots."""
        more = count - len(self.updated_s)
        if more <= 0 or not self.models:
            return self
        rows = {
            name: np.concatenate([one, np.zeros((more, *one.shape[1:]), one.dtype)])
            for name, one in ((n, getattr(self, n)) for n in self.__dataclass_fields__)
        }
        rows["updated_s"][-more:], rows["left_mmsi"][-more:] = -np.inf, -1
        rows["left_s"][-more:], rows["doubted_s"][-more:], rows["plots_s"][-more:] = -np.inf, np.nan, np.nan
        return PlotFilters(**rows)
