"""What leaves a region: its tracks, and the plots in them, in latitude and longitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import ID_STRIDE, DecidedPath, Floats, Ints, Measurements, Plots, Sensors, Tracks
from coastwatch.batches.struct import Batch, column, optional_column
from coastwatch.geodesy import to_plane
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import RadarColumns
from coastwatch.tracks.radar.extent import Echoes, echoes_of
from coastwatch.tracks.radar.leaves import Decided


@dataclass(frozen=True, eq=False)
class Reported(Batch):
    """What a region says of its tracks beside their estimates."""

    number: Ints = column(np.int64, "N")  # within the region, increasing
    updated_s: Floats = column(np.float64, "N")  # newest plot or message
    started_s: Floats = column(np.float64, "N")
    origin: Ints = column(np.int64, "N")
    held_mmsi: Ints = optional_column("N", dtype=np.int64)  # -1: none
    existence: Floats = optional_column("N")  # NaN: not estimated
    extent: Floats = optional_column("N", 3)  # mean second moments of the echoes, m2 in the plane; NaN: not known
    beam_m: Floats = optional_column("N")  # width of the beam at the track; NaN: not known
    alternative_m: Floats = optional_column("N")  # NaN: sure


def radars_of(sensors: Sensors, region: int, site_m: Floats | None = None, newest_plot_s: Floats | None = None) -> RadarColumns:
    """The radars of a region as the kernels take them, each at its newest site, or before any plot at its specified site.

    Args: site_m: (R, 2) of each radar at its newest plot, NaN: it has sent none; newest_plot_s: (R,) -inf: it has sent none. None: no
    radar has sent any.
    """
    radars = sensors.radars
    ours = np.flatnonzero(radars.region == region)
    site = np.full((len(ours), 2), np.nan) if site_m is None else site_m[ours]
    newest_s = np.full(len(ours), -np.inf) if newest_plot_s is None else newest_plot_s[ours]
    unknown = ~np.isfinite(site)
    if unknown.any():
        site = np.where(unknown, to_plane(radars.site_deg[ours], sensors.region_origin_deg[region]), site)
    return RadarColumns(site, radars.range_m[ours], radars.period_s[ours], newest_s)


def report(now: Estimates, reported: Reported, radars: RadarColumns, time_s: float, sensors: Sensors, region: int) -> Tracks:
    """The tracks of a region in the tangent plane at each track. Args: now: (N) predicted to time_s; radars: those of the region."""
    latitude, longitude = sensors.region_origin_deg[region].tolist()
    position, velocity, turned = kernels.tracks.report.geodetic_tracks(now.mean, now.covariance, latitude, longitude)
    ours = np.flatnonzero(sensors.radars.region == region)
    range_sigma_m, azimuth_sigma_rad = sensors.radars.range_sigma_m[ours], sensors.radars.azimuth_sigma_rad[ours]
    one = kernels.tracks.report.plot_covariances(now.mean, radars, range_sigma_m, azimuth_sigma_rad)
    _, one = kernels.tracks.report.geodetic_points(now.mean, one, latitude, longitude)
    count = len(reported.number)
    echoes = _echoes(now, reported, velocity, latitude, longitude)
    return Tracks(
        track_id=region * ID_STRIDE + reported.number,
        source=np.full(count, region, np.int64),
        time_s=np.full(count, float(time_s)),
        position_deg=position,
        velocity_m_s=velocity,
        covariance=turned,
        report_covariance=one,
        updated_s=reported.updated_s,
        started_s=reported.started_s,
        mmsi=np.full(count, -1, np.int64),
        origin=reported.origin,
        held_mmsi=reported.held_mmsi,
        existence=reported.existence,
        echo_length_m=echoes.length_m,
        echo_width_m=echoes.width_m,
        echo_axis_deg=echoes.axis_deg,
        alternative_m=reported.alternative_m,
    )


def _echoes(now: Estimates, reported: Reported, velocity_m_s: Floats, latitude: float, longitude: float) -> Echoes:
    """Size and axis of the ships by their echoes. (N,) Args: velocity_m_s: (N, 2); latitude, longitude: of the plane's origin."""
    known = np.flatnonzero(np.isfinite(reported.extent[:, 0]))
    length, width, axis = np.full((3, len(reported.number)), np.nan)
    if len(known):
        moments = reported.extent[known][:, [[0, 1], [1, 2]]]
        _, turned = kernels.tracks.report.geodetic_points(now.mean[known, :2].copy(), moments, latitude, longitude)
        extent = turned.reshape(-1, 4)[:, [0, 1, 3]]
        found = echoes_of(extent, reported.beam_m[known], velocity_m_s[known])
        length[known], width[known], axis[known] = found
    return Echoes(length, width, axis)


def report_decided(decided: Decided, sensors: Sensors, region: int) -> DecidedPath:
    """The states that became final in this cycle, by track, then time, in the tangent plane at each."""
    decided = decided.take(np.lexsort((decided.time_s, decided.number)))
    latitude, longitude = sensors.region_origin_deg[region].tolist()
    position, velocity, turned = kernels.tracks.report.geodetic_tracks(decided.mean, decided.covariance, latitude, longitude)
    return DecidedPath(region * ID_STRIDE + decided.number, decided.time_s, position, velocity, turned, decided.radar)


def report_measurements(tracks: Tracks, taken: Ints, plots: Plots, sensors: Sensors, region: int) -> Measurements:
    """The plots of this cycle in these tracks, sorted by track, then time.

    Args: tracks: of the region, sorted by track_id; taken: (M,) number of the track that took each plot, -1 for none; plots: (M,).
    """
    at = kernels.tables.match_ids.index_of(tracks.track_id, region * ID_STRIDE + taken)
    rows = np.flatnonzero((at >= 0) & (taken >= 0))
    start, by_track = kernels.tables.counting_sort.counting_sort(at[rows], len(tracks))
    rows = rows[kernels.tables.counting_sort.preferred(start, by_track, plots.time_s[rows])]
    latitude, longitude = sensors.region_origin_deg[region].tolist()
    position, spread = kernels.tracks.report.geodetic_points(
        plots.position_m[rows], plots.covariance[rows], latitude, longitude
    )
    site, _ = kernels.tracks.report.geodetic_points(plots.site_m[rows], plots.covariance[rows], latitude, longitude)
    covariance = np.full((len(rows), 4, 4), np.nan)
    covariance[:, :2, :2] = spread
    return Measurements(
        track_id=tracks.track_id[at[rows]],
        sensor=plots.sensor[rows],
        time_s=plots.time_s[rows],
        position_deg=position,
        velocity_m_s=np.full((len(rows), 2), np.nan),
        covariance=covariance,
        site_deg=site,
    )
