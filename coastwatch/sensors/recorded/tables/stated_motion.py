"""Whether the positions of a table move as its speeds and courses say. If not: another unit, or latitude and longitude swapped."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.geodesy import KNOT_M_S, difference_m

SpeedUnit = Literal["kn", "m/s", "km/h", "0.1 kn"]
TENTHS = "0.1 kn"
SPEED_KN: dict[str, float] = {"kn": 1.0, "m/s": 1.0 / KNOT_M_S, "km/h": 1.0 / 1.852, TENTHS: 0.1}
"""Knots of each unit of speed."""
ROWS = 200_000  # of a file that are looked at
LEAST_SPEED_M_S = 1.0  # stated; slower tracks do not count
LONGEST_GAP_S = 300.0  # between two positions of a track
LEAST_PATH_M, LEAST_STEPS, LEAST_TRACKS = 200.0, 5, 5
TOLERANCE = 0.03  # of the median ratio, to be that of a unit
FAR = 0.1  # the median ratio from 1, to be doubted where it is that of no unit
SPREAD = 0.1  # of the median: half of the tracks lie within it


def doubts(track: Ints, time_s: Floats, position_deg: Floats, velocity_m_s: Floats, unit: str, source: str) -> tuple[str, ...]:
    """What looks wrong about the speeds or positions of a table, in sentences; nothing where tracks are few or disagree.

    Each track has one ratio: the least-squares factor from its stated displacements to those of its positions. Errors of
    positions do not shift it.

    Args: track: (M,) its number; velocity_m_s: (M, 2) east, north, as stated, NaN: not stated; unit: of SPEED_KN, in which the
    stated speeds were taken; source: what says them: "SOG", whose unit is a setting, or "the velocity", whose unit is not.
    """
    order = np.lexsort((time_s[:ROWS], track[:ROWS]))
    track, time_s, position_deg, velocity_m_s = track[order], time_s[order], position_deg[order], velocity_m_s[order]
    gap_s = np.diff(time_s)
    swift = np.hypot(*velocity_m_s.T) >= LEAST_SPEED_M_S  # False for NaN
    steps = (track[1:] == track[:-1]) & (gap_s > 0.0) & (gap_s <= LONGEST_GAP_S) & swift[1:] & swift[:-1]
    stated_m = 0.5 * (velocity_m_s[1:] + velocity_m_s[:-1])[steps] * gap_s[steps, None]
    number = np.cumsum(np.concatenate([[0], np.diff(track) != 0]))[1:][steps] if len(track) else track
    before, after = position_deg[:-1][steps], position_deg[1:][steps]
    median, tracks = _ratio(number, stated_m, difference_m(after, before))
    if np.isfinite(median):
        return _unit_doubts(median, tracks, unit, source)
    if (np.abs(position_deg) <= HIGHEST_LATITUDE_DEG).all():
        median, tracks = _ratio(number, stated_m, difference_m(after[:, ::-1], before[:, ::-1]))
        if abs(median - 1.0) <= TOLERANCE:
            return (
                f"the positions of {tracks} tracks move as {source} and course say only with latitude and longitude exchanged: are they "
                "swapped? --columns latitude=THEIR-LONGITUDE,longitude=THEIR-LATITUDE",
            )
    return ()


def _unit_doubts(median: float, tracks: int, unit: str, source: str) -> tuple[str, ...]:
    """The doubt about the unit of speed, none where the ratio is about 1."""
    sizes = {other: size / SPEED_KN[unit] for other, size in SPEED_KN.items() if other != unit}
    other = next((other for other, size in sizes.items() if abs(median / size - 1.0) <= TOLERANCE), None)
    if other is None and abs(median - 1.0) <= FAR:
        return ()
    said = f"the positions move {median:.2f} times as fast as {source} says (median of {tracks} tracks): "
    if other is None:
        return (f"{said}in which unit is it? needed {unit}",)
    setting = f"input.speed_unit={other}"
    setting = f'"{setting}"' if " " in other else setting
    mend = f"--set {setting}" if source == "SOG" else "needed m/s"
    return (f"{said}is it in {other}? {mend}",)


def _ratio(number: Ints, stated_m: Floats, moved_m: Floats) -> tuple[float, int]:
    """The median ratio of the tracks, NaN where they are few or disagree, and how many tracks it is of.

    Args: number: (S,) of the track of each step; stated_m, moved_m: (S, 2) east, north.
    """
    square = np.bincount(number, (stated_m**2).sum(axis=1))
    used = (np.bincount(number) >= LEAST_STEPS) & (np.bincount(number, np.hypot(*stated_m.T)) >= LEAST_PATH_M)
    if used.sum() < LEAST_TRACKS:
        return np.nan, 0
    ratio = np.bincount(number, (stated_m * moved_m).sum(axis=1))[used] / square[used]
    low, median, high = np.percentile(ratio, [25.0, 50.0, 75.0]).tolist()
    agree = median > 0.0 and median - low <= SPREAD * median and high - median <= SPREAD * median
    return (median if agree else np.nan), int(used.sum())
