"""Differences between plots of a radar and AIS vessels, in polar coordinates of the radar, at the time of the plot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Batch,
    Floats,
    Ints,
    Plots,
    RadarCorrections,
    Sensors,
    Struct,
    Tracks,
    column,
)
from coastwatch.geodesy import from_plane, to_plane

OLDEST_S = (
    10.0  # older plots are left out, and those stamped so far ahead: the vessel is moved back to the plot along a straight line
)
SCALE = 1.01  # more than a plane's scale is off


@dataclass(frozen=True, eq=False)
class PolarMeasurements(Batch):
    """Plots as the radar measured them, without any correction of registration, and the site of the radar."""

    radar: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")  # as stamped
    range_m: Floats = column(np.float64, "M")
    azimuth_rad: Floats = column(np.float64, "M")
    site_m: Floats = column(np.float64, "M", 2)  # in the plane of the region


class Sweeps(NamedTuple):
    """When and where each radar looked in a cycle. NaN for a radar that sent no plot."""

    from_s: Floats  # (R,) oldest and newest plot, as stamped
    to_s: Floats
    site_deg: Floats  # (R, 2) of the antenna at the oldest plot
    shift_m: Floats  # (R,) by which it moves from there, at most


class ComparedVessels(NamedTuple):
    """The AIS vessels that radars are compared with, sorted by radar. A vessel of two radars is there twice."""

    tracks: Tracks  # (V)
    radar: Ints  # (V,) that has sent plots


@dataclass(frozen=True, eq=False)
class Search(Struct):
    """Which differences between a plot and its vessel are looked for, of each vessel: m in range, rad in azimuth."""

    centre: Floats = column(np.float64, "V", 2)
    reach: Floats = column(np.float64, "V", 2)  # to each side


@dataclass(frozen=True, eq=False)
class Pairs(Batch):
    """Pairs of a plot and a vessel that it may come from. Differences are plot less vessel, at the stamp less the known lag."""

    plot: Ints = column(np.int64, "A")
    vessel: Ints = column(np.int64, "A")  # row of the compared vessels, of which each has one radar
    radar: Ints = column(np.int64, "A")
    range_m: Floats = column(np.float64, "A")  # differences
    azimuth_rad: Floats = column(np.float64, "A")
    range_rate_m_s: Floats = column(np.float64, "A")  # of the vessel, seen from the radar
    azimuth_rate_rad_s: Floats = column(np.float64, "A")
    distance_m: Floats = column(np.float64, "A")  # of the vessel
    range_variance_m2: Floats = column(np.float64, "A")  # of the vessel's position, along the beam
    across_variance_m2: Floats = column(np.float64, "A")


def polar_measurements(plots: Plots, corrections: RadarCorrections, time_s: float) -> PolarMeasurements:
    """The plots of about now, without the corrections. A clock that is not set may be days ahead or behind."""
    recent = np.abs(plots.time_s - time_s) <= OLDEST_S
    plots = plots if recent.all() else plots.take(recent)
    radar = plots.sensor
    return PolarMeasurements(
        radar=radar,
        time_s=plots.time_s + corrections.time_lag_s[radar],
        range_m=plots.range_m * (1.0 + corrections.range_scale[radar]) + corrections.range_bias_m[radar],
        azimuth_rad=plots.azimuth_rad + corrections.azimuth_bias_rad[radar],
        site_m=plots.site_m + corrections.site_error_m[radar],
    )


def sweeps(measured: PolarMeasurements, sensors: Sensors) -> Sweeps:
    """When and where each radar looked."""
    radars = sensors.radars
    oldest, newest, shift_m = kernels.association.polar_pairs.sweeps(
        measured.radar, measured.time_s, measured.site_m, len(radars)
    )
    site_deg, silent = np.full((len(radars), 2), np.nan), oldest < 0
    site_deg[~silent] = from_plane(measured.site_m[oldest[~silent]], sensors.region_origin_deg[radars.region[~silent]])
    from_s, to_s = (np.append(measured.time_s, np.nan)[row] for row in (oldest, newest))
    return Sweeps(from_s, to_s, site_deg, shift_m)


def pair_with_vessels(
    measured: PolarMeasurements,
    swept: Sweeps,
    compared: ComparedVessels,
    corrections: RadarCorrections,
    search: Search,
    sensors: Sensors,
) -> Pairs:
    """All pairs of a plot and a vessel of its radar whose ranges and azimuths differ by what the search of the vessel allows.

    Rates and positions are those at the stamp less the lag in `corrections`. Returns: sorted by vessel.
    """
    (vessels, r), kernel = compared, kernels.association.polar_pairs
    at, lag_s = to_plane(vessels.position_deg, swept.site_deg[r]), corrections.time_lag_s
    distance, azimuth = np.hypot(at[:, 0], at[:, 1]), np.arctan2(at[:, 0], at[:, 1])
    # Candidates by the position of the vessel now: by the time of the plot it moves no farther than this.
    longest_s = np.maximum(*(np.abs(time_s[r] - lag_s[r] - vessels.time_s) for time_s in (swept.from_s, swept.to_s)))
    slack = np.hypot(vessels.velocity_m_s[:, 0], vessels.velocity_m_s[:, 1]) * longest_s + SCALE * swept.shift_m[r]
    reach = search.reach + np.column_stack([slack, 0.5 * np.pi * slack / np.maximum(distance, 1.0)])
    expected = np.column_stack([distance, azimuth]) + search.centre
    plot, vessel = kernel.near_pairs(measured.radar, measured.range_m, measured.azimuth_rad, r, expected, reach)

    radar = r[vessel]
    site_deg, moving = swept.site_deg[radar], np.flatnonzero(swept.shift_m[radar] > 0.0)
    origin_deg = sensors.region_origin_deg[sensors.radars.region[radar[moving]]]
    site_deg[moving] = from_plane(measured.site_m[plot[moving]], origin_deg)
    of_plots = measured.time_s[plot] - lag_s[radar], measured.range_m[plot], measured.azimuth_rad[plot], site_deg
    of_vessels = vessels.time_s, vessels.position_deg, vessels.velocity_m_s, vessels.known_covariance(1.0)
    pairs = Pairs(plot, vessel, radar, *np.ascontiguousarray(kernel.differences(vessel, of_plots, of_vessels).T))
    centre, reach = search.centre[vessel], search.reach[vessel]
    close = (np.abs(pairs.range_m - centre[:, 0]) <= reach[:, 0]) & (np.abs(pairs.azimuth_rad - centre[:, 1]) <= reach[:, 1])
    return pairs.take(close & (pairs.distance_m <= sensors.radars.range_m[radar] + reach[:, 0]))
