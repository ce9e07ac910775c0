"""Whole paths of the literal multiple hypothesis tracker, smoothed: as filterpy smooths each, whatever the order of their states."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from coastwatch.kernels.tracks.thesis_growth import process_noise
from coastwatch.reproduction.track_loss import smoothed
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
