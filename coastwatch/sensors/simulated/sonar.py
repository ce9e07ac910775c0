"""Simulated bearing sensors: `listen` makes their reports from the true positions of vessels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import CLASSES, BearingReports, Floats, Ints, Sonars
from coastwatch.geodesy import to_plane
from coastwatch.kernels.bearings.signatures import check_confusion, even_confusion
from coastwatch.sensors.simulated.radar import PositionAt
from coastwatch.stage import Settings, Share

PHASE, NOISE, DETECTION, CONTACTS, SIGNATURES = (
    41,
    42,
    43,
    44,
    45,
)  # streams of random numbers: a change of one does not change the others


Matrix = tuple[tuple[Share, ...], ...]


class SonarTruth(Settings):
    """How a simulated bearing sensor departs from its specification."""

    name: str = (
        ""  # of the sensor in [[sonars]]; empty in [input.sonar], which is for all sensors without an entry of their own
    )
    miss_probability: Share = 0.0  # of a vessel in range and arc, per bearing
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # true noise divided by the specified noise
    bias_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = (
        0.0  # added to every bearing: positive is clockwise, e.g. 2 measures 90 as 92
    )
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0  # from the bearing to the arrival of the report
    numbered: bool = True  # contacts have track numbers of the sensor
    signature_share: Share = 0.0  # of the reports name a class of vessel, by its sound
    signature_accuracy: Share = 0.7  # of these are right; the other classes are equally frequent
    signature_confusion: Matrix = ()  # confusion matrix instead of the accuracy: a row per true class with the share of each reported class
    signature_habit: Share = 0.8  # of these repeat the sensor's usual answer for this vessel, right or wrong

    @model_validator(mode="after")
    def _confusion_is_a_matrix(self) -> Self:
        check_confusion("signature_confusion", self.signature_confusion, CLASSES)
        return self

    def confusion(self) -> Floats:
        """Share of each reported class. (C, C) true class, reported class."""
        return (
            np.array(self.signature_confusion) if self.signature_confusion else even_confusion(self.signature_accuracy, CLASSES)
        )


def listen(
    sonars: Sonars,
    truths: Sequence[SonarTruth],
    position_at: PositionAt,
    vessel: Ints,
    vessel_class: Ints,
    start_s: float,
    stop_s: float,
    seed: int,
) -> BearingReports:
    """Bearings between two times, in order of arrival. A sensor measures all bearings at one instant, at a random phase.

    Args: sonars: specifications (R); truths: one per sensor; position_at: as in `radar`; vessel: (V,) becomes `origin`;
    vessel_class: (V,) VesselClass, -1 for none.
    """
    parts = []
    for r, truth in enumerate(truths):
        phase, noise, detection, contacts = (
            np.random.default_rng([seed, stream, r]) for stream in (PHASE, NOISE, DETECTION, CONTACTS)
        )
        interval = float(sonars.interval_s[r])
        times = start_s + (phase.random() + np.arange(int(np.ceil((stop_s - start_s) / interval)))) * interval
        row, time = np.tile(np.arange(len(vessel)), len(times)), np.repeat(times, len(vessel))
        at = to_plane(position_at(row, time), sonars.site_deg[r])
        bearing = np.degrees(np.arctan2(at[:, 0], at[:, 1]))
        in_arc = (bearing - sonars.arc_from_deg[r]) % 360.0 <= np.degrees(sonars.arc_width_rad[r])
        seen = in_arc & (np.hypot(at[:, 0], at[:, 1]) <= sonars.range_m[r]) & (time <= stop_s)
        draws = noise.standard_normal(len(row)) * truth.noise_factor
        seen &= detection.random(len(row)) >= truth.miss_probability
        number = contacts.permutation(len(vessel)) + 1 if truth.numbered else np.full(len(vessel), -1)
        measured = bearing + draws * np.degrees(sonars.bearing_sigma_rad[r]) + truth.bias_deg
        parts.append(
            BearingReports(
                sensor=np.full(len(row), r, np.int64),
                time_s=time,
                received_s=time + truth.latency_s,
                bearing_deg=measured % 360.0,
                contact=number[row],
                site_deg=np.tile(sonars.site_deg[r], (len(row), 1)),
                signature=reported_class(truth, vessel_class, row, np.random.default_rng([seed, SIGNATURES, r])),
                origin=vessel[row],
            ).take(seen)
        )
    joined = BearingReports.join(parts)
    return joined.take(np.lexsort((joined.contact, joined.sensor, joined.received_s)))


def reported_class(truth: SonarTruth, vessel_class: Ints, row: Ints, rng: np.random.Generator) -> Ints:
    """The class that each report names, -1 for none. Args: vessel_class: (V,) true; row: (M,) vessel of each report."""
    if truth.signature_share == 0.0:
        return np.full(len(row), -1, np.int64)
    least = np.cumsum(truth.confusion(), axis=1)[vessel_class]
    habit = _drawn(least, rng.random(len(vessel_class)))
    has_class, repeated, draw = (rng.random(len(row)) for _ in range(3))
    reported = np.where(repeated < truth.signature_habit, habit[row], _drawn(least[row], draw))
    return np.where((has_class < truth.signature_share) & (vessel_class[row] >= 0), reported, -1)


def _drawn(cumulative: Floats, uniform: Floats) -> Ints:
    """The class that a uniform number selects. Args: (M, C) rising to 1, (M,). Returns: (M,)."""
    return np.asarray(np.minimum((cumulative <= uniform[:, None]).sum(axis=1), CLASSES - 1), np.int64)
