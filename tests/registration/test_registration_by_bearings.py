"""The lag of a radar from a camera beside it: no AIS, vessels that pass close by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import registration_world as world

from coastwatch.batches import (
    CLASSES,
    AisAlarms,
    Array,
    BearingAssociations,
    BearingTracks,
    Floats,
    Measurements,
    Members,
    Picture,
    Plots,
    RadarCorrections,
    Sensors,
    Sonars,
    Tracks,
)
from coastwatch.geodesy import from_plane
from coastwatch.registration import OnlineRegistration, RegistrationInput
from coastwatch.registration.bearings import WaitingPlots, bearing_equations

pytestmark = pytest.mark.contract

VESSELS, LAG_S, CAMERA_BIAS = 5, 1.6, np.radians(4.0)
CAMERA_SIGMA = np.radians(0.5)
SLOT_S, SLOTS = 3.0, 20
SIGMAS = 4.5


def place(seed: int, time_s: Array) -> Floats:
    """(..., V, 2) m: vessels that pass the site at 100 to 300 m, one after the other."""
    rng = np.random.default_rng([seed, 1])
    beside, course = rng.uniform(100, 300, VESSELS), rng.uniform(0, 2 * np.pi, VESSELS)
    when, speed = rng.uniform(30, 150, VESSELS), rng.uniform(4, 8, VESSELS)
    along = (time_s[..., None] - world.START_S - when) * speed
    way = np.stack([np.sin(course), np.cos(course)], -1)
    return beside[:, None] * way[:, ::-1] * [1, -1] + along[..., None] * way


def azimuth(at: Floats) -> Floats:
    return np.asarray(np.arctan2(at[..., 0], at[..., 1]))


def sensors() -> Sensors:
    one = np.ones(1)
    beside = world.sensors()
    camera = Sonars(
        np.array(["camera"]), world.CENTRE[None], 3000.0 * one, CAMERA_SIGMA * one, 0.2 * one, 0.0 * one, 360.0 * one
    )
    return Sensors(beside.radars, beside.stations, camera, beside.region_names, beside.region_origin_deg)


def seen(seed: int, cycle: int, lag_s: float, given: RadarCorrections) -> Any:
    """What registration is given in a cycle of 3 s: the plots of tracks, the picture, and the window of bearings behind it."""
    rng = np.random.default_rng([seed, 2, cycle])
    now, number = world.START_S + 3.0 * (cycle + 1), np.arange(VESSELS)
    stamp = np.full(VESSELS, now - 1.0)
    at = place(seed, stamp[0] - lag_s)
    noisy = azimuth(at) + world.AZIMUTH_SIGMA * rng.standard_normal(VESSELS)
    spot = np.hypot(at[:, 0], at[:, 1])[:, None] * np.stack([np.sin(noisy), np.cos(noisy)], -1)
    nan = np.full((VESSELS, 4, 4), np.nan)
    site = np.tile(world.CENTRE, (VESSELS, 1))
    plots = Measurements(
        number,
        number * 0,
        stamp - given.time_lag_s[0],
        from_plane(spot, world.CENTRE),
        np.full((VESSELS, 2), np.nan),
        nan,
        site,
    )
    time, zero = np.full(VESSELS, now), np.zeros((VESSELS, 2))
    picture = Picture(number + 1, time, site, zero, nan, time, time, number * 0 - 1, number * 0, number)
    slot_s = world.START_S + SLOT_S * (np.arange(cycle + 1 - SLOTS, cycle + 1) + 0.5)
    noise = np.stack(
        [np.random.default_rng([seed, 3, k + 1000]).standard_normal(VESSELS) for k in range(cycle + 1 - SLOTS, cycle + 1)]
    )
    angle = (azimuth(place(seed, slot_s)) + CAMERA_BIAS + CAMERA_SIGMA * noise / np.sqrt(5.0)).T
    window = np.where(slot_s > world.START_S, slot_s, np.nan) * np.ones((VESSELS, 1))
    bearings = BearingTracks(
        number + 2**41, number * 0 + 2, time, angle[:, -1], angle[:, -1] * 0, np.zeros((VESSELS, 2, 2)), site, time, time, window, angle,
        np.tile(world.CENTRE, (VESSELS, SLOTS, 1)), np.full(angle.shape, np.nan), np.zeros((VESSELS, CLASSES), np.int64), number,
    )  # fmt: skip
    both = BearingAssociations(number, number, np.ones(VESSELS), np.zeros(1))
    return (plots, picture, Members(number + 1, number, number * 0), bearings, both), now


def run(seed: int, lag_s: float, cycles: int = 60) -> RadarCorrections:
    method, where = OnlineRegistration(), sensors()
    memory, given = method.init(), RadarCorrections.empty(R=1)
    for cycle in range(cycles):
        said, now = seen(seed, cycle, lag_s, given)
        nobody = (Plots.empty(), Tracks.empty(), AisAlarms.empty())
        memory, given = method.step(memory, RegistrationInput(*nobody, *said, now, where, given))
    return given


@pytest.mark.parametrize("lag_s", [0.0, LAG_S])
def test_a_lag_is_found_and_the_bias_of_the_camera_is_none_of_the_radar(lag_s: float) -> None:
    for seed in range(3):
        given = run(seed, lag_s)
        assert abs(given.estimated_lag_s[0] - lag_s) < SIGMAS * given.lag_sigma_s[0]
        assert given.lag_sigma_s[0] < 0.4
        assert given.azimuth_bias_rad[0] == 0.0
        assert np.isnan(given.azimuth_sigma_rad[0])


def test_bearings_that_could_be_confused_are_left_out() -> None:
    said, _ = seen(1, 30, LAG_S, RadarCorrections.empty(R=1))
    plots, picture, members, bearings, both = said
    number = plots.sensor
    waiting = WaitingPlots(plots.track_id, number, plots.time_s - 10.0, np.zeros(VESSELS), plots.position_deg)
    nobody = Plots.empty(), Tracks.empty(), AisAlarms.empty(), Measurements.empty()
    corrections = RadarCorrections.empty(R=1)
    given = RegistrationInput(*nobody, picture, members, bearings, both, 0.0, sensors(), corrections)
    left, rows = bearing_equations(waiting, given)
    near = np.abs(np.subtract.outer(bearings.bearing_rad, bearings.bearing_rad)) + 10.0 * np.eye(VESSELS)
    clear = near.min(axis=1) > 3.0 * CAMERA_SIGMA
    assert len(rows) == clear.sum() > 0
    assert len(left) == VESSELS - len(rows)
