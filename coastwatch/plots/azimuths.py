"""Azimuths that a radar counts from magnetic north or from the bow of its ship, made true."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from coastwatch.batches import AzimuthReference, Floats, HeadingReports, Ints, Radars, Reports, Videos

OLDEST_S = 5.0
"""Between an echo and the heading that it is turned by; without one so near it is left out."""

RATE_S = 2.0
"""The ship turns on after its newest heading as in so long before it."""

KEPT_S = 60.0
"""For so long headings are kept: video may come so late."""

TURN_RAD = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class HeadingMemory:
    """The headings of the last minute, and how many plots and spokes were left out for want of one since the start."""

    headings: HeadingReports = field(default_factory=HeadingReports.empty)
    left_out: int = 0


def true_azimuths(memory: HeadingMemory, reports: Reports, radars: Radars) -> tuple[HeadingMemory, Reports]:
    """The reports with true azimuths of plots and video. Those of a ship without a heading near their time are left out."""
    if not (len(radars) and (radars.azimuth_reference > AzimuthReference.TRUE).any()):
        return memory, reports
    headings = memory.headings
    if len(reports.headings):
        headings = HeadingReports.join([headings, reports.headings])
        headings = headings.take(headings.time_s > headings.time_s.max() - KEPT_S)
    plots = reports.radar
    zero_rad = zero_azimuths(radars, headings, plots.sensor, plots.time_s)
    plots = replace(plots, azimuth_deg=(plots.azimuth_deg + np.degrees(zero_rad)) % 360.0).take(np.isfinite(zero_rad))
    video = true_video(radars, headings, reports.video)
    left_out = int(np.isnan(zero_rad).sum()) + len(reports.video) - len(video)
    return HeadingMemory(headings, memory.left_out + left_out), replace(reports, radar=plots, video=video)


def true_video(radars: Radars, headings: HeadingReports, video: Videos) -> Videos:
    """Video with true azimuths, without the spokes of a ship that have no heading near their time."""
    parts = []
    for part in video.parts:
        zero_rad = zero_azimuths(radars, headings, np.full(len(part), part.sensor), part.time_s)
        if zero_rad.any():
            part = replace(part, azimuth_rad=(part.azimuth_rad + zero_rad) % TURN_RAD).take(np.isfinite(zero_rad))
        parts.append(part)
    return Videos(tuple(parts))


def zero_azimuths(radars: Radars, headings: HeadingReports, radar: Ints, time_s: Floats) -> Floats:
    """Where azimuth 0 of a radar points, clockwise from true north; NaN: not known, 0: no radar.

    Args: radar, time_s: (M,). Returns: (M,), rad.
    """
    zero_rad = np.zeros(len(radar))
    for magnetic in np.flatnonzero(radars.azimuth_reference == AzimuthReference.MAGNETIC):
        zero_rad[radar == magnetic] = radars.variation_rad[magnetic]
    for ship in np.flatnonzero(radars.azimuth_reference == AzimuthReference.HEADING):
        rows = np.flatnonzero(radar == ship)
        if len(rows):
            zero_rad[rows] = heading_at(headings.take(headings.sensor == ship), time_s[rows])
    return zero_rad


def heading_at(headings: HeadingReports, time_s: Floats) -> Floats:
    """The heading of one ship, linear between its reports and after the newest one; NaN where none is within `OLDEST_S`. (M,) rad."""
    known_s, first = np.unique(headings.time_s, return_index=True)
    if not len(known_s):
        return np.full(len(time_s), np.nan)
    heading = np.unwrap(np.radians(headings.heading_deg[first]))
    at = np.interp(time_s, known_s, heading)
    before = int(np.searchsorted(known_s, known_s[-1] - RATE_S))
    if before < len(known_s) - 1:
        rate = (heading[-1] - heading[before]) / (known_s[-1] - known_s[before])
        at += rate * np.maximum(time_s - known_s[-1], 0.0)
    after = np.searchsorted(known_s, time_s)
    last = len(known_s) - 1
    off_s = np.minimum(np.abs(time_s - known_s[np.clip(after - 1, 0, last)]), np.abs(known_s[np.clip(after, 0, last)] - time_s))
    return np.where(off_s <= OLDEST_S, at, np.nan)
