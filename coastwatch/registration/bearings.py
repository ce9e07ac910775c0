"""Radar plots against bearings of cameras and sonars: what they say of a radar's time lag.

A camera tells a vessel's bearing at its own, prompt, time; a radar that stamps late tells where the vessel was before. The
difference grows with how fast the bearing changes. Its constant part is left out: a camera's own bias is of degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import (
    Batch,
    BearingAssociations,
    BearingTracks,
    Bools,
    Floats,
    Ints,
    Measurements,
    Members,
    Picture,
    RadarCorrections,
    Sensors,
    column,
)
from coastwatch.geodesy import to_plane, wrap_rad
from coastwatch.kernels.tables.lookup import find
from coastwatch.registration.evidence import Rows

SLOTS = 4  # of a window of bearings around a plot, through which a parabola is drawn
LONGEST_S = 20.0  # from the first to the last of them
PATIENCE_S = 30.0  # for which a plot waits for bearings newer than itself
APART = 3.0  # standard deviations of a bearing between two tracks of a sensor that cannot be confused
SHARED = 1e3  # standard deviations of a row by which camera and radar may differ all the time


@dataclass(frozen=True, eq=False)
class Waiting(Batch):
    """Plots of radar tracks that wait for bearings newer than themselves."""

    track_id: Ints = column(np.int64, "M")
    radar: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")  # as stamped, less the lag known then
    taken_lag_s: Floats = column(np.float64, "M")
    position_deg: Floats = column(np.float64, "M", 2)


def queue(waiting: Waiting, measurements: Measurements, given: RadarCorrections, unsure: Bools, time_s: float) -> Waiting:
    """The plots of this cycle of radars whose lag is not known well, behind those that still wait. Args: unsure: (R,)."""
    plots = measurements.take(measurements.sensor >= 0)
    plots = plots.take(unsure[plots.sensor])
    lag_s = given.time_lag_s[plots.sensor]
    fresh = Waiting(plots.track_id, plots.sensor, plots.time_s, lag_s, plots.position_deg)
    return Waiting.join([waiting.take(waiting.time_s >= time_s - PATIENCE_S), fresh])


def compare(
    waiting: Waiting,
    picture: Picture,
    members: Members,
    bearing_tracks: BearingTracks,
    found: BearingAssociations,
    sensors: Sensors,
) -> tuple[Waiting, Rows]:
    """The plots that still wait, and the equations of those for which bearings of their vessel are there on both sides of them."""
    plot, bearing = _together(waiting, picture, members, found)
    apart = _alone(bearing_tracks, sensors)[bearing]
    plot, bearing = plot[apart], bearing[apart]
    first, ready = _around(bearing_tracks, bearing, waiting.time_s[plot])
    plot, bearing, first = plot[ready], bearing[ready], first[ready]
    used = np.zeros(len(waiting), np.bool_)
    used[plot] = True
    slot = first[:, None] + np.arange(SLOTS)
    at_s = bearing_tracks.window_time_s[bearing[:, None], slot] - waiting.time_s[plot][:, None]
    angle = bearing_tracks.window_bearing_rad[bearing[:, None], slot]
    middle = angle[:, :1]
    bent, rate = _parabola(at_s, wrap_rad(angle - middle))
    site = bearing_tracks.window_site_deg[bearing[:, None], slot]
    place, _ = _parabola(at_s[:, :, None], site - site[:, :1])
    east_north = to_plane(waiting.position_deg[plot], site[:, 0] + place)
    azimuth = np.arctan2(east_north[:, 0], east_north[:, 1])
    off = np.asarray(wrap_rad(azimuth - middle[:, 0] - bent))
    camera = bearing_tracks.source[bearing] - sensors.sonar_source(0)
    radar = waiting.radar[plot]
    sigma = np.hypot(sensors.sonars.bearing_sigma_rad[camera], sensors.radars.azimuth_sigma_rad[radar])
    zero = np.zeros(len(plot))
    return waiting.take(~used), Rows(
        radar=radar,
        reference=bearing_tracks.track_id[bearing],
        design=np.column_stack([zero, zero, -rate / sigma]),
        own=np.column_stack([zero, np.full(len(plot), SHARED)]),
        value=(off - rate * waiting.taken_lag_s[plot]) / sigma,
    )


def _together(waiting: Waiting, picture: Picture, members: Members, found: BearingAssociations) -> tuple[Ints, Ints]:
    """Pairs of a waiting plot and a bearing track that are of one vessel, sorted by plot."""
    order = np.argsort(members.track_id, kind="stable")
    at = find(members.track_id[order], waiting.track_id)
    vessel = np.where(at >= 0, members.vessel_id[order][np.maximum(at, 0)] if len(order) else -1, -1)
    heard = picture.vessel_id[found.vessel_row]
    order = np.argsort(heard, kind="stable")
    first = np.searchsorted(heard[order], vessel)
    count = np.where(vessel >= 0, np.searchsorted(heard[order], vessel, side="right") - first, 0)
    plot = np.repeat(np.arange(len(waiting)), count)
    place = np.arange(len(plot)) - np.repeat(np.cumsum(count) - count - first, count)
    return plot, found.bearing_row[order][place]


def _alone(tracks: BearingTracks, sensors: Sensors) -> Bools:
    """Which bearing tracks have no other of their sensor so near that they could be taken for each other. (N,)"""
    sensor = tracks.source - sensors.sonar_source(0)
    order = np.lexsort((tracks.bearing_rad, sensor))
    angle, of = tracks.bearing_rad[order], sensor[order]
    count = np.bincount(of, minlength=len(sensors.sonars))
    start = (np.cumsum(count) - count)[of]
    place = np.arange(len(order)) - start
    after = start + (place + 1) % count[of]
    gap = np.where(count[of] > 1, np.abs(wrap_rad(angle[after] - angle)), np.inf)
    before = start + (place - 1) % count[of]
    near = np.minimum(gap, gap[before])
    out = np.zeros(len(tracks), np.bool_)
    out[order] = near > APART * sensors.sonars.bearing_sigma_rad[of]
    return out


def _around(tracks: BearingTracks, bearing: Ints, time_s: Floats) -> tuple[Ints, Bools]:
    """The first of the slots around each time, as many before as after, and whether all of them are there and close."""
    window = tracks.window_time_s[bearing]
    length = window.shape[1]
    before = length - (window > time_s[:, None]).sum(axis=1)  # slots with NaN stand first
    first = np.clip(before - SLOTS // 2, 0, max(length - SLOTS, 0))
    if length < SLOTS:
        return first, np.zeros(len(first), np.bool_)
    ends = np.take_along_axis(window, np.column_stack([first, first + SLOTS - 1]), axis=1)
    with np.errstate(invalid="ignore"):
        good: Bools = (before + SLOTS // 2 <= length) & (ends[:, 1] - ends[:, 0] <= LONGEST_S)
    return first, good


def _parabola(time_s: Floats, value: Floats) -> tuple[Floats, Floats]:
    """Value and slope at time 0 of the least squares parabola. Args: (M, S) and (M, S), or (M, S, 1) and (M, S, d)."""
    flat = value[:, :, None] if value.ndim == 2 else value
    t = time_s if time_s.ndim == 2 else time_s[:, :, 0]
    powers = np.stack([np.ones_like(t), t, t**2], axis=2)
    across = powers.swapaxes(1, 2)
    fit = np.linalg.solve(across @ powers, across @ flat) if len(t) else np.zeros((0, 3, flat.shape[2]))
    at, slope = np.asarray(fit[:, 0], np.float64), np.asarray(fit[:, 1], np.float64)
    return (at[:, 0], slope[:, 0]) if value.ndim == 2 else (at, slope)
