"""The fixed-lag smoother against filterpy's Rauch-Tung-Striebel smoother, and what it does with gaps and turning filters."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from coastwatch import kernels
from coastwatch.kernels.filters.smoothing import Steps

pytestmark = pytest.mark.oracle

NOISE = 0.05  # m2/s3
SIGMA_M = 8.0
TOLERANCE = 1e-8  # relative: both solve systems of four equations


def transition(dt):
    """Constant velocity of east, north, and their rates."""
    return np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))


def filtered(seed, count):
    """The steps of a Kalman filter over unequal times, and the smoothed states by filterpy."""
    rng = np.random.default_rng([seed, 1])
    dt = rng.uniform(0.5, 9.0, count)
    noise = [np.kron(NOISE * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]]), np.eye(2)) for t in dt]
    one = KalmanFilter(dim_x=4, dim_z=2)
    one.H, one.R, one.P = np.eye(2, 4), SIGMA_M**2 * np.eye(2), np.diag([64.0, 64.0, 16.0, 16.0])
    after, before = [], []
    for k in range(count):
        one.predict(F=transition(dt[k]), Q=noise[k])
        before.append((one.x[:, 0].copy(), one.P.copy()))
        one.update(rng.normal(0.0, 60.0, (2, 1)))
        after.append((one.x[:, 0].copy(), one.P.copy()))
    mean, covariance = (np.array(column) for column in zip(*after, strict=True))
    smoothed, spread, *_ = one.rts_smoother(mean[..., None], covariance, Fs=[transition(t) for t in dt], Qs=noise)
    predicted = (np.array(column) for column in zip(*before, strict=True))
    return Steps(np.cumsum(dt), mean, covariance, *predicted), smoothed[..., 0], spread


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_first_state_of_a_path_is_that_of_filterpy(count):
    steps, smoothed, spread = filtered(count, count)
    mean, covariance = kernels.filters.smoothing.fixed_lag(steps, np.arange(count)[None])
    np.testing.assert_allclose(mean[0], smoothed[0], rtol=TOLERANCE, atol=TOLERANCE)
    np.testing.assert_allclose(covariance[0], spread[0], rtol=TOLERANCE, atol=TOLERANCE)


def test_gaps_and_the_order_of_steps_do_not_matter():
    steps, smoothed, _ = filtered(7, 4)
    order = np.array([2, 0, 3, 1])
    shuffled = Steps(*(column[np.argsort(order)] for column in steps))
    mean, _ = kernels.filters.smoothing.fixed_lag(shuffled, np.array([[2, -1, 0, 3, -1, 1], [3, 1, -1, -1, -1, -1]]))
    np.testing.assert_allclose(mean[0], smoothed[0], rtol=TOLERANCE, atol=TOLERANCE)
    last, _ = kernels.filters.smoothing.fixed_lag(steps, np.array([[2, 3]]))
    np.testing.assert_allclose(mean[1], last[0], rtol=TOLERANCE, atol=TOLERANCE)


def test_no_path_gives_no_state():
    steps, *_ = filtered(3, 2)
    mean, covariance = kernels.filters.smoothing.fixed_lag(steps, np.zeros((0, 4), np.int64))
    assert mean.shape == (0, 4)
    assert covariance.shape == (0, 4, 4)


@pytest.mark.parametrize("later", [1, 2])
def test_a_step_whose_prediction_has_no_inverse_leaves_the_estimate_of_the_filter(later):
    """The step before the broken one begins again: what comes before is smoothed from there."""
    steps, *_ = filtered(5, 3)
    broken = steps._replace(predicted_covariance=steps.predicted_covariance.copy())
    broken.predicted_covariance[later] *= -1.0
    mean, covariance = kernels.filters.smoothing.fixed_lag(broken, np.arange(3)[None])
    want, spread = kernels.filters.smoothing.fixed_lag(steps, np.arange(later)[None])
    np.testing.assert_array_equal(mean, want)
    np.testing.assert_array_equal(covariance, spread)


def test_a_covariance_stays_positive_where_the_filter_was_surer_than_constant_velocity_allows():
    steps, *_ = filtered(5, 3)
    surer = steps._replace(predicted_covariance=0.01 * steps.predicted_covariance)
    mean, covariance = kernels.filters.smoothing.fixed_lag(surer, np.arange(3)[None])
    assert np.isfinite(mean).all()
    assert (np.linalg.eigvalsh(covariance[0]) > 0.0).all()
