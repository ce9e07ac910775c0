"""Memory of a radar tracker: a table of tracks in slots, and site and newest plot of each radar."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Self

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, Radars, Unproven
from coastwatch.batches.struct import Struct, column, part
from coastwatch.kernels.tracks import columns
from coastwatch.kernels.tracks.columns import NAMES, ExistenceColumns, PlotColumns, TrackLife, VesselIds
from coastwatch.tracks.radar.clutter import (
    ClutterMap,
    ClutterSettings,
    cell_sides,
    empty_map,
    false_plots_per_m2,
    has_moved,
    learn,
)
from coastwatch.tracks.radar.leaves import Decided, Forest
from coastwatch.tracks.radar.motion import HasFilters
from coastwatch.tracks.radar.plot_filters import PlotFilters
from coastwatch.tracks.radar.rates import LearntRates
from coastwatch.tracks.radar.returns import Returns

NEWEST = 5  # plots whose origin is kept, for the scores
SPARE = 4  # one spare slot for so many used ones, so that few cycles have to enlarge the table


class Status(IntEnum):
    """Status of a track."""

    SINGLE = columns.SINGLE  # one plot
    TENTATIVE = columns.TENTATIVE
    CONFIRMED = columns.CONFIRMED


@dataclass(frozen=True, eq=False)
class Table(HasFilters, Struct):
    """Tracks of one region. A track keeps its slot, a row of the columns with the letter S, for as long as it lives.

    Trackers write into the columns. A slot without a track holds anything.
    """

    live: Ints = column(np.int64, "N", rows_of="S")  # slots of the tracks, the older first
    free: Ints = column(np.int64, "F", rows_of="S")  # the other slots
    track_id: Ints = column(np.int64, "S")
    status: Ints = column(np.int64, "S")
    hits: Ints = column(np.int64, "S")  # plots and AIS messages so far
    started_s: Floats = column(np.float64, "S")
    updated_s: Floats = column(np.float64, "S")  # time of the state: the newest plot or message
    state: Floats = column(np.float64, "S", "J", 5)  # at updated_s
    covariance: Floats = column(np.float64, "S", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "S", "J")
    combined_mean: Floats = column(np.float64, "S", 4)  # over the models, at updated_s
    combined_covariance: Floats = column(np.float64, "S", 4, 4)
    noise_m2_s3: Floats = column(np.float64, "S")  # density of white acceleration, over the models
    radar_s: Floats = column(np.float64, "S", "R")  # newest plot of each radar, -inf where there is none
    began_m: Floats = column(np.float64, "S", 2)  # position of the first plot
    began_m2: Floats = column(np.float64, "S")  # variance of that position, both axes together
    moved: Bools = column(np.bool_, "S")  # from there, at some time
    existence: Floats = column(np.float64, "S")  # probability, at existence_s; 1 where a tracker does not estimate it
    visibility: Floats = column(np.float64, "S")  # probability that radars can see the vessel, if it exists
    existence_s: Floats = column(np.float64, "S")
    looked_s: Floats = column(np.float64, "S", "R")  # up to which the looks of each radar are in existence and visibility
    misses: Floats = column(np.float64, "S")  # looks without a plot since the newest one, less of a radar that misses much
    message_s: Floats = column(np.float64, "S")  # newest AIS message, -inf where there is none
    ids: Ints = column(np.int64, "S", NAMES)  # MMSI that the vessel may have, -1 where there is none
    id_probability: Floats = column(np.float64, "S", NAMES + 2)  # that it has no MMSI, each of these, any other
    particles: Floats = column(np.float64, "S", "P", 4)  # at updated_s, of trackers that have them
    origins: Ints = column(np.int64, "S", NEWEST)  # of the newest plots, newest first; -1 beyond the first
    extent: Floats = column(np.float64, "S", 3)  # mean second moments of the echo, m2: east, east and north, north
    extent_plots: Ints = column(np.int64, "S")  # plots in it, at most `extent.MOST_WEIGHT`

    def __len__(self) -> int:
        return len(self.live)

    @property
    def life(self) -> TrackLife:
        """The status of each slot and the plots behind it."""
        return TrackLife(self.status, self.hits, self.started_s, self.radar_s, self.origins)

    @property
    def existing(self) -> ExistenceColumns:
        """Existence and visibility of each slot."""
        return ExistenceColumns(self.existence, self.visibility, self.existence_s, self.looked_s, self.misses, self.radar_s)

    @property
    def vessel_ids(self) -> VesselIds:
        """The ids that the vessel of each slot may have."""
        return VesselIds(self.ids, self.id_probability)

    def probable_ids(self, slots: Ints, probability: float) -> Ints:
        """The MMSI of each of these tracks, -1 where none has this probability, which is above one half. (N,)"""
        names = self.id_probability[slots, 1:-1]
        best = names.argmax(axis=1)
        row = np.arange(len(slots))
        return np.where(names[row, best] >= probability, self.ids[slots, best], -1)

    def note_moved(self, settings: ClutterSettings, slots: Ints) -> None:
        """Mark the tracks in these slots that have moved from their first plot."""
        slots = slots[~self.moved[slots]]
        variance = self.began_m2[slots] + self.combined_covariance[slots, 0, 0] + self.combined_covariance[slots, 1, 1]
        self.moved[slots] = has_moved(settings, self.began_m[slots], self.combined_mean[slots, :2], variance)

    def moving(self, slots: Ints) -> Bools:
        """Which of these tracks are confirmed and have moved; none in slot -1. (N,)"""
        return (slots >= 0) & self.moved[slots] & (self.status[slots] == Status.CONFIRMED) if len(self.moved) else slots >= 0

    def with_free_slots(self, count: int) -> Self:
        """This table with at least so many free slots."""
        missing = count - len(self.free)
        if missing <= 0:
            return self
        before = len(self.track_id)
        size = before + missing + (before + missing) // SPARE
        return replace(self.with_room("S", size), free=np.concatenate([np.arange(size - 1, before - 1, -1), self.free]))

    def with_slots(self, track_id: Ints) -> tuple[Self, Ints]:
        """This table with a slot for each of these new track ids, increasing, and the slots. The caller fills their columns."""
        table = self.with_free_slots(len(track_id))
        left = len(table.free) - len(track_id)
        slots = table.free[left:][::-1]
        table.track_id[slots] = track_id
        return replace(table, live=np.concatenate([table.live, slots]), free=table.free[:left]), slots

    def without(self, lost: Bools) -> Self:
        """This table without some of its tracks, whose slots are free. Args: lost: (N,) of `live`."""
        if not lost.any():
            return self
        return replace(self, live=self.live[~lost], free=np.concatenate([self.free, self.live[lost]]))


@dataclass(frozen=True, eq=False)
class Duplicates(Batch):
    """Pairs of tracks that may be one vessel."""

    first: Ints = column(np.int64, "A")  # track ids
    second: Ints = column(np.int64, "A")
    since_s: Floats = column(np.float64, "A")


@dataclass(frozen=True, eq=False)
class RadarMemory(Struct):
    """One region between two cycles."""

    site_m: Floats = column(np.float64, "R", 2, new=np.nan)  # where each radar was last, NaN where it has sent nothing
    newest_plot_s: Floats = column(np.float64, "R", new=-np.inf)  # newest plot of each radar, -inf where it has sent nothing
    table: Table = part(Table)
    duplicates: Duplicates = part(Duplicates)
    rates: LearntRates = part(LearntRates)
    returns: Returns = part(Returns)  # where each radar decides for a clutter map
    next_id: int = 1  # within the region
    clutter: ClutterMap = field(default_factory=ClutterMap.empty)
    plots_alone: PlotFilters = field(default_factory=PlotFilters.empty)  # where messages guide the association
    forest: Forest = field(default_factory=Forest.empty)  # of multi-hypothesis tracks

    def check_rows(self) -> None:
        """Check the number of radars, and the leaves, as after reading a checkpoint. Raises: ValueError."""
        if self.table.radar_s.shape[1] != len(self.newest_plot_s):
            raise ValueError(f"Table.radar_s: got {self.table.radar_s.shape[1]} radars, needed {len(self.newest_plot_s)}")
        if self.plots_alone.models and len(self.plots_alone) != len(self.table.track_id):
            raise ValueError(f"PlotFilters: got {len(self.plots_alone)} slots, needed {len(self.table.track_id)}")
        self.forest.check_slots(self.table.mode_probability.shape, self.table.radar_s.shape[1])

    def fitting(self, models: int, count: int) -> RadarMemory:
        """This memory, before the first cycle with arrays for so many radars. Args: models: J; count: of radars.

        Raises: ValueError where the memory is of a scenario with another number of models or radars.
        """
        if self.table.mode_probability.shape[1] != models:
            raise ValueError(f"memory of radar tracks: got {self.table.mode_probability.shape[1]} models, needed {models}")
        if len(self.newest_plot_s) == count:
            return self
        if len(self.newest_plot_s):
            raise ValueError(f"memory of radar tracks: got {len(self.newest_plot_s)} radars, needed {count}")
        return RadarMemory.empty(J=models, P=self.table.particles.shape[1], R=count)

    def without_radars(self, moved: Bools) -> RadarMemory:
        """This memory without the tracks that hold plots of these radars (R,), whose registration has jumped."""
        if not moved.any() or not len(self.newest_plot_s):
            return self
        held = np.logical_or.reduce(np.isfinite(self.table.radar_s[self.table.live][:, moved]), axis=1)
        return replace(self, table=self.table.without(held), clutter=self.clutter.without_radars(moved))

    def without_reported(self) -> RadarMemory:
        """This memory without what was reported of this cycle: states of the past, and the count of unproven choices."""
        return replace(self, forest=replace(self.forest, decided=Decided.empty(), unproven=Unproven()))

    def with_plots_alone(self, models: int) -> RadarMemory:
        """This memory with filters of plots alone, if it has none of so many models: it is of another tracker. Args: models: J of each."""
        if self.plots_alone.models == models:
            return self
        return replace(self, plots_alone=PlotFilters.empty(S=len(self.table.track_id), J=models))

    def with_clutter_map(self, settings: ClutterSettings, radars: Radars) -> RadarMemory:
        """This memory with an empty clutter map, if all radars are to learn one and there is none."""
        if settings.learnt is not True or len(self.clutter.side):
            return self
        return replace(self, clutter=empty_map(settings, radars, np.ones(len(radars), np.bool_)))

    def decided(self, settings: ClutterSettings, radars: Radars, batch: PlotColumns, free: Floats) -> RadarMemory:
        """This memory with a clutter map of the radar of a batch, if its plots of no track return. Args: free: as of `Returns.meet`."""
        if settings.learnt != "by_radar":
            return self
        radar = int(batch.sensor[0])
        returns = self.returns.with_radar(radar)
        cell_m, period_s = float(cell_sides(settings, radars)[radar]), float(radars.period_s[radar])
        they_do = returns.meet(radar, float(batch.time.max()), period_s, batch.position, free, cell_m)
        if they_do and not self.clutter.has(radar):
            return replace(self, returns=returns, clutter=self.clutter.with_radar(settings, radars, radar))
        return replace(self, returns=returns)

    def false_plots_per_m2(self, settings: ClutterSettings, batch: PlotColumns, constant: float) -> Floats:
        """The density of false plots in one look at each plot of a batch of one radar. (M,) Args: constant: where none is learnt."""
        radar = int(batch.sensor[0])
        if not self.clutter.has(radar):
            return np.full(len(batch.time), constant)
        return false_plots_per_m2(settings, self.clutter, radar, batch.position, constant)

    def with_clutter(self, settings: ClutterSettings, batch: PlotColumns, false: Floats, period_s: float) -> RadarMemory:
        """This memory with the plots of a batch of one radar in its clutter map.

        Args: false: (M,) probability that the plot belongs to no confirmed track that has moved; period_s: of one turn.
        """
        radar = int(batch.sensor[0])
        if not self.clutter.has(radar):
            return self
        return replace(self, clutter=learn(settings, self.clutter, radar, batch.time, batch.position, false, period_s))
