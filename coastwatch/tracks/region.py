"""One cycle of the tracks of a region: its plots update its tracks; the confirmed ones are yielded in latitude and longitude."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Measurements, Messages, Plots, Sensors, StandingEchoes, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tracks.columns import PlotColumns, RadarColumns
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.joint.existence import ExistenceManagement
from coastwatch.tracks.plot_batches import cut
from coastwatch.tracks.report import report, report_measurements
from coastwatch.tracks.standing import standing_echoes
from coastwatch.tracks.table import RadarMemory, Table
from coastwatch.tracks.track_management import TrackManagement, is_usable


class RegionInput(NamedTuple):
    """What a radar tracker is given in a cycle. It uses a field or leaves it."""

    plots: Plots  # of this region, that arrived in this cycle, in any order
    messages: Messages  # AIS, of this cycle, in the plane of the region
    jumped: Bools  # (R,) radars whose corrections have jumped: their earlier plots lie elsewhere now
    time_s: float  # end of the cycle
    sensors: Sensors  # with the radars of the region
    region: int  # its number

    @classmethod
    def of_plots(cls, plots: Plots, time_s: float, sensors: Sensors, region: int = 0) -> RegionInput:
        """Plots alone."""
        return cls(plots, Messages.empty(), np.zeros(len(sensors.radars), np.bool_), time_s, sensors, region)


class RegionOutput(NamedTuple):
    """What a radar tracker yields in a cycle."""

    tracks: Tracks  # the confirmed ones, predicted to the end of the cycle, sorted by track_id, which is never reused
    measurements: Measurements  # the plots of this cycle in them
    standing_echoes: StandingEchoes  # none where no clutter map is learnt
    dropped: int  # plots that are not finite, or from the future


class RegionTracker(Protocol):
    """The interface of what gives plots to tracks, and begins and ends tracks."""

    @property
    def bank(self) -> FilterBank:
        """The filters of the tracks."""
        ...

    @property
    def management(self) -> TrackManagement | ExistenceManagement:
        """Settings of slices, gates and the life of tracks."""
        ...

    @property
    def clutter(self) -> ClutterSettings:
        """How false plots are counted by place."""
        ...

    def track_batch(self, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Update tracks by the plots of a batch, and begin tracks. Returns: memory, the slot of the track of each plot, -1 for none."""
        ...

    def end_slice(self, memory: RadarMemory, radars: RadarColumns, ours: Ints, time_s: float) -> RadarMemory:
        """Confirm and delete tracks. Args: radars: of the region; ours: (R,) their numbers; time_s: of the newest plot, or now."""
        ...

    def end_cycle(self, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Delete all but one of several tracks of a vessel."""
        ...

    def shown(self, table: Table, time_s: float) -> Ints:
        """Slots of the tracks to report."""
        ...

    def existence(self, table: Table, slots: Ints, time_s: float) -> Floats:
        """The probability that there is a vessel behind each of these tracks, NaN where it is not estimated. (N,)"""
        ...


TakeMessages = Callable[[RadarMemory, float], RadarMemory]
"""The memory after the AIS messages up to a time, in s, that were not taken before."""


def update_region(
    tracker: RegionTracker,
    memory: RadarMemory,
    given: RegionInput,
    by_radar: bool = True,
    take_messages: TakeMessages | None = None,
) -> tuple[RadarMemory, RegionOutput]:
    """Track the plots of one cycle.

    Args: memory: consumed; by_radar: a batch has plots of one radar; take_messages: called before each batch with the time of its
    first plot, and at the end with that of the cycle.
    """
    plots, _, jumped, time_s, sensors, region = given
    management = tracker.management
    memory = memory.without_radars(jumped).fitting(len(tracker.bank.models), len(sensors.radars))
    memory = memory.with_clutter_map(tracker.clutter, sensors.radars)
    good = is_usable(plots, time_s, management.ahead_s)
    if not good.all():
        plots = plots.take(good)
    if management.echo_sigma_m > 0.0:
        plots = replace(plots, covariance=plots.covariance + management.echo_sigma_m**2 * np.eye(2))
    ours = np.flatnonzero(sensors.radars.region == region)
    slice_s = min(management.slice_s, 0.5 * float(sensors.radars.period_s[ours].min(initial=np.inf)))
    batches = cut(plots, slice_s, by_radar)
    specified = to_plane(sensors.radars.site_deg[ours], sensors.region_origin_deg[region])
    taken = np.full(len(plots), -1)
    for batch in batches:
        _note_newest(memory, batch.columns, batches.plots.site_m[batch.first :])
        if take_messages:
            memory = take_messages(memory, float(batch.columns.time[0]))
        memory, slot = tracker.track_batch(memory, batch.columns)
        got = np.flatnonzero(slot >= 0)
        taken[batch.first + got] = memory.table.track_id[slot[got]]
        if batch.ends_slice:
            newest = float(batch.columns.time[-1])
            memory = tracker.end_slice(memory, _radars(memory, ours, specified, sensors), ours, newest)
    if take_messages:
        memory = take_messages(memory, time_s)
    radars = _radars(memory, ours, specified, sensors)
    memory = tracker.end_cycle(tracker.end_slice(memory, radars, ours, time_s), time_s)
    rows = tracker.shown(memory.table, time_s)
    tracks = report(tracker.bank, memory.table, rows, radars, time_s, sensors, region)
    tracks = replace(tracks, existence=tracker.existence(memory.table, rows, time_s))
    standing = standing_echoes(tracker.clutter, memory.clutter, sensors.radars, sensors.region_origin_deg[region])
    taken_plots = report_measurements(tracks, taken, batches.plots, sensors, region)
    return memory, RegionOutput(tracks, taken_plots, standing, int((~good).sum()))


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
