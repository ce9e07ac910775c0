"""Bearings without contact numbers to the vessels of the picture: in crowded directions a vessel predicts its bearing, a track cannot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import BearingAssociations, BearingReports, ExpectedVessels, Floats, Ints, Picture, Sensors
from coastwatch.batches.struct import Batch, column
from coastwatch.geodesy import wrap_rad

EXACT = 10  # vessels or bearings of a cluster whose joint assignments are all added up
LEAST_CERTAINTY = 0.1  # a pair less probable is not chosen
FLOOR_M = 3.0  # error of a position beside its covariance (hull, antenna), per axis
UNKNOWN_M = 15.0  # standard deviation per axis where a vessel has no covariance
SOON = 1.2  # ranges of a sensor, within which vessels are expected
NEAREST_M = 1.0  # a vessel on top of the sensor has no bearing, its variance says so


@dataclass(frozen=True, eq=False)
class Predicted(Batch):
    """Bearings that expected vessels should give at a look; one row for each vessel that a sensor hears."""

    sensor: Ints = column(np.int64, "H")  # sorted
    vessel_id: Ints = column(np.int64, "H")
    bearing_rad: Floats = column(np.float64, "H")
    variance: Floats = column(np.float64, "H")  # of the prediction


def expected_vessels(
    sensor: Ints, site_deg: Floats, picture: Picture, found: BearingAssociations, sensors: Sensors
) -> ExpectedVessels:
    """The vessels of a picture that some sensors of bearings may hear in the next cycle. Args: sensor, site_deg: (S,), (S, 2)."""
    if not len(sensor):
        return ExpectedVessels.empty()
    near = kernels.geometry.sensor_coverage.coverage_of(site_deg, SOON * sensors.sonars.range_m[sensor], 0.0)
    rows = np.flatnonzero(kernels.geometry.sensor_coverage.in_any_range(near, picture.position_deg))
    bias, sigma = found.sensor_bias_rad, found.sensor_bias_sigma_rad
    return ExpectedVessels(
        picture.vessel_id[rows],
        picture.time_s[rows],
        picture.position_deg[rows],
        picture.velocity_m_s[rows],
        0.5 * (picture.covariance[rows, 0, 0] + picture.covariance[rows, 1, 1]),
        bias,
        sigma if len(sigma) == len(bias) else np.zeros(len(bias)),
    )


def predicted_bearings(expected: ExpectedVessels, reports: BearingReports, sensors: Sensors) -> Predicted:
    """The bearings of expected vessels at a look of each of some sensors. Args: reports: sorted by sensor, one time a sensor."""
    active, first = np.unique(reports.sensor, return_index=True)
    site, time_s, sonars = reports.site_deg[first], reports.time_s[first], sensors.sonars
    row, of, offset = kernels.geometry.sensor_coverage.pairs_in_range(
        site, SOON * sonars.range_m[active], expected.position_deg, np.zeros(len(expected.vessel_id))
    )
    offset = offset + expected.velocity_m_s[row] * (time_s[of] - expected.time_s[row])[:, None]
    distance, direction = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), NEAREST_M), np.arctan2(offset[:, 0], offset[:, 1])
    width = sonars.arc_width_rad[active]
    inside = (distance <= sonars.range_m[active[of]]) & np.isfinite(direction)
    inside &= (direction - np.radians(sonars.arc_from_deg[active[of]])) % (2.0 * np.pi) <= width[of]
    position = expected.variance_m2[row]
    position = np.where(np.isfinite(position), position, UNKNOWN_M**2) + FLOOR_M**2
    bias, bias_sigma = np.zeros(len(sonars)), np.zeros(len(sonars))
    known = len(expected.bias_rad)
    bias[:known], bias_sigma[:known] = expected.bias_rad, expected.bias_sigma_rad
    sensor = active[of]
    out = Predicted(
        sensor,
        expected.vessel_id[row],
        np.asarray(wrap_rad(direction + bias[sensor])),
        position / distance**2 + bias_sigma[sensor] ** 2,
    )
    rows = np.flatnonzero(inside)
    return out.take(rows[np.lexsort((out.vessel_id[rows], sensor[rows]))])


def in_crowd(predicted: Predicted, gate_sigmas: float, crowd: float, sensors: Sensors) -> Predicted:
    """Those of sensors in whose gates are, on average, `crowd` expected vessels or more."""
    a_radian = np.bincount(predicted.sensor, minlength=len(sensors.sonars)) / sensors.sonars.arc_width_rad
    crowded = 2.0 * gate_sigmas * sensors.sonars.bearing_sigma_rad * a_radian >= crowd
    return predicted.take(crowded[predicted.sensor])


def chosen_pairs(
    predicted: Predicted,
    reports: BearingReports,
    near: tuple[Ints, Ints],
    noise: Floats,
    gate_sigmas: float,
    detection: float,
    sensors: Sensors,
) -> tuple[Ints, Ints, Floats]:
    """One-to-one pairs of an expected vessel and a bearing with the greatest sum of probabilities, and these probabilities.

    Probabilities are over all joint assignments. A bearing may be of an unknown vessel, as often as `unknown_density` says.
    Args: reports: (M,) of a look; near: rows of pairs that may be in the gate; noise: (M,) variance of each bearing, rad2;
    detection: probability that a vessel is heard. Returns: (B,) rows of `predicted`, (B,) rows of `reports`, (B,).
    Source: Y. Bar-Shalom, X. R. Li, Multitarget-Multisensor Tracking, 1995, section 6.2 (joint probabilistic data association).
    """
    vessel, report = near
    bearing = np.radians(reports.bearing_deg)
    variance = predicted.variance[vessel] + noise[report]
    squared = wrap_rad(bearing[report] - predicted.bearing_rad[vessel]) ** 2 / variance
    inside = squared < gate_sigmas**2
    vessel, report, variance, squared = vessel[inside], report[inside], variance[inside], squared[inside]
    unknown = kernels.bearings.directions.unknown_density(
        reports.sensor, bearing, predicted.sensor, predicted.bearing_rad, detection, sensors.sonars.arc_width_rad
    )
    weight = detection / (1.0 - detection) * np.exp(-0.5 * squared) / (np.sqrt(2.0 * np.pi * variance) * unknown[report])
    probability = kernels.association.marginals.marginals(
        report.astype(np.int64), vessel.astype(np.int64), weight, len(reports), len(predicted.sensor), EXACT
    )
    chosen = kernels.association.assignment.assign(
        vessel.astype(np.int64), report.astype(np.int64), probability - LEAST_CERTAINTY
    )
    rows = np.flatnonzero(chosen)
    return vessel[rows], report[rows], probability[rows]
