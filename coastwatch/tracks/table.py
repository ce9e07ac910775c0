"""Memory of the radar tracker: a table of tracks, and site and newest plot of each radar."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, Plots, Sensors, column
from coastwatch.geodesy import to_plane
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.motion import Filters

NEWEST = 5  # plots whose origin is kept, for the scores


class Status(IntEnum):
    """Status of a track."""

    SINGLE = 0  # one plot
    TENTATIVE = 1
    CONFIRMED = 2


@dataclass(frozen=True, eq=False)
class Table(Batch):
    """Tracks of one region, the older first."""

    track_id: Ints = column(np.int64, "N")  # increasing
    status: Ints = column(np.int64, "N")
    state: Floats = column(np.float64, "N", "J", 5)  # at updated_s
    covariance: Floats = column(np.float64, "N", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "N", "J")
    started_s: Floats = column(np.float64, "N")
    updated_s: Floats = column(np.float64, "N")  # newest plot
    hits: Ints = column(np.int64, "N")
    radar_s: Floats = column(np.float64, "N", "R")  # newest plot of each radar, -inf where there is none
    origins: Ints = column(np.int64, "N", NEWEST)  # of the newest plots, newest first; -1 beyond the first

    @property
    def filters(self) -> Filters:
        return Filters(self.state, self.covariance, self.mode_probability)


@dataclass(frozen=True, eq=False)
class UsedPlots:
    """Plots, and the track of the region that took each."""

    track_id: Ints  # (M,)
    plots: Plots  # (M,)

    @classmethod
    def join(cls, parts: list[UsedPlots]) -> UsedPlots:
        return cls(np.concatenate([p.track_id for p in parts]), Plots.join([p.plots for p in parts]))


@dataclass(frozen=True, eq=False)
class Duplicates(Batch):
    """Pairs of tracks that may be one vessel."""

    first: Ints = column(np.int64, "A")  # track ids
    second: Ints = column(np.int64, "A")
    since_s: Floats = column(np.float64, "A")


@dataclass(frozen=True, eq=False)
class RadarMemory:
    """One region between two cycles."""

    table: Table
    duplicates: Duplicates
    next_id: int  # within the region
    site_m: Floats  # (R, 2) where each radar was last, NaN where it has sent nothing
    newest_plot_s: Floats  # (R,) newest plot of each radar, -inf where it has sent nothing
    dropped: int  # plots that are not finite or from the future

    @classmethod
    def empty(cls, models: int) -> RadarMemory:
        """No track yet. Args: models: J, of each filter."""
        return cls(Table.empty(J=models), Duplicates.empty(), 1, np.zeros((0, 2)), np.zeros(0), 0)

    def for_radars(self, count: int) -> RadarMemory:
        """This memory, before the first cycle with arrays for so many radars.

        Raises: ValueError where the memory is of a scenario with another number of radars.
        """
        if len(self.newest_plot_s) == count:
            return self
        if len(self.newest_plot_s):
            raise ValueError(f"memory of radar tracks: got {len(self.newest_plot_s)} radars, needed {count}")
        table = Table.empty(J=self.table.mode_probability.shape[1], R=count)
        return replace(self, table=table, site_m=np.full((count, 2), np.nan), newest_plot_s=np.full(count, -np.inf))

    def without_radars(self, moved: Bools) -> RadarMemory:
        """This memory without the tracks that hold plots of these radars (R,), whose registration has jumped."""
        if not moved.any() or not len(self.newest_plot_s):
            return self
        kept = np.isneginf(self.table.radar_s[:, moved]).all(axis=1)
        return replace(self, table=self.table.take(np.flatnonzero(kept)))

    def with_plots(self, plots: Plots) -> RadarMemory:
        """This memory with the newest site and time of each radar. Args: plots: sorted by time."""
        site, newest = self.site_m.copy(), self.newest_plot_s.copy()
        site[plots.sensor] = plots.site_m
        np.maximum.at(newest, plots.sensor, plots.time_s)
        return replace(self, site_m=site, newest_plot_s=newest)


@dataclass(frozen=True, eq=False)
class Coverage:
    """The radars of a region: sites, ranges and periods."""

    radars: Ints  # (R',) of this region
    site_m: Floats  # (R', 2)
    range_m: Floats  # (R',)
    period_s: Floats  # (R',)

    def sees(self, position_m: Floats) -> Bools:
        """Whether each position is in range of each radar. (N, R')"""
        gap = position_m[:, None] - self.site_m
        within: Bools = np.hypot(gap[..., 0], gap[..., 1]) <= self.range_m
        return within


def coverage_of(memory: RadarMemory, sensors: Sensors, region: int) -> Coverage:
    """The radars of a region, at the site of their newest plot, or before any plot at their specified site."""
    radars = np.flatnonzero(sensors.radars.region == region)
    specified = to_plane(sensors.radars.site_deg[radars], sensors.region_origin_deg[region])
    seen = memory.site_m[radars]
    site = np.where(np.isfinite(seen), seen, specified)
    return Coverage(radars, site, sensors.radars.range_m[radars], sensors.radars.period_s[radars])


def initialise(bank: FilterBank, plots: Plots, first_id: int, radars: int) -> Table:
    """A track for each of these plots."""
    n = len(plots)
    filters = bank.initialise(plots.position_m, plots.covariance)
    radar_s = np.full((n, radars), -np.inf)
    radar_s[np.arange(n), plots.sensor] = plots.time_s
    origins = np.full((n, NEWEST), -1, np.int64)
    origins[:, 0] = plots.origin
    return Table(
        track_id=first_id + np.arange(n, dtype=np.int64),
        status=np.full(n, Status.SINGLE, np.int64),
        state=filters.state,
        covariance=filters.covariance,
        mode_probability=filters.mode_probability,
        started_s=plots.time_s.copy(),
        updated_s=plots.time_s.copy(),
        hits=np.ones(n, np.int64),
        radar_s=radar_s,
        origins=origins,
    )


def with_updates(table: Table, rows: Ints, filters: Filters, plots: Plots) -> Table:
    """The table after one plot for each of these rows, no row twice.

    Args: rows: (B,); filters: of these rows, after the plots; plots: (B,).
    """
    new: dict[str, Array] = {
        name: getattr(table, name).copy()
        for name in ("state", "covariance", "mode_probability", "updated_s", "hits", "radar_s", "origins", "status")
    }
    new["state"][rows], new["covariance"][rows], new["mode_probability"][rows] = filters
    new["updated_s"][rows] = np.maximum(table.updated_s[rows], plots.time_s)
    new["hits"][rows] += 1
    new["radar_s"][rows, plots.sensor] = np.maximum(table.radar_s[rows, plots.sensor], plots.time_s)
    new["origins"][rows] = np.column_stack([plots.origin, table.origins[rows, :-1]])
    new["status"][rows] = np.maximum(table.status[rows], Status.TENTATIVE)
    return replace(table, **new)
