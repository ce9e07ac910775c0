"""The memory of the literal tracker: trees, their leaves over the window, preliminary tracks, and the states that were decided.

A leaf has no parent: its row holds all that its path through the window took. So leaves that have the same first columns have one
ancestor there, and pruning is a comparison of columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, Messages, Unproven
from coastwatch.batches.struct import Struct, column, part
from coastwatch.kernels.tables.row_numbers import require_rows


@dataclass(frozen=True, eq=False)
class Leaves(Batch):
    """Leaves sorted by tree. Columns with W hold the looks of the window, the newest last."""

    tree: Ints = column(np.int64, "L")  # row of its tree
    mmsi: Ints = column(np.int64, "L")  # whose reports it took, -1: nobody's
    plot: Ints = column(np.int64, "L", "W")  # number of the plot that it took, -1: none
    message: Ints = column(np.int64, "L", "W")  # number of the report, -1: none
    origin: Ints = column(np.int64, "L", "W")  # true vessel of the plot
    score: Floats = column(np.float64, "L", "W")
    path: Floats = column(np.float64, "L", "W", 4)  # state after each look: east, north, and their rates; NaN before its start
    path_covariance: Floats = column(np.float64, "L", "W", 4, 4)
    life_score: Floats = column(np.float64, "L")  # since the tree began
    updated_s: Floats = column(np.float64, "L")  # newest measurement

    @property
    def state(self) -> Floats:
        """The state after the newest look. (L, 4)"""
        return self.path[:, -1]

    @property
    def covariance(self) -> Floats:
        """Its covariance. (L, 4, 4)"""
        return np.ascontiguousarray(self.path_covariance[:, -1])


@dataclass(frozen=True, eq=False)
class Trees(Batch):
    """One tree a vessel."""

    number: Ints = column(np.int64, "K")
    age: Ints = column(np.int64, "K")  # looks since its start
    window: Ints = column(np.int64, "K")  # looks that stay open
    started_s: Floats = column(np.float64, "K")


@dataclass(frozen=True, eq=False)
class Preliminary(Batch):
    """Tracks that are not confirmed."""

    state: Floats = column(np.float64, "P", 4)
    covariance: Floats = column(np.float64, "P", 4, 4)
    passed: Ints = column(np.int64, "P")  # looks with a plot
    checked: Ints = column(np.int64, "P")  # looks
    mmsi: Ints = column(np.int64, "P")  # of the report that it began with, -1: two plots


@dataclass(frozen=True, eq=False)
class Decided(Batch):
    """States of the paths of tracks that no later look can change."""

    number: Ints = column(np.int64, "D")
    time_s: Floats = column(np.float64, "D")
    state: Floats = column(np.float64, "D", 4)
    covariance: Floats = column(np.float64, "D", 4, 4)


@dataclass(frozen=True, eq=False)
class ForestMemory(Struct):
    """One region between two cycles."""

    leaves: Leaves = part(Leaves)
    trees: Trees = part(Trees)
    preliminary: Preliminary = part(Preliminary)
    waiting: Messages = part(Messages)  # that are newer than the newest look
    decided: Decided = part(Decided)  # in the newest cycle
    best: Ints = column(np.int64, "K")  # row of the chosen leaf of each tree
    single_m: Floats = column(np.float64, "Z", 2)  # plots of the newest look that may be the first of a track
    look_s: Floats = column(np.float64, "W", new=-np.inf)  # of the looks of the window, -inf before the first
    next_number: int = 1
    next_plot: int = 0
    next_message: int = 0
    unproven: Unproven = Unproven()  # choices of the newest cycle

    def check_rows(self) -> None:
        """Check the rows of trees and leaves, and numbers of plots and reports, as after reading a checkpoint. Raises: ValueError."""
        require_rows("Leaves.plot", self.leaves.plot, self.next_plot, -1)
        require_rows("Leaves.message", self.leaves.message, self.next_message, -1)
        tree, trees = self.leaves.tree, len(self.trees)
        if not np.array_equal(np.unique(tree), np.arange(trees)) or (np.diff(tree) < 0).any():
            raise ValueError(
                f"Leaves.tree: got rows that are not the sorted numbers below {trees}, needed each tree with leaves"
            )
        if not np.array_equal(tree[np.clip(self.best, 0, len(tree) - 1)], np.arange(trees)):
            raise ValueError("ForestMemory.best: got a row of another tree, needed one leaf of each")

    def with_trees(self, state: Floats, covariance: Floats, time_s: float, window: int) -> Self:
        """This memory with new trees of one leaf each, whose start is decided. Args: (B, 4), (B, 4, 4)."""
        count, w = len(state), len(self.look_s)
        none, path, path_covariance = np.full((count, w), -1), np.full((count, w, 4), np.nan), np.full((count, w, 4, 4), np.nan)
        path[:, -1], path_covariance[:, -1] = state, covariance
        number = self.next_number + np.arange(count)
        leaves = Leaves(
            tree=len(self.trees) + np.arange(count),
            mmsi=np.full(count, -1),
            plot=none,
            message=none,
            origin=none,
            score=np.zeros((count, w)),
            path=path,
            path_covariance=path_covariance,
            life_score=np.zeros(count),
            updated_s=np.full(count, time_s),
        )
        trees = Trees(number, np.zeros(count, np.int64), np.full(count, window), np.full(count, time_s))
        return replace(
            self,
            best=np.concatenate([self.best, len(self.leaves) + np.arange(count)]),
            leaves=Leaves.join([self.leaves, leaves]),
            trees=Trees.join([self.trees, trees]),
            decided=Decided.join([self.decided, Decided(number, np.full(count, time_s), state, covariance)]),
            next_number=self.next_number + count,
        )

    def open_path(self, trees: Bools | None = None) -> Decided:
        """The states of the chosen leaves that are still open. Args: trees: (K,) of these alone."""
        rows = np.flatnonzero(np.ones(len(self.trees), np.bool_) if trees is None else trees)
        w = len(self.look_s)
        is_open = w - 1 - np.arange(w) < np.minimum(self.trees.age[rows], w - 1)[:, None]  # (K', W)
        k, at = np.nonzero(is_open)
        leaf = self.best[rows[k]]
        return Decided(
            self.trees.number[rows[k]], self.look_s[at], self.leaves.path[leaf, at], self.leaves.path_covariance[leaf, at]
        )
