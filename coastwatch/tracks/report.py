"""What leaves a region: its confirmed tracks, and the plots in them, in latitude and longitude."""

from __future__ import annotations

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Ints, Measurements, Plots, Sensors, Tracks
from coastwatch.kernels.tracks.columns import RadarColumns
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.table import Table

ID_STRIDE = 2**40  # track ids of one region
HELD = 0.98  # an id of this probability is reported as that of the vessel; the first message gives `correct_id`, 0.99


def report(
    bank: FilterBank, table: Table, rows: Ints, radars: RadarColumns, time_s: float, sensors: Sensors, region: int
) -> Tracks:
    """The tracks in these slots, predicted to time_s, in the tangent plane at each track. Args: radars: those of the region."""
    now = bank.predict(table.filters, table.estimates, rows, time_s)
    latitude, longitude = sensors.region_origin_deg[region].tolist()
    position, velocity, turned = kernels.tracks.report.geodetic_tracks(now.mean, now.covariance, latitude, longitude)
    ours = np.flatnonzero(sensors.radars.region == region)
    sigmas = sensors.radars.range_sigma_m[ours], sensors.radars.azimuth_sigma_rad[ours]
    one = kernels.tracks.report.plot_covariances(now.mean, radars, *sigmas)
    _, one = kernels.tracks.report.geodetic_points(now.mean, one, latitude, longitude)
    return Tracks(
        track_id=region * ID_STRIDE + table.track_id[rows],
        source=np.full(len(rows), region, np.int64),
        time_s=np.full(len(rows), float(time_s)),
        position_deg=position,
        velocity_m_s=velocity,
        covariance=turned,
        report_covariance=one,
        updated_s=np.maximum(table.radar_s[rows].max(axis=1, initial=-np.inf), table.message_s[rows]),
        started_s=table.started_s[rows],
        mmsi=np.full(len(rows), -1, np.int64),
        origin=kernels.tracks.report.most_frequent_origins(table.origins, table.hits, rows),
        held_mmsi=table.probable_ids(rows, HELD),
    )


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
