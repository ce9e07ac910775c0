"""The plots of a cycle in batches, in which every track is given its plots at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Ints, Plots
from coastwatch.kernels.tracks.columns import PlotColumns

DAY_S = 86400.0  # older plots are from a clock that is not set


@dataclass(frozen=True)
class PlotBatch:
    """Consecutive plots of a cycle. A batch of one radar that is shorter than half a turn gives a track one plot at most."""

    first: int  # row of the cycle's plots
    columns: PlotColumns
    ends_slice: bool  # it is the last batch of its slice of time


@dataclass(frozen=True, eq=False)
class PlotBatches:
    """The plots of a cycle in the order of their batches."""

    plots: Plots
    start: list[int]  # first row of each batch, and the end of the last
    slice_: list[int]  # of each batch

    def __iter__(self) -> Iterator[PlotBatch]:
        p = self.plots
        for k, (first, end) in enumerate(zip(self.start[:-1], self.start[1:], strict=True)):
            ends = k + 1 == len(self.slice_) or self.slice_[k + 1] != self.slice_[k]
            at = slice(first, end)
            columns = PlotColumns(p.time_s[at], p.position_m[at], p.covariance[at], p.sensor[at], p.origin[at])
            yield PlotBatch(first, columns, ends)


def cut(plots: Plots, slice_s: float, by_radar: bool) -> PlotBatches:
    """Batches of plots in one slice of time, each sorted by time. Args: by_radar: a batch for each radar in the slice.

    Plots of one time are sorted by position, so that the order in which they came is of no matter.
    """
    order = np.argsort(plots.time_s, kind="stable")
    if (np.diff(plots.time_s[order]) == 0.0).any():
        order = np.lexsort((plots.position_m[:, 1], plots.position_m[:, 0], plots.time_s))
    slice_ = np.floor(plots.time_s[order] / slice_s)
    number: Ints = np.cumsum(np.diff(slice_, prepend=slice_[:1]) > 0.0)
    key = number
    if by_radar:
        key = number * (int(plots.sensor.max(initial=0)) + 1) + plots.sensor[order]
        by_key = np.argsort(key, kind="stable")
        key, number, order = key[by_key], number[by_key], order[by_key]
    start = np.flatnonzero(np.diff(key, prepend=-1))
    return PlotBatches(plots.take(order), [*start.tolist(), len(plots)], number[start].tolist())


def is_usable(plots: Plots, time_s: float, ahead_s: float) -> Bools:
    """Which plots can be believed: finite, not from after the cycle, and not older than a day. (M,)"""
    numbers = np.column_stack([plots.time_s, plots.position_m, plots.covariance.reshape(-1, 4)])
    lived = (plots.time_s <= time_s + ahead_s) & (plots.time_s > time_s - DAY_S)
    good: Bools = np.logical_and(np.isfinite(numbers).all(axis=1), lived)
    return good
