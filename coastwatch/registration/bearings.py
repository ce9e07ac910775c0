"""The time lag of a radar from bearings of cameras and sonars.

The time stamps of cameras are assumed right. A radar that stamps late gives a bearing that the vessel had earlier. The difference
is proportional to the bearing rate. A constant difference is not used, because a camera may have a bias of degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Batch,
    BearingAssociations,
    BearingTracks,
    Bools,
    Floats,
    Ints,
    Members,
    Picture,
    Sensors,
    column,
)
from coastwatch.geodesy import to_plane, wrap_rad
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.registration.information import Equations
from coastwatch.registration.inputs import RegistrationInput

BEARINGS = 4  # around a plot, through which a parabola is fitted
LONGEST_WINDOW_S = 20.0  # from the first to the last of them
LONGEST_WAIT_S = 30.0  # for which a plot waits for bearings newer than itself
UNAMBIGUOUS_SIGMAS = 3.0  # of a bearing, between two tracks of a sensor that cannot be confused
CONSTANT_SIGMAS = 1e3  # of an equation: by so much camera and radar may differ all the time


@dataclass(frozen=True, eq=False)
class WaitingPlots(Batch):
    """Plots of radar tracks that wait for bearings newer than themselves."""

    track_id: Ints = column(np.int64, "M")
    radar: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")  # as stamped, less the lag known then
    taken_lag_s: Floats = column(np.float64, "M")
    position_deg: Floats = column(np.float64, "M", 2)


def waiting_plots(waiting: WaitingPlots, given: RegistrationInput, unsure: Bools) -> WaitingPlots:
    """The plots of this cycle whose vessel has a bearing, after those that still wait.

    Args: unsure: (R,) radars whose lag is not known well; plots of others are left out.
    """
    measurements, picture, members = given.measurements, given.picture, given.members
    row = np.flatnonzero(measurements.sensor >= 0)
    row = row[unsure[measurements.sensor[row]]]
    if len(row):
        associated = members.track_id[np.isin(members.vessel_id, picture.vessel_id[given.bearing_associations.vessel_row])]
        row = row[kernels.tables.match_ids.index_of(associated, measurements.track_id[row]) >= 0]
    plots = measurements.take(row)
    lag_s = given.corrections.time_lag_s[plots.sensor]
    fresh = WaitingPlots(plots.track_id, plots.sensor, plots.time_s, lag_s, plots.position_deg)
    return WaitingPlots.join([waiting.take(waiting.time_s >= given.time_s - LONGEST_WAIT_S), fresh])


def bearing_equations(waiting: WaitingPlots, given: RegistrationInput) -> tuple[WaitingPlots, Equations]:
    """The plots that still wait, and equations for those that have bearings of their vessel before and after them."""
    bearing_tracks, sensors = given.bearing_tracks, given.sensors
    if not len(waiting):
        return waiting, Equations.empty()
    plot, bearing = _pair_with_bearings(waiting, given.picture, given.members, given.bearing_associations)
    unambiguous = _unambiguous(bearing_tracks, sensors)[bearing]
    plot, bearing = plot[unambiguous], bearing[unambiguous]
    first, ready = _bearings_around(bearing_tracks, bearing, waiting.time_s[plot])
    plot, bearing, first = plot[ready], bearing[ready], first[ready]
    used = np.zeros(len(waiting), np.bool_)
    used[plot] = True
    index = first[:, None] + np.arange(BEARINGS)
    at_s = bearing_tracks.window_time_s[bearing[:, None], index] - waiting.time_s[plot][:, None]
    angle = bearing_tracks.window_bearing_rad[bearing[:, None], index]
    middle = angle[:, :1]
    fitted, rate = _parabola(at_s, wrap_rad(angle - middle))
    site = bearing_tracks.window_site_deg[bearing[:, None], index]
    site_change, _ = _parabola(at_s[:, :, None], site - site[:, :1])
    east_north = to_plane(waiting.position_deg[plot], site[:, 0] + site_change)
    azimuth = np.arctan2(east_north[:, 0], east_north[:, 1])
    residual = np.asarray(wrap_rad(azimuth - middle[:, 0] - fitted))
    camera = bearing_tracks.source[bearing] - sensors.sonar_source(0)
    radar = waiting.radar[plot]
    sigma = np.hypot(sensors.sonars.bearing_sigma_rad[camera], sensors.radars.azimuth_sigma_rad[radar])
    zero = np.zeros(len(plot))
    return waiting.take(~used), Equations(
        radar=radar,
        reference=bearing_tracks.track_id[bearing],
        design=np.column_stack([zero, zero, -rate / sigma, zero, zero, zero]),
        offset=np.column_stack([zero, np.full(len(plot), CONSTANT_SIGMAS)]),
        value=(residual - rate * waiting.taken_lag_s[plot]) / sigma,
        weight=np.ones(len(plot)),
    )


def _pair_with_bearings(
    waiting: WaitingPlots, picture: Picture, members: Members, associations: BearingAssociations
) -> tuple[Ints, Ints]:
    """Pairs of a waiting plot and a bearing track that are of one vessel, sorted by plot."""
    vessel = np.append(members.vessel_id, -1)[row_of(members.track_id, waiting.track_id)]
    vessel_of_bearing = picture.vessel_id[associations.vessel_row]
    order = np.argsort(vessel_of_bearing, kind="stable")
    first = np.searchsorted(vessel_of_bearing[order], vessel)
    count = np.where(vessel >= 0, np.searchsorted(vessel_of_bearing[order], vessel, side="right") - first, 0)
    plot = np.repeat(np.arange(len(waiting)), count)
    return plot, associations.bearing_row[order][kernels.tables.groups.ranges(first, count)]


def _unambiguous(tracks: BearingTracks, sensors: Sensors) -> Bools:
    """Which bearing tracks have no other of their sensor so near that they could be confused. (N,)"""
    sensor = tracks.source - sensors.sonar_source(0)
    order = np.lexsort((tracks.bearing_rad, sensor))
    angle, own_sensor = tracks.bearing_rad[order], sensor[order]
    count = np.bincount(own_sensor, minlength=len(sensors.sonars))
    start = (np.cumsum(count) - count)[own_sensor]
    place = np.arange(len(order)) - start
    after = start + (place + 1) % count[own_sensor]
    gap = np.where(count[own_sensor] > 1, np.abs(wrap_rad(angle[after] - angle)), np.inf)
    before = start + (place - 1) % count[own_sensor]
    near = np.minimum(gap, gap[before])
    is_unambiguous = np.zeros(len(tracks), np.bool_)
    is_unambiguous[order] = near > UNAMBIGUOUS_SIGMAS * sensors.sonars.bearing_sigma_rad[own_sensor]
    return is_unambiguous


def _bearings_around(tracks: BearingTracks, bearing: Ints, time_s: Floats) -> tuple[Ints, Bools]:
    """The first of the bearings around each time, as many before as after, and whether all of them are there and close."""
    window = tracks.window_time_s[bearing]
    length = window.shape[1]
    before = length - (window > time_s[:, None]).sum(axis=1)  # NaN stands first
    first = np.clip(before - BEARINGS // 2, 0, max(length - BEARINGS, 0))
    if length < BEARINGS:
        return first, np.zeros(len(first), np.bool_)
    ends = np.take_along_axis(window, np.column_stack([first, first + BEARINGS - 1]), axis=1)
    with np.errstate(invalid="ignore"):
        good: Bools = (before + BEARINGS // 2 <= length) & (ends[:, 1] - ends[:, 0] <= LONGEST_WINDOW_S)
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
