"""One cycle of a region: its plots update its tracks; the confirmed tracks are yielded in latitude and longitude."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Floats, Ints, Measurements, Plots, Sensors, Tracks
from coastwatch.geodesy import from_plane, turn
from coastwatch.kernels.geometry.polar import polar_to_plane
from coastwatch.kernels.tables.lookup import find
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.plot_association import assign_plots, candidates, may_initiate, update_tracks
from coastwatch.tracks.table import NEWEST, Coverage, RadarMemory, Status, Table, UsedPlots, coverage_of, initialise
from coastwatch.tracks.track_management import (
    PlotOrigin,
    TrackManagement,
    confirm_and_delete,
    is_usable,
    remove_duplicates,
)

ID_STRIDE = 2**40  # track ids of one region


@dataclass(frozen=True)
class RegionTracker:
    """Filters and settings of the tracker of a region."""

    bank: FilterBank
    management: TrackManagement
    plot_origin: PlotOrigin


def track_region(
    tracker: RegionTracker, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
) -> tuple[RadarMemory, Tracks, Measurements]:
    """Track the plots of one cycle. Returns: memory, the confirmed tracks at time_s, and the plots of this cycle in them.

    Args: plots: of this region, in any order; time_s: end of the cycle; region: its number.
    """
    bank, management = tracker.bank, tracker.management
    memory = memory.for_radars(len(sensors.radars))
    good = is_usable(management, plots, time_s)
    memory = replace(memory, dropped=memory.dropped + int((~good).sum()))
    plots = plots.take(good)
    plots = plots.take(np.argsort(plots.time_s, kind="stable"))
    turn_s = sensors.radars.period_s[sensors.radars.region == region]
    slice_s = min(management.slice_s, 0.5 * float(turn_s.min(initial=np.inf)))
    number = np.floor(plots.time_s / slice_s).astype(np.int64)
    cuts = np.flatnonzero(np.diff(number)) + 1
    taken = []
    for rows in np.split(np.arange(len(plots)), cuts) if len(plots) else []:
        part = plots.take(rows)
        memory = memory.with_plots(part)
        if tracker.plot_origin == "known":
            memory, used = _by_known_origin(bank, memory, part)
        else:
            memory, used = _by_estimated_origin(tracker, memory, part, sensors.radars.period_s)
        taken.append(used)
        memory = _confirm_and_delete(management, memory, float(part.time_s[-1]), sensors, region)
    memory = _confirm_and_delete(management, memory, time_s, sensors, region)
    tracks = report(bank, memory, time_s, sensors, region)
    return memory, tracks, measurements_of(tracks, taken, sensors, region)


def _confirm_and_delete(
    management: TrackManagement, memory: RadarMemory, time_s: float, sensors: Sensors, region: int
) -> RadarMemory:
    kept = confirm_and_delete(management, memory.table, coverage_of(memory, sensors, region), memory.newest_plot_s, time_s)
    return replace(memory, table=kept)


def _by_estimated_origin(
    tracker: RegionTracker, memory: RadarMemory, plots: Plots, period_s: Floats
) -> tuple[RadarMemory, UsedPlots]:
    """Track one slice of time: assign plots to tracks, then to single plots; the rest become single plots."""
    memory = _remove_duplicates(tracker, memory, float(plots.time_s[0]), period_s)
    table = memory.table
    rows = np.flatnonzero(table.status != Status.SINGLE)
    pairs = candidates(tracker.management, tracker.bank, table, rows, plots, period_s)
    chosen = assign_plots(table, pairs, plots, len(period_s))
    free = may_initiate(pairs, chosen, plots)
    used = pairs.take(chosen)
    taken = [UsedPlots(table.track_id[used.track], plots.take(used.plot))]
    table = update_tracks(tracker.bank, table, used.track, used.plot, plots, used.after)
    memory = replace(memory, table=table)
    for radar in np.unique(plots.sensor[free]).tolist():
        memory, started = _initiate(tracker, memory, plots.take(free & (plots.sensor == radar)), period_s)
        taken.append(started)
    return memory, UsedPlots.join(taken)


def _initiate(tracker: RegionTracker, memory: RadarMemory, plots: Plots, period_s: Floats) -> tuple[RadarMemory, UsedPlots]:
    """Assign free plots of one radar to single plots of earlier slices, of any radar; the rest become single plots."""
    table = memory.table
    rows = np.flatnonzero(table.status == Status.SINGLE)
    pairs = candidates(tracker.management, tracker.bank, table, rows, plots, period_s)
    used = pairs.take(assign_plots(table, pairs, plots, len(period_s)))
    table = update_tracks(tracker.bank, table, used.track, used.plot, plots, used.after)
    left = np.ones(len(plots), np.bool_)
    left[used.plot] = False
    memory = _append(tracker.bank, replace(memory, table=table), plots.take(left))
    return memory, UsedPlots(table.track_id[used.track], plots.take(used.plot))


def _append(bank: FilterBank, memory: RadarMemory, plots: Plots) -> RadarMemory:
    """The memory with a track for each of these plots."""
    new = initialise(bank, plots, memory.next_id, len(memory.newest_plot_s))
    return replace(memory, table=Table.join([memory.table, new]), next_id=memory.next_id + len(plots))


def _remove_duplicates(tracker: RegionTracker, memory: RadarMemory, time_s: float, period_s: Floats) -> RadarMemory:
    table = memory.table
    mean, covariance = tracker.bank.predict(table.filters, np.maximum(time_s - table.updated_s, 0.0))
    table, duplicates = remove_duplicates(tracker.management, table, memory.duplicates, mean, covariance, period_s, time_s)
    return replace(memory, table=table, duplicates=duplicates)


def _by_known_origin(bank: FilterBank, memory: RadarMemory, plots: Plots) -> tuple[RadarMemory, UsedPlots]:
    """Track one slice of time by the known vessel behind each plot: clutter is dropped, two plots are a confirmed track."""
    plots = plots.take(plots.origin >= 0)
    vessels, first = np.unique(plots.origin, return_index=True)
    new = np.sort(first[~np.isin(vessels, memory.table.origins[:, 0])])
    memory = _append(bank, memory, plots.take(new))
    rest = np.delete(np.arange(len(plots)), new)
    table = memory.table
    order = np.argsort(table.origins[:, 0], kind="stable")
    row = order[np.searchsorted(table.origins[order, 0], plots.origin[rest])]
    table = update_tracks(bank, table, row.astype(np.int64), rest, plots, None)
    status = np.where(table.hits >= 2, np.int64(Status.CONFIRMED), table.status)
    taken = UsedPlots(table.track_id[row], plots.take(rest))
    return replace(memory, table=replace(table, status=status)), taken


def report(bank: FilterBank, memory: RadarMemory, time_s: float, sensors: Sensors, region: int) -> Tracks:
    """The confirmed tracks, predicted to time_s, in the tangent plane at each track."""
    table = memory.table.take(memory.table.status == Status.CONFIRMED)
    mean, covariance = bank.predict(table.filters, np.maximum(time_s - table.updated_s, 0.0))
    origin = sensors.region_origin_deg[region]
    position = from_plane(mean[:, :2], origin)
    back = turn(position, origin).swapaxes(-1, -2)
    both = np.zeros((len(table), 4, 4))
    both[:, :2, :2] = both[:, 2:, 2:] = back
    one = _plot_covariance(coverage_of(memory, sensors, region), mean[:, :2], sensors)
    return Tracks(
        track_id=region * ID_STRIDE + table.track_id,
        source=np.full(len(table), region, np.int64),
        time_s=np.full(len(table), float(time_s)),
        position_deg=position,
        velocity_m_s=(back @ mean[:, 2:4, None])[..., 0],
        covariance=both @ covariance[:, :4, :4] @ both.swapaxes(-1, -2),
        report_covariance=back @ one @ back.swapaxes(-1, -2),
        updated_s=table.updated_s,
        started_s=table.started_s,
        mmsi=np.full(len(table), -1, np.int64),
        origin=_origin(table),
    )


def measurements_of(tracks: Tracks, taken: list[UsedPlots], sensors: Sensors, region: int) -> Measurements:
    """The plots of this cycle in these tracks, sorted by track, then time.

    Args: tracks: of the region, sorted by track_id; taken: the plots that were used in each slice.
    """
    if not taken:
        return Measurements.empty()
    used = UsedPlots.join(taken)
    track_id = region * ID_STRIDE + used.track_id
    rows = np.flatnonzero(find(tracks.track_id, track_id) >= 0)
    rows = rows[np.lexsort((used.plots.sensor[rows], used.plots.time_s[rows], track_id[rows]))]
    plots, n, origin = used.plots.take(rows), len(rows), sensors.region_origin_deg[region]
    position = from_plane(plots.position_m, origin)
    back = turn(position, origin).swapaxes(-1, -2)
    covariance = np.full((n, 4, 4), np.nan)
    covariance[:, :2, :2] = back @ plots.covariance @ back.swapaxes(-1, -2)
    return Measurements(
        track_id=track_id[rows],
        sensor=plots.sensor,
        time_s=plots.time_s,
        position_deg=position,
        velocity_m_s=np.full((n, 2), np.nan),
        covariance=covariance,
        site_deg=from_plane(plots.site_m, origin),
    )


def _plot_covariance(coverage: Coverage, position_m: Floats, sensors: Sensors) -> Floats:
    """Covariance of one plot at each position, by the most accurate radar that covers it, else by the most accurate. (N, 2, 2)"""
    gap = position_m[:, None] - coverage.site_m
    distance, azimuth = np.hypot(gap[..., 0], gap[..., 1]), np.arctan2(gap[..., 0], gap[..., 1])
    range_sigma, azimuth_sigma = (
        np.broadcast_to(getattr(sensors.radars, name)[coverage.radars], distance.shape)
        for name in ("range_sigma_m", "azimuth_sigma_rad")
    )
    flat = (a.ravel() for a in (distance, azimuth, range_sigma, azimuth_sigma))
    each = polar_to_plane(*flat)[1].reshape(*distance.shape, 2, 2)
    worth = np.trace(each, axis1=2, axis2=3)
    worth = np.where(coverage.sees(position_m), worth, worth + worth.max(initial=0.0))
    best: Floats = np.take_along_axis(each, worth.argmin(axis=1)[:, None, None, None], axis=1)[:, 0]
    return best


def _origin(table: Table) -> Ints:
    """The vessel most frequent among the newest plots; of equals the one with the newest plot. (N,)"""
    valid = np.arange(NEWEST) < table.hits[:, None]
    same = (table.origins[:, :, None] == table.origins[:, None, :]) & valid[:, None, :]
    votes = np.where(valid, same.sum(axis=2), 0)
    winner: Ints = np.take_along_axis(table.origins, votes.argmax(axis=1)[:, None], axis=1)[:, 0]
    return winner
