"""The life of radar tracks: promotion by hits in looks, deletion by misses, and the end of tracks that are one vessel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Plots
from coastwatch.kernels.filters.gaussian import gate, squared_distance
from coastwatch.tracks.table import Coverage, Stage, Table, Twins
from coastwatch.tracks.upkeep import Upkeep

DAY_S = 86400.0  # older plots are of a clock that was never set
PAIR = 2**31  # more than there are tracks of a region in a run


def looks(upkeep: Upkeep, coverage: Coverage, heard_s: Floats, position_m: Floats, since_s: Floats) -> Ints:
    """How often radars have surely looked at each place since a time, by what they have sent. (N,)

    A radar that sends nothing at all has not looked.
    Args: heard_s: (R,) newest plot of each radar of the scenario; position_m: (N, 2); since_s: (N,).
    """
    waited = np.maximum(heard_s[coverage.radars] - since_s[:, None], 0.0)
    turns = np.floor(waited / coverage.period_s - upkeep.look_slack)
    seen: Ints = np.where(coverage.sees(position_m), np.maximum(turns, 0.0), 0.0).sum(axis=1).astype(np.int64)
    return seen


def survivors(upkeep: Upkeep, table: Table, coverage: Coverage, heard_s: Floats, time_s: float) -> Table:
    """The table with tracks promoted that have the hits, and without those that have not or are lost.

    A single plot lives for one look (two plots in two looks begin a track), a tentative track for `confirm_looks`.
    """
    place = table.state[:, 0, :2] + table.state[:, 0, 2:4] * np.maximum(time_s - table.updated_s, 0.0)[:, None]
    age = 1 + looks(upkeep, coverage, heard_s, place, table.started_s)
    missed = looks(upkeep, coverage, heard_s, place, table.updated_s)
    confirmed = (table.stage == Stage.CONFIRMED) | (table.hits >= upkeep.confirm_hits)
    allowed = np.minimum(upkeep.delete_misses, np.ceil(upkeep.misses_per_hit * table.hits))
    tried = np.where(table.stage == Stage.SINGLE, 2, upkeep.confirm_looks)
    lost = np.where(confirmed, missed >= allowed, age >= tried)
    lost |= time_s - table.updated_s > upkeep.coast_s
    stage = np.where(confirmed, np.int64(Stage.CONFIRMED), table.stage)
    kept = replace(table, stage=stage)
    return kept.take(~lost) if lost.any() else kept


def without_twins(
    upkeep: Upkeep, table: Table, twins: Twins, mean: Floats, covariance: Floats, period_s: Floats, time_s: float
) -> tuple[Table, Twins]:
    """The table without the younger of any two tracks that have been one vessel for `merge_looks` turns, and the suspects.

    Two tracks are suspected while their difference is zero as far as they know and no radar has served both in one look: what
    gives a radar two plots is two vessels.
    Args: mean: (N, 5), covariance: (N, 5, 5) of all tracks at one time; period_s: (R,) of one turn.
    """
    first, second = _alike(upkeep, table, mean, covariance)
    served = np.isfinite(table.radar_s[first]) & np.isfinite(table.radar_s[second])
    apart = np.subtract(table.radar_s[first], table.radar_s[second], where=served, out=np.full(served.shape, np.inf))
    both = (np.abs(apart) < 0.5 * period_s).any(axis=1)
    first, second = first[~both], second[~both]
    newest = np.maximum(np.maximum(table.updated_s[first], table.updated_s[second]), time_s)
    since = _since(twins, table.track_id[first], table.track_id[second], newest)
    served = np.isfinite(table.radar_s[first]) | np.isfinite(table.radar_s[second])
    turn = np.where(served, period_s, 0.0).max(axis=1, initial=0.0)
    same = time_s - since >= upkeep.merge_looks * turn
    keep = np.ones(len(table), np.bool_)
    keep[_younger(table, first[same], second[same])] = False
    kept = keep[first] & keep[second]
    pairs = Twins(table.track_id[first[kept]], table.track_id[second[kept]], since[kept])
    return table.take(keep), pairs


def _alike(upkeep: Upkeep, table: Table, mean: Floats, covariance: Floats) -> tuple[Ints, Ints]:
    """Pairs of tracks of more than one plot, the lower row first, whose difference may be zero."""
    rows = np.flatnonzero(table.stage != Stage.SINGLE)
    furthest = gate(upkeep.merge_probability, 4)
    sigma = np.sqrt(covariance[rows, 0, 0] + covariance[rows, 1, 1])
    reach = np.sqrt(furthest * (sigma**2 + float(sigma.max(initial=0.0)) ** 2))
    a, b = kernels.geometry.neighbours.near_pairs(mean[rows, :2], reach, mean[rows, :2])
    first, second = rows[a[a < b]], rows[b[a < b]]
    gap = mean[first, :4] - mean[second, :4]
    spread = covariance[first, :4, :4] + covariance[second, :4, :4]
    alike = squared_distance(gap, spread) <= furthest
    return first[alike], second[alike]


def _since(twins: Twins, first: Ints, second: Ints, now_s: Floats) -> Floats:
    """Since when each of these pairs is suspected: now, where it was not before. Pairs are sorted, before and now."""
    if len(twins) == 0:
        return now_s
    old, new = twins.first * PAIR + twins.second, first * PAIR + second
    at = np.minimum(np.searchsorted(old, new), len(old) - 1)
    since: Floats = np.where(old[at] == new, twins.since_s[at], now_s)
    return since


def _younger(table: Table, first: Ints, second: Ints) -> Ints:
    """Of each pair the row that is less far, or else began later."""
    further = np.where(table.stage[first] != table.stage[second], table.stage[first] > table.stage[second], first < second)
    younger: Ints = np.where(further, second, first)
    return younger


def quick_enough(slice_s: float, period_s: Floats) -> float:
    """The length of a slice of time: as set, and not longer than half a turn."""
    return min(slice_s, 0.5 * float(period_s.min(initial=np.inf)))


def usable(upkeep: Upkeep, plots: Plots, time_s: float) -> Bools:
    """Which plots can be believed: finite, not from after the cycle, and not older than a day. (M,)"""
    numbers = np.column_stack([plots.time_s, plots.position_m, plots.covariance.reshape(-1, 4)])
    lived = (plots.time_s <= time_s + upkeep.ahead_s) & (plots.time_s > time_s - DAY_S)
    good: Bools = np.logical_and(np.isfinite(numbers).all(axis=1), lived)
    return good
