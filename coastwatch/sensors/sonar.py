"""What sensors of bearings would report of vessels that move as given: `listen`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from coastwatch.batches import BearingReports, Ints, Sonars
from coastwatch.geodesy import to_plane
from coastwatch.sensors.radar import Where
from coastwatch.stage import Settings

PHASE, NOISE, DETECTION, CONTACTS = 41, 42, 43, 44  # streams of random numbers: a change of one leaves the others as they are


class SonarTruth(Settings):
    """What a simulated sensor of bearings does beyond its specification."""

    name: str = ""  # of the sensor in [[sonars]]; empty in [input.sonar], which is of all that are not named
    miss_probability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0  # of a vessel in range and arc, each time
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # real noise over that of the specification
    bias_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0  # added to every bearing
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0  # from the bearing to the arrival of the report
    numbered: bool = True  # contacts have numbers of the sensor's own


def listen(
    sonars: Sonars, truths: Sequence[SonarTruth], where: Where, vessel: Ints, start_s: float, stop_s: float, seed: int
) -> BearingReports:
    """Bearings between two times, in order of arrival. A sensor takes all bearings at one instant, at a random phase.

    Args: sonars: by specification (R); truths: one a sensor; where: as in coastwatch/sensors/radar.py; vessel: (V,) what
    becomes `origin`.
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
                origin=vessel[row],
            ).take(seen)
        )
    joined = BearingReports.join(parts)
    return joined.take(np.lexsort((joined.contact, joined.sensor, joined.received_s)))
