"""Global nearest neighbour: each track takes one plot, by gates and gains."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.tracks.radar.clutter import LEAST_PLOTS, false_plots_per_m2
from coastwatch.tracks.radar.life.hits import TrackManagement, remove_duplicates
from coastwatch.tracks.radar.parts import Parts, begin_tracks
from coastwatch.tracks.radar.plot_association import PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory, Status, Table


class NearestNeighbour(PlotAssociation):
    """Each track takes at most one plot of a look: the best one-to-one assignment. Plots that no track takes begin tracks."""

    upkeep: ClassVar[str] = "hits"
    method: Literal["nearest_neighbour"] = "nearest_neighbour"

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Give each track its plot, and begin tracks. Returns: memory, the slot of the track that took each plot, -1 for none."""
        rules, clutter = parts.hits, parts.clutter
        period_s = float(parts.sensors.radars.period_s[batch.sensor[0]])
        density = memory.false_plots_per_m2(clutter, batch, rules.false_plots_per_m2)
        slot, begins = associate(rules, memory.table, batch, period_s, density, clutter.learnt is True)
        memory = memory.with_clutter(clutter, batch, np.where(memory.table.moving(slot), 0.0, 1.0), period_s)
        update_by_single_plots(parts, memory.table, slot, batch)
        if begins.any():
            memory = begin_tracks(parts.bank, memory, np.flatnonzero(begins), batch)
        return memory, slot

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Delete duplicates, and tracks of standing echoes where the density of false plots is learnt."""
        if parts.clutter.learnt is True:
            memory = replace(memory, table=memory.table.without(_standing_echoes(parts, memory)))
        return remove_duplicates(parts.hits, memory, parts.sensors.radars.period_s, time_s)


def update_by_single_plots(parts: Parts, table: Table, slot: Ints, batch: PlotColumns) -> Ints:
    """Update each track by the plot that it takes, in place. Args: slot: (M,) -1 for none. Returns: the slots updated."""
    plots = np.flatnonzero(slot >= 0)
    plots = plots[np.argsort(slot[plots], kind="stable")]  # in the order in which filters lie in memory: it is faster
    slots: Ints = slot[plots]
    parts.single.update(table.filters, table.estimates, slots, plots, batch)
    kernels.tracks.track_life.record(table.life, slots, plots, batch)
    table.note_moved(parts.clutter, slots)
    return slots


def _standing_echoes(parts: Parts, memory: RadarMemory) -> Bools:
    """Which tracks (N) have not moved, in a cell where false plots return and are as dense as the plots of such a track would be."""
    table, rules = memory.table, parts.hits
    out = np.zeros(len(table), np.bool_)
    rows = np.flatnonzero(~table.moved[table.live])
    slots = table.live[rows]
    innovation = table.combined_covariance[slots, :2, :2] + 0.5 * table.began_m2[slots, None, None] * np.eye(2)
    own = rules.detection_probability / (2.0 * np.pi * np.sqrt(np.linalg.det(innovation)))
    newest = table.radar_s[slots].argmax(axis=1)
    for radar in np.unique(newest).tolist():
        of = np.flatnonzero(newest == radar)
        position = table.combined_mean[slots[of], :2]
        false = false_plots_per_m2(parts.clutter, memory.clutter, radar, position, rules.false_plots_per_m2)
        returns = false * memory.clutter.cell_m[radar] ** 2 >= LEAST_PLOTS
        out[rows[of]] = returns & (false > own[of])
    return out


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
