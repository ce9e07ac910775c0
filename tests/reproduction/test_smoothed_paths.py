"""Whole paths: of the literal multiple hypothesis tracker, smoothed as filterpy smooths each; and between states that are known."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from coastwatch.kernels.tracks.thesis_growth import process_noise
from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.track_loss import measure, path_between, smoothed
from coastwatch.scenario import load_scenario
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import Decided
from coastwatch.tracks.radar.multi_hypothesis_literal.initiation import transition

pytestmark = pytest.mark.oracle

NOISE, SIGMA_M = 1.0, 2.5
TOLERANCE = 1e-8  # relative: both solve systems of four equations


def path_of(number: int, seen: list[bool], elapsed_s: list[float]) -> tuple[Decided, np.ndarray]:
    """The filtered states of a track, and the smoothed ones by filterpy. Args: seen: which looks have a plot; elapsed_s: before each."""
    rng, count = np.random.default_rng([number, 3]), len(seen)
    one = KalmanFilter(dim_x=4, dim_z=2)
    one.H, one.R, one.P = np.eye(2, 4), SIGMA_M**2 * np.eye(2), np.diag([6.25, 6.25, 1.875, 1.875])
    mean, covariance = np.empty((count, 4)), np.empty((count, 4, 4))
    moves, noises = [transition(t) for t in elapsed_s], [process_noise(t, NOISE) for t in elapsed_s]
    for k in range(count):
        if k:
            one.predict(F=moves[k], Q=noises[k])
        if seen[k]:
            one.update(rng.normal(0.0, 40.0, (2, 1)))
        mean[k], covariance[k] = one.x[:, 0], one.P
    states, *_ = one.rts_smoother(mean[..., None], covariance, Fs=moves, Qs=noises)
    return Decided(np.full(count, number), 100.0 + np.cumsum(elapsed_s), mean, covariance), states[..., 0]


def test_each_path_is_that_of_filterpy() -> None:
    turns = [2.5] * 9
    made = [
        path_of(7, [True, False, True, True, False, False, True, True, False], turns),
        path_of(3, [True, True, False, True], [2.5, 2.5, 5.0, 2.5]),
        path_of(5, [True], [2.5]),
    ]
    path, wanted = Decided.join([path for path, _ in made]), np.concatenate([states for _, states in made])
    order = np.random.default_rng(4).permutation(len(path))
    found = smoothed(path.take(order), NOISE)
    np.testing.assert_allclose(found, wanted[order], rtol=TOLERANCE, atol=TOLERANCE)
    assert np.abs(found - path.state[order]).max() > 1.0


def test_of_no_path_there_is_none() -> None:
    assert smoothed(Decided.empty(), NOISE).shape == (0, 4)


def test_between_two_known_states_a_path_is_the_mean_of_white_acceleration() -> None:
    """The smoother of filterpy over steps of 0.25 s, between two states that it measures without error."""
    rng, step_s, seen_s = np.random.default_rng(6), 0.25, np.array([3.0, 8.0, 9.5])
    known = rng.normal(0.0, 50.0, (3, 4))
    instant_s = np.arange(3.0, 9.6, step_s)
    one = KalmanFilter(dim_x=4, dim_z=4)
    one.H, one.R, one.P, one.F = np.eye(4), 1e-10 * np.eye(4), 1e6 * np.eye(4), transition(step_s)
    one.Q = np.kron([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]], np.eye(2))
    mean, covariance = [], []
    for k, now_s in enumerate(instant_s):
        if k:
            one.predict()
        if now_s in seen_s:
            one.update(known[seen_s == now_s].T)
        mean.append(one.x.copy())
        covariance.append(one.P.copy())
    wanted, *_ = one.rts_smoother(np.array(mean), np.array(covariance))
    found = path_between(seen_s, known[:, :2], known[:, 2:], instant_s)
    np.testing.assert_allclose(found, wanted[:, :2, 0], atol=1e-3)
    straight = np.array([np.interp(instant_s, seen_s, known[:, k]) for k in range(2)]).T
    assert np.abs(found - straight).max() > 5.0


def test_of_one_state_a_path_is_its_place() -> None:
    found = path_between(np.array([4.0]), np.array([[1.0, 2.0]]), np.array([[3.0, 0.0]]), np.array([4.0]))
    np.testing.assert_array_equal(found, [[1.0, 2.0]])


def test_a_decided_path_is_scored_at_looks_without_a_plot_too() -> None:
    """Half of the looks have none. As they were shown at the time they would keep the error of the prediction."""
    settings = {
        "cycles": "38",  # eight without clutter, then thirty
        "tracks.method": "multi_hypothesis",
        "input.detection_probability": "0.5",
        "tracks.upkeep.detection.detection_probability": "0.5",
        "tracks.upkeep.new_vessels_per_m2": "1e-10",  # few tentative tracks: a tenth of the time
        "tracks.upkeep.begin_existence": "1e-6",
    }
    found = measure(load_scenario("liland-tracking", settings), 7, TrackLoss())
    assert found["rmsd_m"] < 0.6 * found["online_rmsd_m"]
    assert found["tracking"] >= found["online_tracking"]


def test_of_a_tracker_that_decides_at_once_both_paths_are_one() -> None:
    found = measure(load_scenario("liland-tracking", {"cycles": "14", "tracks.method": "vimmjipda"}), 7, TrackLoss())
    assert found["tracking"] == found["online_tracking"] > 0.5
    assert found["rmsd_m"] == found["online_rmsd_m"]
