"""What sensors of bearings would report of vessels that move as given: `listen`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import CLASSES, BearingReports, Floats, Ints, Sonars
from coastwatch.geodesy import to_plane
from coastwatch.kernels.bearings.signatures import check_confusion, even_confusion
from coastwatch.sensors.radar import Where
from coastwatch.sensors.vessels import Share
from coastwatch.stage import Settings

PHASE, NOISE, DETECTION, CONTACTS, SIGNATURES = (
    41,
    42,
    43,
    44,
    45,
)  # streams of random numbers: a change of one leaves the others


Matrix = tuple[tuple[Share, ...], ...]


class SonarTruth(Settings):
    """What a simulated sensor of bearings does beyond its specification."""

    name: str = ""  # of the sensor in [[sonars]]; empty in [input.sonar], which is of all that are not named
    miss_probability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0  # of a vessel in range and arc, each time
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # real noise over that of the specification
    bias_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0  # added to every bearing
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0  # from the bearing to the arrival of the report
    numbered: bool = True  # contacts have numbers of the sensor's own
    signature_share: Share = 0.0  # of the reports say a class of vessel, by its sound
    signature_accuracy: Share = 0.7  # of these are right; the other classes are said equally often
    signature_confusion: Matrix = ()  # instead: a row for each true class, in it how often each class is said
    signature_habit: Share = (
        0.8  # of these repeat the one answer that the sensor is used to give for this vessel, right or wrong
    )

    @model_validator(mode="after")
    def _confusion_is_a_matrix(self) -> Self:
        check_confusion("signature_confusion", self.signature_confusion, CLASSES)
        return self

    def confusion(self) -> Floats:
        """How often each class is said of each. (C, C) true, said."""
        return (
            np.array(self.signature_confusion) if self.signature_confusion else even_confusion(self.signature_accuracy, CLASSES)
        )


def listen(
    sonars: Sonars,
    truths: Sequence[SonarTruth],
    where: Where,
    vessel: Ints,
    vessel_class: Ints,
    start_s: float,
    stop_s: float,
    seed: int,
) -> BearingReports:
    """Bearings between two times, in order of arrival. A sensor takes all bearings at one instant, at a random phase.

    Args: sonars: by specification (R); truths: one a sensor; where: as in coastwatch/sensors/radar.py; vessel: (V,) what
    becomes `origin`; vessel_class: (V,) VesselClass, -1 of one that sounds like none.
    """
    parts = []
    for r, truth in enumerate(truths):
        phase, noise, detection, contacts = (
            np.random.default_rng([seed, stream, r]) for stream in (PHASE, NOISE, DETECTION, CONTACTS)
        )
        interval = float(sonars.interval_s[r])
        times = start_s + (phase.random() + np.arange(int(np.ceil((stop_s - start_s) / interval)))) * interval
        row, time = np.tile(np.arange(len(vessel)), len(times)), np.repeat(times, len(vessel))
        at = to_plane(where(row, time), sonars.site_deg[r])
        bearing = np.degrees(np.arctan2(at[:, 0], at[:, 1]))
        arc = float(sonars.arc_to_deg[r] - sonars.arc_from_deg[r])
        in_arc = (bearing - sonars.arc_from_deg[r]) % 360.0 <= (arc % 360.0 if abs(arc) < 360.0 else 360.0)
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
                signature=say_class(truth, vessel_class, row, np.random.default_rng([seed, SIGNATURES, r])),
                origin=vessel[row],
            ).take(seen)
        )
    joined = BearingReports.join(parts)
    return joined.take(np.lexsort((joined.contact, joined.sensor, joined.received_s)))


def say_class(truth: SonarTruth, vessel_class: Ints, row: Ints, rng: np.random.Generator) -> Ints:
    """What is said of the class of the vessel in each of these rows, -1 where nothing is. Args: vessel_class: (V,); row: (M,)."""
    if truth.signature_share == 0.0:
        return np.full(len(row), -1, np.int64)
    least = np.cumsum(truth.confusion(), axis=1)[vessel_class]
    habit = _drawn(least, rng.random(len(vessel_class)))
    told, repeated, draw = (rng.random(len(row)) for _ in range(3))
    said = np.where(repeated < truth.signature_habit, habit[row], _drawn(least[row], draw))
    return np.where((told < truth.signature_share) & (vessel_class[row] >= 0), said, -1)


def _drawn(cumulative: Floats, uniform: Floats) -> Ints:
    """The class that a uniform number falls on. Args: (M, C) rising to 1, (M,). Returns: (M,)."""
    return np.asarray(np.minimum((cumulative <= uniform[:, None]).sum(axis=1), CLASSES - 1), np.int64)
