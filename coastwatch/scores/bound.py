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

from coastwatch.batches import AisReports, Batch, Floats, Ints, Noise, RadarReports, Trajectories, column
from coastwatch.geodesy import KNOT_M_S, difference_m, from_plane, to_plane, turn, wrap_deg
from coastwatch.kernels.tables.lookup import row_of

AnyReports = TypeVar("AnyReports", RadarReports, AisReports)
FALSE_FROM_SIGMA, FALSE_FROM_M = 8.0, 30.0  # a report farther from the truth than both together is false and left out
SMALLEST_VARIANCE = 1e-9
POSITION, VELOCITY, KICK, INSTANT = 0, 1, 2, 3
POSITION_PRIOR_M, VELOCITY_PRIOR_M_S = 1e4, 10.0  # wide: forgotten after two reports


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
    row, number = np.nonzero(np.isfinite(truth.kick_s))
    kicks = _without_measurement(row, truth.kick_s[row, number], KICK, number)
    kicks.covariance[:] = (truth.kick_m_s[row] ** 2)[:, None, None] * np.eye(2)
    parts = [
        _without_measurement(vessels, time_s[instant], INSTANT, instant),
        kicks,
        _from_radar(truth, radar, noise, anchor),
        *_from_ais(truth, ais, noise, anchor),
    ]
    events = Events.join(parts)
    position, velocity, covariance = filtered(truth, events.take(has_model[events.row]), len(time_s))
    place = from_plane(position, anchor[:, None])
    velocity = np.einsum("vtji,vtj->vti", turn(place, anchor[:, None]), velocity)
    return Bound(place, velocity, covariance)


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
    site_deg = radar.site_deg
    if noise.site_error_m.any():
        site_deg = from_plane(-noise.site_error_m[s], site_deg)
    measured = from_plane(distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)]), site_deg)
    at = to_plane(_interpolated(truth, row, time), site_deg)
    true_distance = np.maximum(np.hypot(at[:, 0], at[:, 1]), 1.0)
    along = np.einsum("mij,mj->mi", turn(site_deg, anchor[row]), at / true_distance[:, None])
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


@dataclass(frozen=True, eq=False)
class Events(Batch):
    """Events of the filters, in any order: measurements, perturbations, and instants at which estimates are wanted."""

    row: Ints = column(np.int64, "M")  # of the vessel
    time_s: Floats = column(np.float64, "M")
    kind: Ints = column(np.int64, "M")
    value: Floats = column(np.float64, "M", 2)  # measured position in the plane, or velocity
    covariance: Floats = column(np.float64, "M", 2, 2)  # of the measurement, or of the perturbation
    instant: Ints = column(np.int64, "M")  # 0..T-1


def filtered(truth: Trajectories, events: Events, instants: int) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and their covariance at the instants, NaN for vessels without an event there.

    The state is position, velocity and, where perturbations die out, mean velocity; before the first event velocity is its mean.
    One round takes the next event of every vessel that still has one, so there are as many rounds as the busiest vessel has events.

    Args: truth: the motion models of the vessels (V). Returns: (V, T, 2), (V, T, 2), (V, T, 4, 4).
    """
    v = len(truth.vessel)
    keep = truth.kick_keep if len(truth.kick_keep) else np.ones(v)
    d = 6 if (keep < 1.0).any() else 4
    state, covariance = np.zeros((v, d)), np.zeros((v, d, d))
    tie = np.ones((d // 2 - 1, d // 2 - 1))
    covariance[:, :2, :2] = POSITION_PRIOR_M**2 * np.eye(2)
    covariance[:, 2:, 2:] = VELOCITY_PRIOR_M_S**2 * np.kron(tie, np.eye(2))
    filtered_at = np.full((v, instants, d), np.nan), np.full((v, instants, d, d), np.nan)
    events = events.take(np.lexsort((events.kind, events.time_s, events.row)))
    last_s = np.full(v, np.min(events.time_s, initial=np.inf))
    for rows in _rounds(events.row):
        now = events.take(rows)
        x, p = _predicted(truth, now.row, now.time_s - last_s[now.row], state[now.row], covariance[now.row])
        last_s[now.row] = now.time_s
        for kind, first in ((POSITION, 0), (VELOCITY, 2)):
            at = np.flatnonzero(now.kind == kind)
            if len(at):
                x[at], p[at] = _updated(x[at], p[at], now.value[at], now.covariance[at], first)
        at = np.flatnonzero(now.kind == KICK)
        if len(at):
            x[at], p[at] = _kicked(x[at], p[at], keep[now.row[at]], now.covariance[at])
        at = np.flatnonzero(now.kind == INSTANT)
        filtered_at[0][now.row[at], now.instant[at]], filtered_at[1][now.row[at], now.instant[at]] = x[at], p[at]
        state[now.row], covariance[now.row] = x, p
    return filtered_at[0][..., :2], filtered_at[0][..., 2:4], filtered_at[1][..., :4, :4]


def _rounds(row: Ints) -> list[Ints]:
    """For each round the events in it. Args: (M,) sorted."""
    first = np.searchsorted(row, row)
    number = np.arange(len(row)) - first
    order = np.argsort(number, kind="stable")
    return np.split(order, np.searchsorted(number[order], np.arange(1, int(number.max(initial=0)) + 1)))


def _predicted(truth: Trajectories, row: Ints, span_s: Floats, x: Floats, p: Floats) -> tuple[Floats, Floats]:
    """States after a time without perturbation."""
    d = x.shape[1]
    angle = truth.turn_rate_rad_s[row] * span_s
    ahead = span_s * np.sinc(angle / np.pi)
    aside = span_s * np.sin(0.5 * angle) * np.sinc(0.5 * angle / np.pi)
    f = np.zeros((len(row), d, d))
    f[:, [0, 1], [0, 1]] = 1.0
    f[:, 0, 2], f[:, 0, 3], f[:, 1, 2], f[:, 1, 3] = ahead, -aside, aside, ahead
    cos, sin = np.cos(angle), np.sin(angle)
    for k in range(2, d, 2):
        f[:, k, k], f[:, k, k + 1], f[:, k + 1, k], f[:, k + 1, k + 1] = cos, -sin, sin, cos
    gain = truth.acceleration_m_s2[row]
    moved = np.concatenate([0.5 * span_s[:, None] ** 2 * gain, *([span_s[:, None] * gain] * (d // 2 - 1))], axis=1)
    return np.einsum("mij,mj->mi", f, x) + moved, f @ p @ f.transpose(0, 2, 1)


def _updated(x: Floats, p: Floats, value: Floats, covariance: Floats, first: int) -> tuple[Floats, Floats]:
    """States after a measurement of two of their components."""
    at = slice(first, first + 2)
    s = p[:, at, at] + covariance
    gain = np.linalg.solve(s, p[:, at, :]).transpose(0, 2, 1)
    after = p - gain @ p[:, at, :]
    return x + np.einsum("mij,mj->mi", gain, value - x[:, at]), 0.5 * (after + after.transpose(0, 2, 1))


def _kicked(x: Floats, p: Floats, keep: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """States after a perturbation: velocity goes back towards its mean and takes a random step."""
    d = x.shape[1]
    g = np.tile(np.eye(d), (len(x), 1, 1))
    if d == 6:
        g[:, [2, 3], [2, 3]] = keep[:, None]
        g[:, [2, 3], [4, 5]] = 1.0 - keep[:, None]
    p = g @ p @ g.transpose(0, 2, 1)
    p[:, 2:4, 2:4] += covariance
    return np.einsum("mij,mj->mi", g, x), p
