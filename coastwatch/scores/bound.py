"""The physical bound: errors of the exact filter over all plots and AIS reports, given the true motion model and noises.

The motion is linear and Gaussian between and at the kicks: position p, velocity v and mean velocity m of each vessel, in a plane at
its first position. Between kicks v and m turn at the known rate and grow by the known acceleration; at a kick, whose time is
known, v becomes m + keep (v - m) + e with e of the known standard deviation. So the Kalman filter is the MMSE estimator.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from coastwatch.batches import AisReports, Floats, Ints, Noise, RadarReports, Trajectories
from coastwatch.geodesy import KNOT_M_S, difference_m, from_plane, to_plane, turn, wrap_deg
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scores.exact_filter import INSTANT, KICK, POSITION, VELOCITY, Events, filtered

AnyReports = TypeVar("AnyReports", RadarReports, AisReports)
FALSE_FROM_SIGMA, FALSE_FROM_M = 8.0, 30.0  # a report farther from the truth than both together is false and left out
SMALLEST_VARIANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Bound:
    """Estimates of the exact filter; NaN for vessels whose motion is not linear."""

    position_deg: Floats  # (V, T, 2)
    velocity_m_s: Floats  # (V, T, 2)
    covariance: Floats  # (V, T, 4, 4) of east, north, east rate, north rate


def bound(truth: Trajectories, radar: RadarReports, ais: AisReports, noise: Noise, time_s: Floats) -> Bound:
    """The best estimates possible at some instants.

    Args: truth: (V); radar, ais: all reports of the run; those of other vessels and of clutter are ignored; noise: true
    errors of the sensors; time_s: (T,) instants. A report counts from the time of its measurement, even if it arrived late.
    """
    has_model = np.isfinite(truth.kick_m_s)
    anchor = truth.position_deg[:, 0]
    vessels, instant = np.indices((len(truth.vessel), len(time_s))).reshape(2, -1)
    parts = [
        _without_measurement(vessels, time_s[instant], INSTANT, instant),
        _kicks(truth),
        _from_radar(truth, radar, noise, anchor),
        *_from_ais(truth, ais, noise, anchor),
    ]
    events = Events.join(parts)
    position, velocity, covariance = filtered(truth, events.take(has_model[events.row]), len(time_s))
    place = from_plane(position, anchor[:, None])
    velocity = np.einsum("vtji,vtj->vti", turn(place, anchor[:, None]), velocity)
    return Bound(place, velocity, covariance)


def _kicks(truth: Trajectories) -> Events:
    """The perturbations of the velocities."""
    row, number = np.nonzero(np.isfinite(truth.kick_s))
    kicks = _without_measurement(row, truth.kick_s[row, number], KICK, number)
    kicks.covariance[:] = (truth.kick_m_s[row] ** 2)[:, None, None] * np.eye(2)
    return kicks


def _without_measurement(row: Ints, time_s: Floats, kind: int, instant: Ints) -> Events:
    """Events of this kind with zeros for the measurement."""
    n = len(row)
    return Events(row, time_s, np.full(n, kind), np.zeros((n, 2)), np.zeros((n, 2, 2)), instant)


def _from_radar(truth: Trajectories, radar: RadarReports, noise: Noise, anchor: Floats) -> Events:
    """Plots without their biases, with the noise at the true position."""
    row, radar = _of_vessels(truth, radar.origin, radar)
    s = radar.sensor
    time = radar.time_s - noise.time_bias_s[s]
    azimuth = np.radians(radar.azimuth_deg) - noise.azimuth_bias_rad[s]
    distance = (radar.range_m - noise.range_bias_m[s]) / np.exp(-0.5 * noise.azimuth_sigma_rad[s] ** 2)
    measured = from_plane(distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)]), radar.site_deg)
    at = to_plane(_interpolated(truth, row, time), radar.site_deg)
    true_distance = np.maximum(np.hypot(at[:, 0], at[:, 1]), 1.0)
    along = np.einsum("mij,mj->mi", turn(radar.site_deg, anchor[row]), at / true_distance[:, None])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    variances = noise.range_sigma_m[s] ** 2, (true_distance * noise.azimuth_sigma_rad[s]) ** 2
    covariance = sum(v[:, None, None] * u[:, :, None] * u[:, None, :] for v, u in zip(variances, (along, across), strict=True))
    return _measured(row, time, POSITION, to_plane(measured, anchor[row]), np.asarray(covariance))


def _from_ais(truth: Trajectories, ais: AisReports, noise: Noise, anchor: Floats) -> list[Events]:
    """Positions, and velocities where they are reported; without false reports."""
    row, ais = _of_vessels(truth, ais.origin, ais)
    error_m = difference_m(ais.position_deg, _interpolated(truth, row, ais.time_s))
    plausible = np.hypot(error_m[:, 0], error_m[:, 1]) < FALSE_FROM_M + FALSE_FROM_SIGMA * noise.ais_position_sigma_m
    row, ais = row[plausible], ais.take(plausible)
    eye = np.broadcast_to(np.eye(2), (len(row), 2, 2))
    position = _measured(
        row, ais.time_s, POSITION, to_plane(ais.position_deg, anchor[row]), eye * noise.ais_position_sigma_m**2
    )
    course = np.radians(ais.cog_deg)
    there = (ais.sog_kn * KNOT_M_S)[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    velocity = np.einsum("mij,mj->mi", turn(ais.position_deg, anchor[row]), there)
    moving = np.isfinite(velocity[:, 0])
    return [
        position,
        _measured(row, ais.time_s, VELOCITY, velocity, eye * noise.ais_velocity_sigma_m_s**2).take(moving),
    ]


def _measured(row: Ints, time_s: Floats, kind: int, value: Floats, covariance: Floats) -> Events:
    """Measurements of this kind, with a little added to the covariance so that it can be inverted."""
    widened = covariance + SMALLEST_VARIANCE * np.eye(2)
    return Events(row, time_s, np.full(len(row), kind), value, widened, np.zeros(len(row), np.int64))


def _of_vessels(truth: Trajectories, origin: Ints, reports: AnyReports) -> tuple[Ints, AnyReports]:
    """The row of the true vessel of each report, and the reports that have one."""
    row = row_of(truth.vessel, origin)
    return row[row >= 0], reports.take(row >= 0)


def _interpolated(truth: Trajectories, row: Ints, time_s: Floats) -> Floats:
    """True positions, interpolated linearly between the samples: good enough for a covariance. (M, 2)"""
    hi = np.clip(np.searchsorted(truth.time_s, time_s), 1, len(truth.time_s) - 1)
    weight = np.clip((time_s - truth.time_s[hi - 1]) / (truth.time_s[hi] - truth.time_s[hi - 1]), 0.0, 1.0)
    step = truth.position_deg[row, hi] - truth.position_deg[row, hi - 1]
    step[:, 1] = wrap_deg(step[:, 1])
    return truth.position_deg[row, hi - 1] + weight[:, None] * step
