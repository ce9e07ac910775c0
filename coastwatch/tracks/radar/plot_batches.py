"""The plots of a cycle in batches, in which every track is given its plots at once."""

from __future__ import annotations

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


def cut(plots: Plots, slice_s: float, by_radar: bool) -> tuple[Plots, list[PlotBatch]]:
    """The plots in the order of their batches, and the batches. A batch is of one slice of time, sorted by time.

    Plots of one time are sorted by position, so that the order in which they came is of no matter.
    Args: by_radar: a batch for each radar in the slice.
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
    p, begin = plots.take(order), np.flatnonzero(np.diff(key, prepend=-1))
    end, ends_slice = np.append(begin[1:], len(p))[: len(begin)], np.diff(number[begin], append=-1) != 0
    batches = []
    for first, last, ends in zip(begin.tolist(), end.tolist(), ends_slice.tolist(), strict=True):
        at = slice(first, last)
        columns = PlotColumns(p.time_s[at], p.position_m[at], p.covariance[at], p.sensor[at], p.origin[at])
        batches.append(PlotBatch(first, columns, ends))
    return p, batches


def is_usable(plots: Plots, time_s: float, ahead_s: float) -> Bools:
    """Which plots can be believed: finite, not from after the cycle, and not older than a day. (M,)"""
    numbers = np.column_stack([plots.time_s, plots.position_m, plots.covariance.reshape(-1, 4)])
    lived = (plots.time_s <= time_s + ahead_s) & (plots.time_s > time_s - DAY_S)
    good: Bools = np.logical_and(np.isfinite(numbers).all(axis=1), lived)
    return good
