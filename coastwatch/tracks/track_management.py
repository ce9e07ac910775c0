"""The life of radar tracks: settings, confirmation by hits in looks, deletion by misses, and removal of duplicates."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Plots
from coastwatch.kernels.filters.gaussian import gate, squared_distance
from coastwatch.stage import Settings
from coastwatch.tracks.table import Coverage, Duplicates, Status, Table

DAY_S = 86400.0  # older plots are from a clock that is not set
PAIR = 2**31  # more than there are tracks of a region in a run

Positive = Annotated[float, Field(gt=0.0)]
Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
Count = Annotated[int, Field(ge=1)]
PlotOrigin = Literal["estimated", "known"]


class TrackManagement(Settings):
    """Gates, initiation, deletion. A look is one turn of a radar that covers the track."""

    slice_s: Positive = 1.0  # plots are processed in slices of this length, at most half a turn of the fastest radar
    gate_probability: Probability = 0.999  # that a vessel's own plot is inside the gate
    detection_probability: Probability = 0.9  # of a vessel in one look
    false_plots_per_m2: Positive = 1e-6  # clutter and new vessels, in one look
    max_speed_kn: Positive = 50.0  # between the first two plots of a track
    confirm_hits: Annotated[int, Field(ge=2)] = 4
    confirm_looks: Count = 5
    delete_misses: Count = 5  # looks in a row
    misses_per_hit: Positive = 0.5  # a track ends after this many misses for each hit, at most `delete_misses`
    look_slack: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.1  # a look is counted as over after 1 + look_slack turns
    coast_s: Positive = 30.0  # longest time without a plot, also outside the range of every radar
    merge_probability: Probability = 0.99  # that two tracks of one vessel pass the test for duplicates
    merge_looks: Count = 3  # turns after which the younger of two such tracks is deleted
    late_s: Positive = 5.0  # a plot up to this much older than its track is used
    ahead_s: Positive = 5.0  # a plot stamped more than this after the cycle is dropped

    @model_validator(mode="after")
    def _hits_fit_into_looks(self) -> Self:
        if self.confirm_hits > self.confirm_looks:
            raise ValueError(f"confirm_hits: got {self.confirm_hits}, needed at most confirm_looks = {self.confirm_looks}")
        return self


def looks(management: TrackManagement, coverage: Coverage, newest_plot_s: Floats, position_m: Floats, since_s: Floats) -> Ints:
    """How often radars have looked at each position since a time. (N,)

    Looks are counted from the newest plot of a radar: one that sends nothing has not looked.
    Args: newest_plot_s: (R,) newest plot of each radar of the scenario; position_m: (N, 2); since_s: (N,).
    """
    waited = np.maximum(newest_plot_s[coverage.radars] - since_s[:, None], 0.0)
    turns = np.floor(waited / coverage.period_s - management.look_slack)
    seen: Ints = np.where(coverage.sees(position_m), np.maximum(turns, 0.0), 0.0).sum(axis=1).astype(np.int64)
    return seen


def confirm_and_delete(
    management: TrackManagement, table: Table, coverage: Coverage, newest_plot_s: Floats, time_s: float
) -> Table:
    """Confirm the tracks with enough hits, and delete those without, and those that are lost.

    A single plot lives for one look (two plots in two looks begin a track), a tentative track for `confirm_looks`.
    """
    position = table.state[:, 0, :2] + table.state[:, 0, 2:4] * np.maximum(time_s - table.updated_s, 0.0)[:, None]
    age = 1 + looks(management, coverage, newest_plot_s, position, table.started_s)
    missed = looks(management, coverage, newest_plot_s, position, table.updated_s)
    confirmed = (table.status == Status.CONFIRMED) | (table.hits >= management.confirm_hits)
    allowed = np.minimum(management.delete_misses, np.ceil(management.misses_per_hit * table.hits))
    tried = np.where(table.status == Status.SINGLE, 2, management.confirm_looks)
    lost = np.where(confirmed, missed >= allowed, age >= tried)
    lost |= time_s - table.updated_s > management.coast_s
    status = np.where(confirmed, np.int64(Status.CONFIRMED), table.status)
    kept = replace(table, status=status)
    return kept.take(~lost) if lost.any() else kept


def remove_duplicates(
    management: TrackManagement,
    table: Table,
    duplicates: Duplicates,
    mean: Floats,
    covariance: Floats,
    period_s: Floats,
    time_s: float,
) -> tuple[Table, Duplicates]:
    """Delete the younger of two tracks that have been one vessel for `merge_looks` turns. Returns: the table, pairs still suspected.

    Two tracks are suspected while their difference may be zero, by their covariances, and no radar gave both a plot in one look: a
    vessel gives a radar one plot a look.
    Args: mean: (N, 5), covariance: (N, 5, 5) of all tracks at one time; period_s: (R,) of one turn.
    """
    first, second = _possible_duplicates(management, table, mean, covariance)
    served = np.isfinite(table.radar_s[first]) & np.isfinite(table.radar_s[second])
    apart = np.subtract(table.radar_s[first], table.radar_s[second], where=served, out=np.full(served.shape, np.inf))
    both = (np.abs(apart) < 0.5 * period_s).any(axis=1)
    first, second = first[~both], second[~both]
    newest = np.maximum(np.maximum(table.updated_s[first], table.updated_s[second]), time_s)
    since = _since(duplicates, table.track_id[first], table.track_id[second], newest)
    served = np.isfinite(table.radar_s[first]) | np.isfinite(table.radar_s[second])
    turn = np.where(served, period_s, 0.0).max(axis=1, initial=0.0)
    same = time_s - since >= management.merge_looks * turn
    keep = np.ones(len(table), np.bool_)
    keep[_younger(table, first[same], second[same])] = False
    kept = keep[first] & keep[second]
    pairs = Duplicates(table.track_id[first[kept]], table.track_id[second[kept]], since[kept])
    return table.take(keep), pairs


def _possible_duplicates(management: TrackManagement, table: Table, mean: Floats, covariance: Floats) -> tuple[Ints, Ints]:
    """Pairs of tracks of more than one plot, the lower row first, whose difference may be zero."""
    rows = np.flatnonzero(table.status != Status.SINGLE)
    furthest = gate(management.merge_probability, 4)
    sigma = np.sqrt(covariance[rows, 0, 0] + covariance[rows, 1, 1])
    radius = np.sqrt(furthest * (sigma**2 + float(sigma.max(initial=0.0)) ** 2))
    a, b = kernels.geometry.neighbours.near_pairs(mean[rows, :2], radius, mean[rows, :2])
    first, second = rows[a[a < b]], rows[b[a < b]]
    gap = mean[first, :4] - mean[second, :4]
    spread = covariance[first, :4, :4] + covariance[second, :4, :4]
    alike = squared_distance(gap, spread) <= furthest
    return first[alike], second[alike]


def _since(duplicates: Duplicates, first: Ints, second: Ints, now_s: Floats) -> Floats:
    """Since when each of these pairs is suspected: now, where it was not before. Pairs are sorted, before and now."""
    if len(duplicates) == 0:
        return now_s
    old, new = duplicates.first * PAIR + duplicates.second, first * PAIR + second
    at = np.minimum(np.searchsorted(old, new), len(old) - 1)
    since: Floats = np.where(old[at] == new, duplicates.since_s[at], now_s)
    return since


def _younger(table: Table, first: Ints, second: Ints) -> Ints:
    """Of each pair of rows the one with the lower status, or else the one that began later."""
    further = np.where(table.status[first] != table.status[second], table.status[first] > table.status[second], first < second)
    younger: Ints = np.where(further, second, first)
    return younger


def is_usable(management: TrackManagement, plots: Plots, time_s: float) -> Bools:
    """Which plots can be believed: finite, not from after the cycle, and not older than a day. (M,)"""
    numbers = np.column_stack([plots.time_s, plots.position_m, plots.covariance.reshape(-1, 4)])
    lived = (plots.time_s <= time_s + management.ahead_s) & (plots.time_s > time_s - DAY_S)
    good: Bools = np.logical_and(np.isfinite(numbers).all(axis=1), lived)
    return good
