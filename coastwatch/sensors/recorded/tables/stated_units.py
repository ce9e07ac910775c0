"""Whether ranges and angles of a table are in the unit that its column does not state: metres, degrees. What looks wrong, in sentences."""

from __future__ import annotations

import re

import numpy as np

from coastwatch.batches import Floats, Ints, Radars
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.sensors.recorded.tables.reader import plain_name
from coastwatch.sensors.recorded.tables.stated_motion import TENTHS

MANY_ROWS = 200
"""Fewer plots may all be near, or all in one sector."""
NEAR_SHARE = 0.01  # of the radar's range
SAID_DEGREES = r"(^|_)deg(rees)?(_|$)"
FULL_TURN_RAD = 2.0 * np.pi
BEYOND_DEG = 360.05  # a table may have rounded 360
LEAST_BEYOND_SHARE, LEAST_BEYOND_VALUES = 0.05, 10
"""Of the numbers of a column, and different ones: fewer are wrong cells, or one number that means none."""
TURNS = {
    400.0: "gradians",
    3600.0: "tenths of a degree",
    4096.0: "counts of 4096 a turn",
    6400.0: "mils",
    8192.0: "counts of 8192 a turn",
    36000.0: "hundredths of a degree",
    65536.0: "counts of 65536 a turn",
}
"""Units of angle by how many make a turn."""
FULL_SHARE = 0.8  # of a turn, that the highest of many angles reaches


def range_doubts(sensor: Ints, range_m: Floats, radars: Radars, column: str) -> tuple[str, ...]:
    """That all ranges of a radar are very short, as those in NM or km are if they are taken as metres.

    Args: sensor: (M,) of each plot; range_m: (M,); column: of the ranges, in the file.
    """
    for r in np.flatnonzero(np.bincount(sensor, minlength=len(radars)) >= MANY_ROWS).tolist():
        longest, reach_nm = float(range_m[sensor == r].max()), float(radars.range_m[r]) / NAUTICAL_MILE_M
        if longest > NEAR_SHARE * radars.range_m[r]:
            continue
        units = {"nautical miles": ("range_nm", reach_nm), "km": ("range_km", reach_nm * NAUTICAL_MILE_M / 1000.0)}
        fitting = {name: key for name, (key, reach) in units.items() if longest <= reach}
        said = f"no range is above {longest:.3g} m, of a radar of {reach_nm:.3g} NM: "
        said += f"is it in {' or '.join(fitting)}? " if fitting else "in which unit is it? needed m"
        return (said + " or ".join(f"--columns plots.{key}={column}" for key in fitting.values()),)
    return ()


def angle_doubts(angle: Floats, column: str, what: str) -> tuple[str, ...]:
    """That angles are not in degrees: a column that does not say so has no more than 2 pi, or many are beyond 360.

    Args: angle: (M,) as stated, NaN: none; column: in the file; what: the angles are, "azimuth".
    """
    size = np.abs(angle[np.isfinite(angle)])
    beyond = _many_beyond(size, BEYOND_DEG)
    if len(beyond):
        highest = float(beyond.max())
        units = " or ".join(name for turn, name in TURNS.items() if FULL_SHARE * turn <= highest <= turn)
        asked = f"are they in {units}?" if units else "in which unit are they?"
        return (
            f"{len(beyond) / len(size):.0%} of the numbers in column {column} are beyond 360, up to {highest:.6g}: {asked} needed {what} "
            "in degrees; what is below 360 was taken as degrees",
        )
    if len(size) >= MANY_ROWS and 0.0 < size.max() <= FULL_TURN_RAD and not re.search(SAID_DEGREES, plain_name(column)):
        mend = f"--columns plots.azimuth_rad={column}" if what == "azimuth" else "needed degrees"
        return (f"no {what} in column {column} is above {size.max():.3g} degrees: is it in radians? {mend}",)
    return ()


def speed_doubts(sog_kn: Floats, highest_kn: float, unit: str, column: str) -> tuple[str, ...]:
    """That many speeds are beyond the highest one. Args: sog_kn: (M,), NaN: none; unit: in which they were taken."""
    stated = sog_kn[np.isfinite(sog_kn)]
    beyond = _many_beyond(stated, highest_kn)
    if not len(beyond):
        return ()
    mend = "" if unit == TENTHS else f', --set "input.speed_unit={TENTHS}"'
    share = f"{len(beyond) / len(stated):.0%}"
    return (
        f"{share} of the speeds in column {column} are beyond {highest_kn:.1f} kn, up to {beyond.max():.4g}, and not used: in which unit "
        f"are they{mend}?",
    )


def _many_beyond(number: Floats, highest: float) -> Floats:
    """The numbers above a limit, where they are many and differ; else none. (M,) -> (B,)"""
    beyond = number[number > highest]
    many = len(beyond) >= LEAST_BEYOND_SHARE * len(number) and len(np.unique(beyond)) >= LEAST_BEYOND_VALUES
    return beyond if many else beyond[:0]
