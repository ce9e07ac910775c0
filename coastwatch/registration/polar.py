"""Differences between plots of a radar and AIS vessels, in polar coordinates of the radar, at the time of the plot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, Plots, RadarCorrections, Sensors, Tracks, column
from coastwatch.geodesy import from_plane, to_plane, turn, wrap_rad

DEGREE_M = 110_500.0  # of latitude, at least
OLDEST_S = 10.0  # older plots are left out: the vessel is moved back to the plot along a straight line


@dataclass(frozen=True, eq=False)
class PolarMeasurements(Batch):
    """Plots as the radar measured them, without any correction of registration, and the site of the radar."""

    radar: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")  # as stamped
    range_m: Floats = column(np.float64, "M")
    azimuth_rad: Floats = column(np.float64, "M")
    site_deg: Floats = column(np.float64, "M", 2)


@dataclass(frozen=True, eq=False)
class Pairs(Batch):
    """Pairs of a plot and a vessel that it may come from. Differences are plot less vessel, at the stamp less the known lag."""

    plot: Ints = column(np.int64, "A")
    vessel: Ints = column(np.int64, "A")  # row of the AIS tracks
    radar: Ints = column(np.int64, "A")
    range_m: Floats = column(np.float64, "A")  # differences
    azimuth_rad: Floats = column(np.float64, "A")
    range_rate_m_s: Floats = column(np.float64, "A")  # of the vessel, seen from the radar
    azimuth_rate_rad_s: Floats = column(np.float64, "A")
    distance_m: Floats = column(np.float64, "A")  # of the vessel
    range_variance_m2: Floats = column(np.float64, "A")  # of the vessel's position, along the beam
    across_variance_m2: Floats = column(np.float64, "A")


def polar_measurements(plots: Plots, given: RadarCorrections, time_s: float, sensors: Sensors) -> PolarMeasurements:
    """The plots that are not too old, without the corrections, in an order that does not depend on the order of arrival."""
    order = np.lexsort((plots.position_m[:, 0], plots.position_m[:, 1], plots.time_s, plots.sensor))
    plots = plots.take(order[plots.time_s[order] >= time_s - OLDEST_S])
    origin, radar = sensors.region_origin_deg[plots.region], plots.sensor
    site = from_plane(plots.site_m, origin)
    at = to_plane(from_plane(plots.position_m, origin), site)
    bias_factor = np.exp(-0.5 * sensors.radars.azimuth_sigma_rad[radar] ** 2)  # the unbiased conversion has divided by it
    return PolarMeasurements(
        radar=radar,
        time_s=plots.time_s + given.time_lag_s[radar],
        range_m=np.hypot(at[:, 0], at[:, 1]) * bias_factor + given.range_bias_m[radar],
        azimuth_rad=np.arctan2(at[:, 0], at[:, 1]) + given.azimuth_bias_rad[radar],
        site_deg=site,
    )


def pair_with_vessels(
    measured: PolarMeasurements,
    vessels: Tracks,
    given: RadarCorrections,
    range_search_m: float,
    azimuth_search_rad: float,
    sensors: Sensors,
) -> Pairs:
    """All pairs of a plot and a vessel whose ranges and azimuths differ by no more than the search allows.

    Rates and positions are those at the stamp less the lag in `given`. Sorted by radar, vessel, plot.
    """
    parts = [
        _candidates(measured, np.flatnonzero(measured.radar == r), vessels, range_search_m, azimuth_search_rad)
        for r in np.unique(measured.radar).tolist()
    ]
    plot = np.concatenate([p for p, _ in parts]) if parts else np.zeros(0, np.int64)
    vessel = np.concatenate([v for _, v in parts]) if parts else np.zeros(0, np.int64)
    found = _differences(measured, plot, vessels, vessel, given)
    close = (np.abs(found.range_m) <= range_search_m) & (np.abs(found.azimuth_rad) <= azimuth_search_rad)
    found = found.take(close & (found.distance_m <= sensors.radars.range_m[found.radar] + range_search_m))
    return found.take(np.lexsort((found.plot, found.vessel, found.radar)))


def vessels_in_cover(measured: PolarMeasurements, vessels: Tracks, sensors: Sensors) -> Ints:
    """How many of these vessels each radar that has sent a plot could see. (R,)"""
    count = np.zeros(len(sensors.radars), np.int64)
    for r in np.unique(measured.radar).tolist():
        site = measured.site_deg[np.flatnonzero(measured.radar == r)[0]]
        reach = float(sensors.radars.range_m[r])
        at = to_plane(vessels.position_deg[_near_in_latitude(vessels, site, reach)], site)
        count[r] = (np.hypot(at[:, 0], at[:, 1]) <= reach).sum()
    return count


def _near_in_latitude(vessels: Tracks, site_deg: Floats, reach_m: float) -> Ints:
    """Rows of the vessels whose latitude is within reach of a site; on a long coast few are."""
    gap_m = np.abs(vessels.position_deg[:, 0] - site_deg[0]) * DEGREE_M
    return np.flatnonzero(gap_m <= reach_m)


def _candidates(
    measured: PolarMeasurements, plot: Ints, vessels: Tracks, range_search_m: float, azimuth_search_rad: float
) -> tuple[Ints, Ints]:
    """Pairs of one radar that may be within the search, by the positions of the vessels now and a margin for their motion."""
    site = measured.site_deg[plot[0]]
    speed = float(np.hypot(vessels.velocity_m_s[:, 0], vessels.velocity_m_s[:, 1]).max(initial=0.0))
    site_shift = to_plane(measured.site_deg[plot], site)
    slack = speed * OLDEST_S + float(np.hypot(site_shift[:, 0], site_shift[:, 1]).max(initial=0.0))
    reach = range_search_m + slack
    rows = _near_in_latitude(vessels, site, float(measured.range_m[plot].max()) + reach)
    at = to_plane(vessels.position_deg[rows], site)
    distance = np.hypot(at[:, 0], at[:, 1])
    order = np.argsort(distance, kind="stable")
    first = np.searchsorted(distance[order], measured.range_m[plot] - reach)
    count = np.searchsorted(distance[order], measured.range_m[plot] + reach, side="right") - first
    which = np.repeat(np.arange(len(plot)), count)
    place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count - first, count)
    plot, vessel = plot[which], order[place]
    azimuth_difference = np.abs(wrap_rad(measured.azimuth_rad[plot] - np.arctan2(at[vessel, 0], at[vessel, 1])))
    near = azimuth_difference <= azimuth_search_rad + 0.5 * np.pi * slack / np.maximum(distance[vessel], 1.0)
    return plot[near], rows[vessel[near]]


def _differences(measured: PolarMeasurements, plot: Ints, vessels: Tracks, vessel: Ints, given: RadarCorrections) -> Pairs:
    """The differences of these plots and vessels, with rates and variances. Args: plot, vessel: (A,) rows."""
    site, radar = measured.site_deg[plot], measured.radar[plot]
    rotation = turn(vessels.position_deg[vessel], site)
    velocity = (rotation @ vessels.velocity_m_s[vessel][:, :, None])[..., 0]
    ahead = measured.time_s[plot] - given.time_lag_s[radar] - vessels.time_s[vessel]
    at = to_plane(vessels.position_deg[vessel], site) + velocity * ahead[:, None]
    distance = np.maximum(np.hypot(at[:, 0], at[:, 1]), 1.0)
    along = at / distance[:, None]
    across = np.column_stack([along[:, 1], -along[:, 0]])  # clockwise
    known = vessels.known_covariance(1.0)[vessel]
    # The vessel is moved by its velocity, so the error of the velocity grows with that time.
    covariance = rotation @ (known[:, :2, :2] + known[:, 2:, 2:] * (ahead**2)[:, None, None]) @ rotation.swapaxes(-1, -2)
    return Pairs(
        plot=plot,
        vessel=vessel,
        radar=radar,
        range_m=measured.range_m[plot] - distance,
        azimuth_rad=np.asarray(wrap_rad(measured.azimuth_rad[plot] - np.arctan2(at[:, 0], at[:, 1]))),
        range_rate_m_s=_dot(velocity, along),
        azimuth_rate_rad_s=_dot(velocity, across) / distance,
        distance_m=distance,
        range_variance_m2=_dot(along, (covariance @ along[:, :, None])[..., 0]),
        across_variance_m2=_dot(across, (covariance @ across[:, :, None])[..., 0]),
    )


def _dot(a: Floats, b: Floats) -> Floats:
    out: Floats = (a * b).sum(axis=1)
    return out


def is_only_one(key: Array, rows: Bools) -> Bools:
    """Which of the asked rows have a key that no other of them has. Args: key: (A,); rows: (A,) those asked. Returns: (A,)."""
    _, of, count = np.unique(key[rows], return_inverse=True, return_counts=True)
    out = np.zeros(len(key), np.bool_)
    out[rows] = count[of] == 1
    return out
