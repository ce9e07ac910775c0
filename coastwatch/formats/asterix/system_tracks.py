"""Vessels of a picture as system tracks, ASTERIX CAT 062.

Source: EUROCONTROL Specification for Surveillance Data Exchange, Part 9 (CAT 062, edition 1.20).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from coastwatch.formats.format import OutSettings, Vessels
from coastwatch.formats.intake.timestamps import DAY_S
from coastwatch.formats.target_numbers import TargetNumbers
from coastwatch.geodesy import KNOT_M_S

STEPS = 128  # of a second
SAC, SIC = 25, 1  # of this system
NUMBERS = 1 << 16  # that item 040 has room for
LARGEST_SIGMA_M = 16_383.0  # for which item 500 has room, with the sign of a covariance
LARGEST_M_S = 8_191.0  # for which item 185 has room


class SystemTracks:
    """One datagram a vessel. A vessel keeps its track number, 0 to 65535, while it is in the picture."""

    def __init__(self, to: OutSettings) -> None:
        """Args: to: not used."""
        self._numbers = TargetNumbers(range(NUMBERS))

    def messages(self, vessels: Vessels) -> Iterator[bytes]:
        """As of `Encoder`. Vessels beyond the last number are left out."""
        from asterix import generated  # it takes a second to import

        self._numbers.keep(vessels.every_id.tolist())
        for row, vessel in enumerate(vessels.vessel_id.tolist()):
            number = self._numbers.get(vessel)
            if number is not None:
                items: Any = _items(vessels, row, number)  # the library types each item by its edition
                record = generated.Cat_062_1_20.cv_record.create(items)
                yield generated.Cat_062_1_20.create([record]).unparse().to_bytes()


def time_of_day_s(time_s: float) -> float:
    """The time of day in steps of 1/128 s, from 0 to under a day: a moment before midnight is midnight, not 24 h."""
    return round(time_s % DAY_S * STEPS) % (DAY_S * STEPS) / STEPS


def _items(vessels: Vessels, row: int, number: int) -> dict[str, Any]:
    """The items of the record of a vessel. What is not known is left out."""
    latitude, longitude = vessels.position_deg[row].tolist()
    items: dict[str, Any] = {
        "010": (("SAC", SAC), ("SIC", SIC)),
        "040": number,
        "070": (time_of_day_s(vessels.time_s), "s"),
        "080": ((("MON", 0), 0, 0, 0, 0, 0, None),),
        "105": (("LAT", (latitude, "°")), ("LON", (longitude, "°"))),
    }
    speed, course = float(vessels.sog_kn[row]) * KNOT_M_S, math.radians(float(vessels.cog_deg[row]))
    if math.isfinite(course) and speed < LARGEST_M_S:
        items["185"] = (("VX", (speed * math.sin(course), "m/s")), ("VY", (speed * math.cos(course), "m/s")))
    major, minor, orientation = (float(column[row]) for column in (vessels.major_m, vessels.minor_m, vessels.orientation_deg))
    if math.isfinite(orientation) and minor >= 0.0 and major < LARGEST_SIGMA_M:
        items["500"] = _accuracy(major, minor, math.radians(orientation))
    return items


def _accuracy(major_m: float, minor_m: float, orientation: float) -> dict[str, Any]:
    """Item 500 of an ellipse: deviations to the east and north, and the root of the covariance with its sign.

    Args: orientation: of the longer axis, clockwise from north.
    """
    sine, cosine = math.sin(orientation), math.cos(orientation)
    east_m, north_m = math.hypot(major_m * sine, minor_m * cosine), math.hypot(major_m * cosine, minor_m * sine)
    covariance_m2 = (major_m**2 - minor_m**2) * sine * cosine
    root_m = math.copysign(math.sqrt(abs(covariance_m2)), covariance_m2)
    return {"APC": (("X", (east_m, "m")), ("Y", (north_m, "m"))), "COV": (root_m, "m")}
