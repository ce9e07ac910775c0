"""The high-level centre alone: tracks that come at times of their own, from anywhere."""

from contextlib import nullcontext

import numpy as np
import pytest

from coastwatch.batches import AisAlarms, AisStatics, BearingTracks, Measurements, Tracks
from coastwatch.centre import Received, run_centre, start_centre
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.threads import blocks, in_blocks, threads
from coastwatch.scenario import load_scenario
from coastwatch.stage import serial
from coastwatch.tracks import ConstantVelocity

pytestmark = pytest.mark.contract


def random_tracks(count: int, seed: int, now_s: float) -> Tracks:
    rng = np.random.default_rng([seed, 1])
    root = rng.normal(0.0, 1.0, (count, 4, 4))
    covariance = root @ root.swapaxes(1, 2) + np.eye(4)
    covariance[::7] = np.nan
    number = np.arange(count)
    position = np.column_stack([rng.uniform(-84.0, 84.0, count), rng.uniform(-180.0, 180.0, count)])
    position[: count // 4, 1] = 179.9999
    return Tracks(
        number,
        number % 3,
        now_s - rng.uniform(-2.0, 12.0, count),
        position,
        rng.normal(0.0, 12.0, (count, 2)),
        covariance,
        np.broadcast_to(25.0 * np.eye(2), (count, 2, 2)).copy(),
        np.full(count, now_s),
        np.full(count, now_s - 60.0),
        np.full(count, -1),
        number,
    )


@pytest.mark.parametrize("count", [0, 1, 500])
def test_tracks_are_moved_to_the_time_of_the_picture(count: int) -> None:
    method, now = ConstantVelocity(noise_m2_s3=0.02), 1000.0
    tracks = random_tracks(count, 4, now)
    moved = method.step(tracks, now)
    dt = now - tracks.time_s
    wanted = offset_deg(tracks.position_deg, dt[:, None] * tracks.velocity_m_s)
    assert np.abs(difference_m(moved.position_deg, wanted)).max(initial=0.0) < 0.01  # radii taken at one end, not half-way
    f = np.tile(np.eye(4), (count, 1, 1))
    f[:, 0, 2] = f[:, 1, 3] = dt
    far = np.abs(dt)[:, None, None] * 0.02 * np.eye(2)
    cubed, crossed = far * (dt**2)[:, None, None] / 3.0, far * dt[:, None, None] / 2.0
    noise = np.block([[cubed, crossed], [crossed, far]]) if count else np.zeros((0, 4, 4))
    np.testing.assert_allclose(moved.covariance, f @ tracks.covariance @ f.swapaxes(1, 2) + noise, rtol=1e-9, atol=1e-9)
    assert (moved.time_s == now).all()


def test_tracks_that_stand_at_the_time_are_passed_on() -> None:
    tracks = random_tracks(9, 5, 50.0)
    aligned = ConstantVelocity().step(tracks, 50.0)
    assert ConstantVelocity().step(aligned, 50.0) is aligned


def test_threads_change_no_bit() -> None:
    tracks = random_tracks(50_000, 6, 0.0)
    alone = ConstantVelocity().step(tracks, 0.0)
    with threads(3):
        assert len(blocks(50_000, 4096)) == 12
        together = ConstantVelocity().step(tracks, 0.0)
    assert alone.position_deg.tobytes() == together.position_deg.tobytes()
    assert alone.covariance.tobytes() == together.covariance.tobytes()
    assert in_blocks(lambda low, high: (low, high), 7) == [(0, 7)]


def test_the_centre_makes_one_vessel_of_a_radar_and_an_ais_track() -> None:
    scenario = load_scenario("context-driven-100", {"fused_tracks.method": "convex"})
    sensors = scenario.sensors()
    memory = start_centre(scenario)
    ais = sensors.ais_source
    for cycle in range(8):
        now = 3.0 * (cycle + 1)
        sent = np.array([now - 1.0, now - 2.5])
        place = offset_deg(np.array([[-23.0, -43.1]] * 2), np.column_stack([6.0 * sent, [0.0, 8.0]]))
        given = random_tracks(2, 1, now)
        tracks = Tracks(
            np.array([3, 4]),
            np.array([0, ais]),
            sent,
            place,
            np.array([[6.0, 0.0]] * 2),
            np.tile(np.diag([100.0, 100.0, 0.2, 0.2]), (2, 1, 1)),
            *(getattr(given, name) for name in ("report_covariance", "updated_s", "started_s")),
            np.array([-1, 244123456]),
            np.zeros(2, np.int64),
        )
        received = Received(tracks, Measurements.empty(), AisAlarms.empty(), BearingTracks.empty(), AisStatics.empty())
        memory, made = run_centre(scenario, sensors, memory, received, now, serial, lambda name: nullcontext())
    assert (made.tracks.time_s == now).all()
    assert len(made.picture) == 1
    assert made.picture.mmsi.tolist() == [244123456]
    off = difference_m(made.picture.position_deg, offset_deg(np.array([[-23.0, -43.1]]), np.array([[6.0 * now, 4.0]])))
    assert np.abs(off).max() < 4.1
