"""Leaves of multi-hypothesis tracks: rows beside the table of radar tracks, those of a slot together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Batch, Floats, Ints
from coastwatch.batches.struct import Struct, column
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.kernels.tracks.hypothesis_trees import LeafColumns
from coastwatch.tracks.radar.motion import Filters


@dataclass(frozen=True, eq=False)
class Leaves(Batch):
    """Each row is one way to give the plots of W looks to the track in a slot. The chosen one of a slot is its first."""

    slot: Ints = column(np.int64, "L")
    cost: Floats = column(np.float64, "L")  # negative log-likelihood ratio, relative to the chosen leaf of the last look
    existence: Floats = column(np.float64, "L")  # given this leaf, at existence_s
    visibility: Floats = column(np.float64, "L")
    existence_s: Floats = column(np.float64, "L")
    misses: Floats = column(np.float64, "L")
    plot: Ints = column(np.int64, "L", "W")  # number of the plot in each look, newest last, -1 where there is none
    radar_s: Floats = column(np.float64, "L", "R")  # newest plot of each radar, -inf where there is none
    state: Floats = column(np.float64, "L", "J", 5)  # at updated_s
    covariance: Floats = column(np.float64, "L", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "L", "J")
    updated_s: Floats = column(np.float64, "L")
    combined_mean: Floats = column(np.float64, "L", 4)  # over the models
    combined_covariance: Floats = column(np.float64, "L", 4, 4)
    noise_m2_s3: Floats = column(np.float64, "L")

    @property
    def columns(self) -> LeafColumns:
        """As the kernels take them."""
        return LeafColumns(*(getattr(self, name) for name in self.__dataclass_fields__))

    @property
    def filters(self) -> Filters:
        """The filter of each leaf."""
        return Filters(self.state, self.covariance, self.mode_probability)

    @property
    def estimates(self) -> Estimates:
        """The combined estimate of each leaf."""
        return Estimates(self.updated_s, self.combined_mean, self.combined_covariance, self.noise_m2_s3)


@dataclass(frozen=True, eq=False)
class Forest(Struct):
    """The leaves of a region, and what is kept for each slot. Leaves of a slot without a track go at the next plots."""

    leaves: Leaves
    next_plot: int  # number of the next plot
    null_cost: Floats = column(np.float64, "S")  # of "no vessel", as costs of leaves are
    nulled: Ints = column(np.int64, "S")  # looks in a row in which other tracks had all the plots of the track

    @classmethod
    def empty(cls, window: int = 0, radars: int = 0, models: int = 0) -> Forest:
        """No leaf. Args: window: W; radars: R; models: J."""
        return cls(Leaves.empty(W=window, R=radars, J=models), 0, np.zeros(0), np.zeros(0, np.int64))

    def check_slots(self, filters: tuple[int, ...], radars: int) -> None:
        """Check the leaves against the table. Args: filters: (slots, models of each); radars: R. Raises: ValueError."""
        require_rows("Leaves.slot", self.leaves.slot, filters[0], 0)
        got, needed = (self.leaves.mode_probability.shape[1], self.leaves.radar_s.shape[1]), (filters[1], radars)
        if len(self.leaves) and got != needed:
            raise ValueError(f"Leaves: got {got[0]} models of {got[1]} radars, needed {needed[0]} of {needed[1]}")

    def with_slots(self, count: int) -> Forest:
        """This forest with room for so many slots."""
        more = count - len(self.nulled)
        if more <= 0:
            return self
        null_cost, nulled = (np.concatenate([one, np.zeros(more, one.dtype)]) for one in (self.null_cost, self.nulled))
        return replace(self, null_cost=null_cost, nulled=nulled)
