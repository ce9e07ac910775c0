"""Whether the plots of no track return to their cells: near quays they do, in open water no more often than chance has it.

A radar whose plots return learns a clutter map (`clutter.py`). A cell is known by a hash, so a count is of several cells: of plots at
random places it is Poisson, as that of one cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.batches.struct import Struct, column
from coastwatch.tracks.radar.rates import turns_between

BUCKETS = 4096  # of hashed cells
EPOCH_TURNS = 10.0  # a vessel that comes has its track before: its first plots meet none of their own
MEMORY_TURNS = 100.0  # after which a plot counts 1 / e
LEAST_MET = 10.0  # meetings beyond chance
SIGMAS = 5.0  # standard deviations of chance beyond it
TIMES_BY_CHANCE = 2.0  # meetings of plots, over those by chance


@dataclass(frozen=True, eq=False)
class Returns(Struct):
    """Counts of K radars that have sent plots, which fade with the turns of each."""

    row: Ints = column(np.int64, "R", new=-1)  # of each radar, -1 before its first plot
    newest_s: Floats = column(np.float64, "K", new=np.nan)
    turns: Floats = column(np.float64, "K")  # of the epoch that goes on
    recent: Floats = column(np.float64, "K", BUCKETS)  # plots of no track by hashed cell, of this epoch
    earlier: Floats = column(np.float64, "K", BUCKETS)  # of those before
    met: Floats = column(np.float64, "K")  # earlier plots in the cell of a plot, over all plots
    by_chance: Floats = column(np.float64, "K")  # the mean of this, were all plots at random places

    def with_radar(self, radar: int) -> Self:
        """These counts with a row of this radar. `row` is consumed."""
        if self.row[radar] >= 0:
            return self
        self.row[radar] = len(self.met)
        return self.with_room("K", len(self.met) + 1)

    def meet(self, radar: int, time_s: float, period_s: float, position_m: Floats, free: Floats, cell_m: float) -> bool:
        """Whether plots return, after a batch of one radar that has a row. In place.

        Args: time_s: the newest; period_s: of one turn; position_m: (M, 2); free: (M,) probability that the plot is of no track;
        cell_m: side of a cell.
        """
        k = self.row[radar]
        passed = turns_between(float(self.newest_s[k]), time_s, period_s)
        self.newest_s[k] = np.fmax(time_s, self.newest_s[k])
        for count in (self.earlier, self.met, self.by_chance):
            count[k] *= np.exp(-passed / MEMORY_TURNS)
        self.turns[k] += passed
        if self.turns[k] >= EPOCH_TURNS:
            self.earlier[k] += self.recent[k]
            self.recent[k], self.turns[k] = 0.0, 0.0
        east, north = np.floor(position_m / cell_m).astype(np.int64).T
        bucket = (east * 73856093 ^ north * 19349663) % BUCKETS
        self.met[k] += free @ self.earlier[k, bucket]
        self.by_chance[k] += free.sum() * self.earlier[k].mean()
        np.add.at(self.recent[k], bucket, free)
        met, chance = float(self.met[k]), float(self.by_chance[k])
        return met > TIMES_BY_CHANCE * chance + SIGMAS * float(np.sqrt(chance)) + LEAST_MET
