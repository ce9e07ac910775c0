"""One plot a track: gates, gains and the global nearest neighbour, or the known origin."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Sensors
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import PlotColumns, RadarColumns
from coastwatch.tracks.clutter import LEAST_PLOTS, ClutterSettings, false_plots_per_m2
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.table import RadarMemory, Status, Table, begin_tracks
from coastwatch.tracks.track_management import PlotOrigin, TrackManagement, remove_duplicates


@dataclass(frozen=True)
class NearestNeighbour:
    """Filters and settings of the tracker of a region. The steps of `coastwatch.tracks.region.RegionTracker`."""

    bank: FilterBank
    management: TrackManagement
    plot_origin: PlotOrigin
    clutter: ClutterSettings
    sensors: Sensors

    def track_batch(self, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Give each track its plot, and begin tracks. Returns: memory, the slot of the track that took each plot, -1 for none."""
        if self.plot_origin == "known":
            slot, begins = associate_by_origin(memory.table, batch)
            memory = begin_tracks(self.bank, memory, np.flatnonzero(begins), batch)
            if begins.any():  # their later plots of this batch
                slot = np.where(begins, -1, associate_by_origin(memory.table, batch)[0])
            begins[:] = False
        else:
            period_s = float(self.sensors.radars.period_s[batch.sensor[0]])
            density = memory.false_plots_per_m2(self.clutter, batch, self.management.false_plots_per_m2)
            slot, begins = associate(self.management, memory.table, batch, period_s, density, self.clutter.learnt)
            memory = memory.with_clutter(self.clutter, batch, _false(memory.table, slot), period_s)
        plots = np.flatnonzero(slot >= 0)
        plots = plots[np.argsort(slot[plots], kind="stable")]  # in the order in which filters lie in memory: it is faster
        table = memory.table
        self.bank.update(table.filters, table.estimates, slot[plots], plots, batch)
        kernels.tracks.track_life.record(table.life, slot[plots], plots, batch)
        table.note_moved(self.clutter, slot[plots])
        if self.plot_origin == "known":
            table.status[slot[plots]] = Status.CONFIRMED
        if begins.any():
            memory = begin_tracks(self.bank, memory, np.flatnonzero(begins), batch)
        return memory, slot

    def end_slice(self, memory: RadarMemory, radars: RadarColumns, ours: Ints, time_s: float) -> RadarMemory:
        """Confirm tracks with enough hits, and delete those with too many misses. Args: as of `RegionTracker`."""
        table = memory.table
        given = table.life, table.estimates, table.live, radars, ours, self.management.rules, time_s
        lost = kernels.tracks.track_life.confirm_and_find_lost(*given)
        return replace(memory, table=table.without(lost)) if lost.any() else memory

    def end_cycle(self, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Delete duplicates, and tracks of standing echoes where the density of false plots is learnt."""
        if self.plot_origin == "known":
            return memory
        if self.clutter.learnt:
            memory = replace(memory, table=memory.table.without(self._standing_echoes(memory)))
        given = memory.table, memory.duplicates, self.sensors.radars.period_s, time_s
        table, pairs = remove_duplicates(self.management, *given)
        return replace(memory, table=table, duplicates=pairs)

    def shown(self, table: Table, time_s: float) -> Ints:
        """Slots of the confirmed tracks."""
        slots: Ints = table.live[table.status[table.live] == Status.CONFIRMED]
        return slots

    def existence(self, table: Table, slots: Ints, time_s: float) -> Floats:
        """Not estimated."""
        return np.full(len(slots), np.nan)

    def _standing_echoes(self, memory: RadarMemory) -> Bools:
        """Which tracks (N) have not moved, in a cell where false plots return and are as dense as the plots of such a track would be."""
        table, constant = memory.table, self.management.false_plots_per_m2
        out = np.zeros(len(table), np.bool_)
        rows = np.flatnonzero(~table.moved[table.live])
        slots = table.live[rows]
        innovation = table.combined_covariance[slots, :2, :2] + 0.5 * table.began_m2[slots, None, None] * np.eye(2)
        own = self.management.detection_probability / (2.0 * np.pi * np.sqrt(np.linalg.det(innovation)))
        newest = table.radar_s[slots].argmax(axis=1)
        for radar in np.unique(newest).tolist():
            of = np.flatnonzero(newest == radar)
            position = table.combined_mean[slots[of], :2]
            false = false_plots_per_m2(self.clutter, memory.clutter, radar, position, constant)
            returns = false * memory.clutter.cell_m[radar] ** 2 >= LEAST_PLOTS
            out[rows[of]] = returns & (false > own[of])
        return out


def _false(table: Table, slot: Ints) -> Floats:
    """1 for each plot that went to no confirmed track that has moved, else 0. (M,) Args: slot: (M,) -1 for none."""
    moving = np.zeros(len(slot), np.bool_)
    taken = np.flatnonzero(slot >= 0)
    moving[taken] = table.moved[slot[taken]] & (table.status[slot[taken]] == Status.CONFIRMED)
    return np.where(moving, 0.0, 1.0)


def associate(
    management: TrackManagement,
    table: Table,
    batch: PlotColumns,
    period_s: float,
    false_plots_per_m2: Floats,
    by_place: bool,
) -> tuple[Ints, Bools]:
    """The slot of the track that takes each plot of a batch, -1 for none, and which plots may begin a track. (M,), (M,)

    The gain of a pair is the log-likelihood ratio of "its plot" against "track missed, plot false or new". Where the density of
    false plots is known by place, a track that is not confirmed may itself be false, and then nothing was missed.
    Args: batch: plots of one radar; period_s: of one turn of it; false_plots_per_m2: (M,) in one look, at each plot; by_place: it
    was learnt.
    """
    limit = gate(management.gate_probability, 2)
    pairs = kernels.tracks.gate.candidates(table.estimates, table.live, batch, limit, management.late_s)
    found, missed = math.log(management.detection_probability), math.log(1.0 - management.detection_probability)
    gain = pairs.log_likelihood + (found - missed) - np.log(false_plots_per_m2)[pairs.plot]
    if by_place:
        gain[table.status[pairs.track] != Status.CONFIRMED] += missed
    due = batch.time[pairs.plot] - table.radar_s[pairs.track, batch.sensor[0]] > 0.5 * period_s
    max_speed = management.max_speed_kn * KNOT_M_S
    due &= kernels.tracks.gate.reachable(pairs, table.estimates, table.status, batch, max_speed)
    slot, free = kernels.tracks.plot_assignment.assign_plots(pairs, gain, due, table.status, len(batch.time))
    return slot, free


def associate_by_origin(table: Table, batch: PlotColumns) -> tuple[Ints, Bools]:
    """As `associate`, by the known vessel behind each plot: clutter is dropped, the first plot of a new vessel begins a track."""
    at = kernels.tables.match_ids.index_of(table.origins[table.live, 0], batch.origin)
    slot = np.where(at >= 0, np.append(table.live, -1)[at], -1)
    unknown = np.flatnonzero((slot < 0) & (batch.origin >= 0))
    _, first = np.unique(batch.origin[unknown], return_index=True)
    begins = np.zeros(len(slot), np.bool_)
    begins[unknown[first]] = True
    return slot, begins
