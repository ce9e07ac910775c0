"""Confirmed radar tracks as the other stages see them: geodetic, at one time, with the covariance of one plot there."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints, Measurements, Sensors, Tracks
from coastwatch.geodesy import from_plane, turn
from coastwatch.kernels.geometry.polar import polar_to_plane
from coastwatch.kernels.tables.lookup import find
from coastwatch.tracks.table import NEWEST, Bank, Coverage, RadarMemory, Stage, Table, Taken, coverage_of

ID_STRIDE = 2**40  # track ids of one region


def report(bank: Bank, memory: RadarMemory, time_s: float, sensors: Sensors, region: int) -> Tracks:
    """The confirmed tracks, predicted to time_s, in the tangent plane at each track."""
    table = memory.table.take(memory.table.stage == Stage.CONFIRMED)
    mean, spread = bank.foresee(table.filters, np.maximum(time_s - table.updated_s, 0.0))
    origin = sensors.region_origin_deg[region]
    position = from_plane(mean[:, :2], origin)
    back = turn(position, origin).swapaxes(-1, -2)
    both = np.zeros((len(table), 4, 4))
    both[:, :2, :2] = both[:, 2:, 2:] = back
    one = _one_plot(coverage_of(memory, sensors, region), mean[:, :2], sensors)
    return Tracks(
        track_id=region * ID_STRIDE + table.track_id,
        source=np.full(len(table), region, np.int64),
        time_s=np.full(len(table), float(time_s)),
        position_deg=position,
        velocity_m_s=(back @ mean[:, 2:4, None])[..., 0],
        covariance=both @ spread[:, :4, :4] @ both.swapaxes(-1, -2),
        report_covariance=back @ one @ back.swapaxes(-1, -2),
        updated_s=table.updated_s,
        started_s=table.started_s,
        mmsi=np.full(len(table), -1, np.int64),
        origin=_origin(table),
    )


def taken_plots(tracks: Tracks, taken: list[Taken], sensors: Sensors, region: int) -> Measurements:
    """The plots of this cycle that are in these tracks, sorted by track, then time.

    Args: tracks: of the region, sorted by track_id; taken: the plots of each slice and the tracks of the region that took them.
    """
    if not taken:
        return Measurements.empty()
    used = Taken.join(taken)
    track_id = region * ID_STRIDE + used.track_id
    shown = np.flatnonzero(find(tracks.track_id, track_id) >= 0)
    rows = shown[np.lexsort((used.plots.sensor[shown], used.plots.time_s[shown], track_id[shown]))]
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


def _one_plot(coverage: Coverage, position_m: Floats, sensors: Sensors) -> Floats:
    """Covariance of one plot of the radar that sees each place best; outside of all, of the one that would. (N, 2, 2)"""
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
