"""Leaves of multi-hypothesis tracks: rows beside the table of radar tracks, those of a slot together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Batch, Floats, Ints, Unproven
from coastwatch.batches.struct import Struct, column, part
from coastwatch.kernels.filters.smoothing import Steps
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.kernels.tracks.hypothesis_trees import LeafColumns
from coastwatch.kernels.tracks.tree_rows import TreeRows
from coastwatch.tracks.radar.motion import HasFilters

SPARE = 2  # times as many rows as are needed are made ready


@dataclass(frozen=True, eq=False)
class Leaves(HasFilters, Batch):
    """Each row is one way to give the plots of W looks to the track in a slot. The chosen one of a slot is its first."""

    slot: Ints = column(np.int64, "L")
    cost: Floats = column(np.float64, "L")  # negative log-likelihood ratio, relative to the chosen leaf of the last look
    existence: Floats = column(np.float64, "L")  # given this leaf, at existence_s
    visibility: Floats = column(np.float64, "L")
    existence_s: Floats = column(np.float64, "L")
    misses: Floats = column(np.float64, "L")
    mmsi: Ints = column(np.int64, "L")  # of the vessel, -1 where none is known
    plot: Ints = column(np.int64, "L", "W")  # number of the plot or message in each look, newest last, -1 where there is none
    step: Ints = column(np.int64, "L", "W")  # row of the filter's step by it, among those of the forest
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


@dataclass(frozen=True, eq=False)
class FilterSteps(Batch):
    """What the filters of leaves said at each plot or message: the memory from which the past is smoothed."""

    time_s: Floats = column(np.float64, "P")
    mean: Floats = column(np.float64, "P", 4)  # after it, over the models
    covariance: Floats = column(np.float64, "P", 4, 4)
    predicted_mean: Floats = column(np.float64, "P", 4)  # before it, at the same time
    predicted_covariance: Floats = column(np.float64, "P", 4, 4)
    radar: Ints = column(np.int64, "P")  # -1: a message

    @property
    def columns(self) -> Steps:
        """As the kernels take them."""
        return Steps(self.time_s, self.mean, self.covariance, self.predicted_mean, self.predicted_covariance)


@dataclass(frozen=True, eq=False)
class Decided(Batch):
    """States of tracks at plots or messages whose choice has become final, smoothed by those after them."""

    number: Ints = column(np.int64, "N")  # of the track, within the region
    time_s: Floats = column(np.float64, "N")
    mean: Floats = column(np.float64, "N", 4)  # in the region's plane
    covariance: Floats = column(np.float64, "N", 4, 4)
    radar: Ints = column(np.int64, "N")  # -1: a message


@dataclass(frozen=True, eq=False)
class Forest(Struct):
    """The leaves of a region, and what is kept for each slot.

    During a cycle rows of leaves in slot -1 are spare, and so are steps that no leaf has. `compact` takes them out at its end.
    """

    leaves: Leaves = part(Leaves)
    steps: FilterSteps = part(FilterSteps)  # of these leaves
    decided: Decided = part(Decided)  # in this cycle
    null_cost: Floats = column(np.float64, "S")  # of "no vessel", as costs of leaves are
    nulled: Ints = column(np.int64, "S")  # looks in a row in which other tracks had all the plots of the track
    until_s: Floats = column(np.float64, "S")  # up to which a track lives by its messages, without plots
    next_plot: int = 0  # number of the next plot
    unproven: Unproven = Unproven()  # choices of this cycle

    def trees(self) -> TreeRows:
        """Where the leaves of each slot stand."""
        rows: TreeRows = kernels.tracks.tree_rows.tree_rows(self.leaves.slot, self.leaves.step, len(self.nulled))
        return rows

    def replaced(self, trees: TreeRows, slots: Ints, leaves: Leaves, steps: FilterSteps) -> Forest:
        """This forest with these leaves in place of those of these slots. It consumes the forest.

        Args: trees: of this forest; leaves: those of a slot together; steps: new ones, in rows `trees.steps` and after it.
        """
        old, at, kept = self.leaves, trees.rows, self.steps
        old.slot[kernels.tracks.tree_rows.rows_of(trees, slots)] = -1
        if at + len(leaves) > len(old):
            used = np.flatnonzero(old.slot >= 0)
            at = len(used)
            old = old.take(used).with_room("L", at + SPARE * (at // 2 + len(leaves)))
        old.slot[at:] = -1
        old.put(at, leaves)
        if trees.steps + len(steps) > len(kept):
            kept = kept.take(np.arange(trees.steps)).with_room("P", trees.steps + SPARE * (trees.steps // 2 + len(steps)))
        kept.put(trees.steps, steps)
        return replace(self, leaves=old, steps=kept)

    def compact(self, live: Ints) -> Forest:
        """This forest with the leaves of these slots alone, in order of slots, and the steps that they have."""
        slots, trees = np.sort(live), self.trees()
        leaves = self.leaves.take(kernels.tracks.tree_rows.rows_of(trees, slots))
        used = np.zeros(trees.steps + 1, np.bool_)
        used[leaves.step] = True
        used[-1] = False  # of no step
        rows = np.cumsum(used) - 1
        rows[-1] = -1
        leaves.step[:] = rows[leaves.step]
        return replace(self, leaves=leaves, steps=self.steps.take(np.flatnonzero(used)))

    def check_slots(self, filters: tuple[int, ...], radars: int) -> None:
        """Check the leaves against the table, and their plots. Args: filters: (slots, models of each); radars: R. Raises: ValueError."""
        require_rows("Leaves.slot", self.leaves.slot, filters[0], 0)
        require_rows("Leaves.step", self.leaves.step, len(self.steps), -1)
        require_rows("Leaves.plot", self.leaves.plot, self.next_plot, -1)
        got, needed = (self.leaves.mode_probability.shape[1], self.leaves.radar_s.shape[1]), (filters[1], radars)
        if len(self.leaves) and got != needed:
            raise ValueError(f"Leaves: got {got[0]} models of {got[1]} radars, needed {needed[0]} of {needed[1]}")
