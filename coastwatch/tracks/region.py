"""One cycle of a region: its plots update its tracks; the confirmed tracks are yielded in latitude and longitude."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Measurements, Plots, Sensors, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tracks.columns import PlotColumns, RadarColumns
from coastwatch.tracks.clutter import ClutterSettings, empty_map, false_plots_per_m2, has_moved, learn
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.plot_association import associate, associate_by_origin
from coastwatch.tracks.plot_batches import cut
from coastwatch.tracks.report import report, report_measurements
from coastwatch.tracks.table import RadarMemory, Status, Table, begin_tracks
from coastwatch.tracks.track_management import PlotOrigin, TrackManagement, is_usable, remove_duplicates


@dataclass(frozen=True)
class RegionTracker:
    """Filters and settings of the tracker of a region."""

    bank: FilterBank
    management: TrackManagement
    plot_origin: PlotOrigin
    clutter: ClutterSettings


def track_region(
    tracker: RegionTracker, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
) -> tuple[RadarMemory, Tracks, Measurements]:
    """Track the plots of one cycle. Returns: memory, the confirmed tracks at time_s, and the plots of this cycle in them.

    Args: memory: consumed; plots: of this region, in any order; time_s: end of the cycle; region: its number.
    """
    management, known = tracker.management, tracker.plot_origin == "known"
    memory = memory.fitting(len(tracker.bank.models), len(sensors.radars))
    if tracker.clutter.learnt and not len(memory.clutter.side):
        memory = replace(memory, clutter=empty_map(tracker.clutter, sensors.radars))
    good = is_usable(management, plots, time_s)
    if not good.all():
        memory, plots = replace(memory, dropped=memory.dropped + int((~good).sum())), plots.take(good)
    ours = np.flatnonzero(sensors.radars.region == region)
    slice_s = min(management.slice_s, 0.5 * float(sensors.radars.period_s[ours].min(initial=np.inf)))
    batches = cut(plots, slice_s, by_radar=not known)
    specified = to_plane(sensors.radars.site_deg[ours], sensors.region_origin_deg[region])
    taken = np.full(len(plots), -1)
    for batch in batches:
        _note_newest(memory, batch.columns, batches.plots.site_m[batch.first :])
        memory, slot = _track_batch(tracker, memory, batch.columns, sensors.radars.period_s)
        got = np.flatnonzero(slot >= 0)
        taken[batch.first + got] = memory.table.track_id[slot[got]]
        if batch.ends_slice:
            newest = float(batch.columns.time[-1])
            memory = _confirm_and_delete(management, memory, _radars(memory, ours, specified, sensors), newest)
    radars = _radars(memory, ours, specified, sensors)
    memory = _confirm_and_delete(management, memory, radars, time_s)
    if not known:
        table, pairs = remove_duplicates(management, memory.table, memory.duplicates, sensors.radars.period_s, time_s)
        memory = replace(memory, table=table, duplicates=pairs)
    tracks = report(tracker.bank, memory.table, radars, time_s, sensors, region)
    return memory, tracks, report_measurements(tracks, taken, batches.plots, sensors, region)


def _track_batch(tracker: RegionTracker, memory: RadarMemory, batch: PlotColumns, period_s: Floats) -> tuple[RadarMemory, Ints]:
    """Track one batch of plots. Returns: memory, the slot of the track that took each plot, -1 for none."""
    if tracker.plot_origin == "known":
        slot, begins = associate_by_origin(memory.table, batch)
        memory = begin_tracks(tracker.bank, memory, np.flatnonzero(begins), batch)
        if begins.any():  # their later plots of this batch
            slot = np.where(begins, -1, associate_by_origin(memory.table, batch)[0])
        begins[:] = False
    else:
        turn_s = float(period_s[batch.sensor[0]])
        density = _false_plots_per_m2(tracker, memory, batch)
        slot, begins = associate(tracker.management, memory.table, batch, turn_s, density)
        memory = _learn_clutter(tracker, memory, batch, slot, turn_s)
    plots = np.flatnonzero(slot >= 0)
    table = memory.table
    tracker.bank.update(table.filters, table.estimates, slot[plots], plots, batch)
    kernels.tracks.track_life.record(table.life, slot[plots], plots, batch)
    _note_moved(tracker.clutter, table, slot[plots])
    if tracker.plot_origin == "known":
        table.status[slot[plots]] = Status.CONFIRMED
    if begins.any():
        memory = begin_tracks(tracker.bank, memory, np.flatnonzero(begins), batch)
    return memory, slot


def _false_plots_per_m2(tracker: RegionTracker, memory: RadarMemory, batch: PlotColumns) -> Floats:
    """The density of false plots in one look at each plot of a batch of one radar. (M,)"""
    constant = tracker.management.false_plots_per_m2
    if not tracker.clutter.learnt:
        return np.full(len(batch.time), constant)
    return false_plots_per_m2(tracker.clutter, memory.clutter, int(batch.sensor[0]), batch.position, constant)


def _learn_clutter(tracker: RegionTracker, memory: RadarMemory, batch: PlotColumns, slot: Ints, period_s: float) -> RadarMemory:
    """Count the plots of a batch of one radar that went to no confirmed track that has moved. Args: slot: (M,) -1 for none."""
    if not tracker.clutter.learnt:
        return memory
    table = memory.table
    moving = (slot >= 0) & table.moved[slot] & (table.status[slot] == Status.CONFIRMED) if len(table.moved) else slot >= 0
    given = int(batch.sensor[0]), batch.time, batch.position, np.where(moving, 0.0, 1.0), period_s
    return replace(memory, clutter=learn(tracker.clutter, memory.clutter, *given))


def _note_moved(settings: ClutterSettings, table: Table, slots: Ints) -> None:
    """Mark the tracks in these slots that have moved from their first plot."""
    slots = slots[~table.moved[slots]]
    variance = table.began_m2[slots] + table.combined_covariance[slots, 0, 0] + table.combined_covariance[slots, 1, 1]
    table.moved[slots] = has_moved(settings, table.began_m[slots], table.combined_mean[slots, :2], variance)


def _note_newest(memory: RadarMemory, batch: PlotColumns, site_m: Floats) -> None:
    """Write the newest site and time of each radar of a batch into the memory. Args: site_m: (M,) or more, of each plot."""
    newest = batch.time >= memory.newest_plot_s[batch.sensor]  # a late plot does not move the site back
    memory.site_m[batch.sensor[newest]] = site_m[: len(batch.sensor)][newest]
    np.maximum.at(memory.newest_plot_s, batch.sensor, batch.time)


def _radars(memory: RadarMemory, ours: Ints, specified_m: Floats, sensors: Sensors) -> RadarColumns:
    """The radars of the region, at the site of their newest plot, or before any plot at their specified site."""
    site = memory.site_m[ours]
    site = np.where(np.isfinite(site), site, specified_m)
    return RadarColumns(site, sensors.radars.range_m[ours], sensors.radars.period_s[ours], memory.newest_plot_s[ours])


def _confirm_and_delete(management: TrackManagement, memory: RadarMemory, radars: RadarColumns, time_s: float) -> RadarMemory:
    table = memory.table
    given = table.life, table.estimates, table.live, radars, management.rules, time_s
    lost = kernels.tracks.track_life.confirm_and_find_lost(*given)
    return replace(memory, table=table.without(lost)) if lost.any() else memory
