"""The null hypothesis of a bearing track: density of its bearings if they come from a vessel that nobody else has seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats
from coastwatch.kernels.jit import jit

LOG_2PI = math.log(2.0 * math.pi)
TURN = 2.0 * math.pi
LEAST_PROBABILITY = 1e-300  # of a range: one that was ruled out may come back
RANGE_NUMBERS = "bearing rate p_bearing p_cross p_rate noise probability exponent"
RANGE = np.dtype([(name, np.float64) for name in RANGE_NUMBERS.split()])
"""The filter of one range: state, covariance, density of the white acceleration; probability, exponent of the newest density."""


class UnknownVessel(NamedTuple):
    """What is assumed of a vessel that nobody has seen: one of J ranges, as shares of the range of the sensor."""

    range_share: Floats  # (J,)
    range_probability: Floats  # (J,) sum 1
    speed: float  # m/s, standard deviation per axis
    acceleration_density: float  # m^2/s^3, of its changes of course and speed


@jit
def wrap_radians(angle):  # type: ignore[no-untyped-def]
    """The angle in [-pi, pi)."""
    return angle - TURN * np.floor(angle * (1.0 / TURN) + 0.5)


@jit
def _initialise(filters, bearing, variance, sensor_range, model):  # type: ignore[no-untyped-def]
    """Fills the filter of each range from the newest bearing."""
    for j in range(len(filters)):
        f, angular_speed = filters[j], model.speed / (sensor_range * model.range_share[j])
        f.bearing, f.rate = bearing, 0.0
        f.p_bearing, f.p_cross, f.p_rate = variance, 0.0, angular_speed * angular_speed
        f.noise = angular_speed**3 + model.acceleration_density * (angular_speed / model.speed) ** 2
        f.probability = model.range_probability[j]


@jit
def _update(f, bearing, variance, dt):  # type: ignore[no-untyped-def]
    """One more bearing into the filter of a range; its density is probability's new factor times e^exponent.

    Kalman filter of bearing and rate with white acceleration, over a step of either sign.
    """
    q = f.noise * abs(dt)
    p00 = f.p_bearing + dt * (2.0 * f.p_cross + dt * f.p_rate) + q * dt * dt / 3.0
    p01 = f.p_cross + dt * f.p_rate + 0.5 * q * dt
    p11 = f.p_rate + q
    predicted = f.bearing + dt * f.rate
    innovation = wrap_radians(bearing - predicted)
    precision = 1.0 / (p00 + variance)
    gain0, gain1 = p00 * precision, p01 * precision
    f.bearing, f.rate = predicted + gain0 * innovation, f.rate + gain1 * innovation
    f.p_bearing, f.p_cross, f.p_rate = p00 - gain0 * p00, p01 - gain0 * p01, p11 - gain1 * p01
    f.probability *= math.sqrt(precision)
    f.exponent = -0.5 * innovation * innovation * precision


@jit
def _mix(filters):  # type: ignore[no-untyped-def]
    """The log density of the newest bearing, summed over the ranges, and the probability of each range after it."""
    largest, total = -math.inf, 0.0
    for j in range(len(filters)):
        largest = max(largest, filters[j].exponent)
    for j in range(len(filters)):
        filters[j].probability *= math.exp(filters[j].exponent - largest)
        total += filters[j].probability
    for j in range(len(filters)):
        filters[j].probability = max(filters[j].probability / total, LEAST_PROBABILITY)
    return math.log(total) + largest - 0.5 * LOG_2PI


@jit
def unknown_log_density(time, bearing, variance, sensor_range, model, out):  # type: ignore[no-untyped-def]
    """Log density of the newest n bearings of a track, for every n, if they come from an unknown vessel.

    At range r the bearing rate is N(0, (speed / r)^2). It wanders by the geometry of a straight course (variance (speed / r)^3 a second)
    and by changes of course (acceleration_density / r^2). The newest bearing is uniform with density 1 a radian. The range is one of a
    few, so the density is that of a static multiple-model estimator.
    Args:
        time, bearing, variance: (W,) s, rad, rad^2, oldest first, NaN before the first bearing. sensor_range: m.
        model: UnknownVessel. out: (W + 1,) written; with fewer than n bearings the density of all.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.2.
    """
    window, filters = len(time), np.empty(len(model.range_share), RANGE)
    out[0] = out[1] = 0.0
    if math.isnan(bearing[window - 1]):
        out[:] = 0.0
        return
    _initialise(filters, bearing[window - 1], variance[window - 1], sensor_range, model)
    for n in range(2, window + 1):
        k = window - n
        if math.isnan(bearing[k]):
            out[n:] = out[n - 1]
            return
        for j in range(len(filters)):
            _update(filters[j], bearing[k], variance[k], time[k] - time[k + 1])
        out[n] = out[n - 1] + _mix(filters)
