"""Octants: every pair once, nothing lost at borders, the published form selectable."""

from __future__ import annotations

import bearing_world as bw
import numpy as np
import pytest

from coastwatch.batches import CLASSES, BearingTracks, Floats, Octants, Picture, Sensors
from coastwatch.geodesy import from_plane, to_plane, wrap_deg
from coastwatch.kernels.bearings.candidates import sector_of
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.stage import NoMemory

pytestmark = pytest.mark.contract

LITERAL = OctantSpots(overlap_deg=0.0, position_sigmas=0.0, range_margin=1.0)


def tracks_at(sensors: Sensors, sonar: Floats, bearing_deg: Floats) -> BearingTracks:
    sonar = np.asarray(sonar, np.int64)
    n = len(sonar)
    stamp, site = np.full(n, bw.START_S), sensors.sonars.site_deg[sonar]
    angle = np.radians(wrap_deg(np.asarray(bearing_deg, float)))
    ring, rows = np.zeros((n, 1)), np.arange(n)
    source = sensors.sonar_source(0) + sonar
    covariance = np.tile(np.eye(2), (n, 1, 1))
    return BearingTracks(
        rows,
        source,
        stamp,
        angle,
        stamp * 0,
        covariance,
        site,
        stamp,
        stamp,
        ring,
        ring,
        site[:, None],
        np.full(ring.shape, np.nan),
        np.zeros((n, CLASSES), np.int64),
        rows,
    )


def vessels_at(position_deg: Floats, sigma_m: float) -> Picture:
    n = len(position_deg)
    stamp, none = np.full(n, bw.START_S), np.full(n, -1)
    covariance = np.broadcast_to(np.eye(4) * sigma_m**2, (n, 4, 4)).copy()
    return Picture(np.arange(n), stamp, position_deg, np.zeros((n, 2)), covariance, stamp, stamp, none, none * 0, none)


def around(sensors: Sensors, sonar: int, direction_deg: Floats, distance_m: float) -> Floats:
    angle = np.radians(direction_deg)
    return from_plane(distance_m * np.column_stack([np.sin(angle), np.cos(angle)]), sensors.sonars.site_deg[sonar])


def pairs(octants: Octants) -> set[tuple[int, int]]:
    return set(zip(octants.bearing_row.tolist(), octants.vessel_row.tolist(), strict=True))


def test_the_published_octants_are_sectors_within_range() -> None:
    rng = np.random.default_rng([2, 1])
    sensors = bw.sensors_of(np.array([[0.0, 0.0], [3000.0, 2000.0]]), 6000.0, (0.0, 360.0))
    where = from_plane(rng.uniform(-9000.0, 9000.0, (300, 2)), bw.ORIGIN_DEG)
    tracks = tracks_at(sensors, np.arange(30) % 2, rng.uniform(0.0, 360.0, 30))
    _, octants = LITERAL.step(NoMemory(), OctantInput(tracks, vessels_at(where, 10.0), sensors))
    expected = set()
    for b in range(30):
        off = to_plane(where, sensors.sonars.site_deg[b % 2])
        inside = np.hypot(*off.T) <= 6000.0
        direction = np.degrees(np.arctan2(off[:, 0], off[:, 1])) % 360.0
        own = np.degrees(tracks.bearing_rad[b]) % 360.0
        expected |= {(b, int(v)) for v in np.flatnonzero(inside & (direction // 45.0 == own // 45.0))}
    assert pairs(octants) == expected
    assert len(expected) == len(octants.bearing_row)
    assert (
        octants.octant
        == np.arange(30)[octants.bearing_row] % 2 * 8 + sector_of(np.degrees(tracks.bearing_rad))[octants.bearing_row]
    ).all()
    order = np.lexsort((octants.vessel_row, octants.bearing_row))
    assert (order == np.arange(len(order))).all()


def test_overlap_keeps_every_pair_no_farther_apart_than_it() -> None:
    rng = np.random.default_rng([2, 2])
    sensors = bw.centre()
    direction = rng.uniform(0.0, 360.0, 400)
    where = around(sensors, 0, direction, 4000.0)
    said = direction + rng.uniform(-6.0, 6.0, 400)
    tracks = tracks_at(sensors, np.zeros(400), said)
    _, octants = OctantSpots().step(NoMemory(), OctantInput(tracks, vessels_at(where, 0.0), sensors))
    found = pairs(octants)
    assert {(k, k) for k in range(400)} <= found
    assert len(found) == len(octants.bearing_row)  # each once, though vessels stand in two octants
    lost = {(k, k) for k in range(400)} - pairs(
        LITERAL.step(NoMemory(), OctantInput(tracks, vessels_at(where, 0.0), sensors))[1]
    )
    assert len(lost) > 10


def test_position_uncertainty_widens_octants_and_range() -> None:
    sensors = bw.sensors_of(np.zeros((1, 2)), 5000.0, (0.0, 360.0))
    tracks = tracks_at(sensors, [0], [10.0])
    near_border = around(sensors, 0, np.array([60.0]), 300.0)  # 15 deg outside: 80 m
    for sigma, count in ((1.0, 0), (30.0, 1)):
        assert (
            len(OctantSpots().step(NoMemory(), OctantInput(tracks, vessels_at(near_border, sigma), sensors))[1].octant) == count
        )
    beyond = around(sensors, 0, np.array([10.0]), 5400.0)
    for sigma, count in ((1.0, 0), (60.0, 1)):
        assert len(OctantSpots().step(NoMemory(), OctantInput(tracks, vessels_at(beyond, sigma), sensors))[1].octant) == count


def test_a_moving_sensor_looks_from_where_it_is() -> None:
    sensors = bw.sensors_of(np.zeros((1, 2)), 3000.0, (0.0, 360.0))
    there = bw.sensors_of(np.array([[30_000.0, 0.0]]), 3000.0, (0.0, 360.0))
    tracks = tracks_at(there, [0], [100.0])
    where = around(there, 0, np.array([100.0]), 2000.0)
    assert len(OctantSpots().step(NoMemory(), OctantInput(tracks, vessels_at(where, 5.0), sensors))[1].octant) == 1


def test_empties() -> None:
    sensors = bw.centre()
    none = from_plane(np.zeros((0, 2)), bw.ORIGIN_DEG)
    some = around(sensors, 0, np.array([10.0]), 1000.0)
    for sonar, where in (([], none), ([], some), ([0], none)):
        memory, octants = OctantSpots().step(
            NoMemory(), OctantInput(tracks_at(sensors, sonar, [10.0] * len(sonar)), vessels_at(where, 5.0), sensors)
        )
        assert memory == NoMemory()
        assert len(octants.octant) == 0
    unknown = vessels_at(some, np.nan)
    assert len(OctantSpots().step(NoMemory(), OctantInput(tracks_at(sensors, [0], [10.0]), unknown, sensors))[1].octant) == 1


def test_with_a_known_bias_the_pairs_are_those_of_a_sensor_without_one() -> None:
    sensors = bw.centre()
    picture = bw.make_world(60, 10, 3).picture(5)
    true_deg = np.linspace(0.3, 359.3, 90)
    right = tracks_at(sensors, np.zeros(90), true_deg)
    turned = tracks_at(sensors, np.zeros(90), true_deg + 12.0)
    _, wanted = OctantSpots().step(NoMemory(), OctantInput(right, picture, sensors))
    _, found = OctantSpots().step(NoMemory(), OctantInput(turned, picture, sensors, np.radians([12.0])))
    np.testing.assert_array_equal(found.bearing_row, wanted.bearing_row)
    np.testing.assert_array_equal(found.vessel_row, wanted.vessel_row)
    _, unaware = OctantSpots().step(NoMemory(), OctantInput(turned, picture, sensors))
    assert unaware.vessel_row.tolist() != wanted.vessel_row.tolist()
