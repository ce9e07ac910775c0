"""Log odds of pairs of a bearing track and a vessel: that its bearings come from the vessel, against the null hypothesis.

One pair at a time, from the newest bearing back. tests/kernels/test_bearing_likelihood.py has the form with dense covariance matrices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Ints
from coastwatch.kernels.bearings.null_hypothesis import LOG_2PI, UnknownVessel, unknown_log_density, wrap_radians
from coastwatch.kernels.bearings.windows import SAMPLE, relative_position, sample_window
from coastwatch.kernels.jit import jit

NEAREST = 1.0  # m: a vessel on top of the sensor has no bearing, its uncertainty says so


class TrackPairs(NamedTuple):
    """The pairs of R tracks, those of one track after the other."""

    track: Ints  # (R,) rows of BearingWindows
    start: Ints  # (R + 1,) where the pairs of each track begin
    slot: Ints  # (A,) of the vessel of each pair in PositionWindows, -1 for none


class Hypotheses(NamedTuple):
    """What is assumed of known and unknown vessels."""

    detection: float  # probability that a vessel inside the coverage of a sensor has a track of it
    memory: float  # s, correlation time of position errors
    rejection_log_odds: float  # log odds at which a pair is not looked at any further
    unknown: UnknownVessel


class Sensor(NamedTuple):
    """One row of BearingWindows: numbers, so that no array is counted in and out for every pair."""

    range: float
    arc_from: float
    arc_width: float
    bias_variance: float


@jit
def outside_coverage(distance, direction, sensor):  # type: ignore[no-untyped-def]
    """How far a position is outside the coverage of a sensor, m, negative inside."""
    outside = distance - sensor.range
    if sensor.arc_width < 2.0 * math.pi:
        off = abs(wrap_radians(direction - sensor.arc_from - 0.5 * sensor.arc_width)) - 0.5 * sensor.arc_width
        outside = max(outside, distance * math.sin(min(max(off, -0.5 * math.pi), 0.5 * math.pi)))
    return outside


@jit
def log_odds_of(probability):  # type: ignore[no-untyped-def]
    """The logarithm of the odds of a probability."""
    return math.log(probability / (1.0 - probability))


@jit
def _compare(samples, sensor, value, slot, odds, rejection_log_odds):  # type: ignore[no-untyped-def]
    """The bearings of a track with one vessel, by a Kalman filter of two states: sensor offset and position error.

    difference = offset + h error + noise. The error of the position, in standard deviations, is a first-order Gauss-Markov process.
    h is the angle that one standard deviation subtends at the sensor.
    Args: samples: (n,) SAMPLE; odds: log odds before any bearing.
    Returns: log odds, -inf if the vessel was absent; mean difference; how far outside the coverage it was at most, in standard deviations.
    """
    offset, error, p00, p01, p11 = 0.0, 0.0, sensor.bias_variance, 0.0, 1.0
    log_odds, farthest, weights, weighted = -math.inf, -math.inf, 0.0, 0.0
    for n in range(len(samples)):
        s = samples[n]
        east, north, sigma = relative_position(s, value, slot)
        if math.isnan(east + north + sigma):
            break
        distance, direction = max(math.sqrt(east * east + north * north), NEAREST), math.atan2(east, north)
        farthest = max(farthest, outside_coverage(distance, direction, sensor) / max(sigma, NEAREST))
        error, p01 = s.correlation * error, s.correlation * p01
        p11 = s.correlation * s.correlation * (p11 - 1.0) + 1.0
        h = sigma / distance
        cross0, cross1 = p00 + h * p01, p01 + h * p11
        innovation_variance = cross0 + h * cross1 + s.variance
        precision = 1.0 / innovation_variance
        difference = wrap_radians(s.bearing - direction)
        innovation = difference - offset - h * error
        offset, error = offset + cross0 * precision * innovation, error + cross1 * precision * innovation
        p00, p01 = p00 - cross0 * cross0 * precision, p01 - cross0 * cross1 * precision
        p11 -= cross1 * cross1 * precision
        odds -= 0.5 * (LOG_2PI + math.log(innovation_variance) + innovation * innovation * precision)
        log_odds = odds - s.log_density
        weight = 1.0 / (s.variance + h * h)
        weights, weighted = weights + weight, weighted + weight * difference
        if log_odds < rejection_log_odds:
            break
    return log_odds, weighted / weights, farthest


@jit
def log_odds(low, high, pairs, windows, positions, hypotheses, out):  # type: ignore[no-untyped-def]
    """Log odds of each pair, vessel against unknown vessel, and the mean of its bearing differences.

    Differences are white noise, plus the across-range error of the vessel's position, correlated over `memory` seconds, plus a constant
    offset with `bias_variance`. A window ends where the vessel's own positions do, and with `rejection_log_odds`.
    Args:
        low, high: range of the R tracks. pairs: TrackPairs. windows: BearingWindows. positions: PositionWindows. hypotheses: Hypotheses.
        out: (A, 2) written: log odds, less than `rejection_log_odds` where a pair is rejected; mean difference. -inf and NaN where
        nothing could be compared.
    """
    track, start, slot = pairs
    window, detection, prior = windows.time.shape[1], hypotheses.detection, log_odds_of(hypotheses.detection)
    null, samples = np.empty(window + 1), np.empty(window, SAMPLE)
    for r in range(low, high):
        i = track[r]
        sensor_range, bias, outside = windows.range[i], windows.bias[i], windows.outside[i]
        unknown_log_density(windows.time[i], windows.bearing[i], windows.variance[i], sensor_range, hypotheses.unknown, null)
        used = samples[: sample_window(i, windows, positions, hypotheses.memory, null, samples)]
        sensor = Sensor(sensor_range, windows.arc_from[i], windows.arc_width[i], windows.bias_variance[i])
        for p in range(start[r], start[r + 1]):
            out[p, 0], out[p, 1] = -np.inf, np.nan
            if slot[p] < 0 or len(used) == 0:
                continue
            odds, difference, farthest = _compare(
                used, sensor, positions.value, slot[p], prior - windows.log_density[i], hypotheses.rejection_log_odds
            )
            out[p, 0], out[p, 1] = odds, difference + bias
            if odds >= hypotheses.rejection_log_odds:
                out[p, 0] += log_odds_of(outside + (detection - outside) * 0.5 * math.erfc(farthest / math.sqrt(2.0))) - prior
