"""The IMM kernel against the textbook and filterpy, and that a row does not depend on its neighbours."""

from __future__ import annotations

import imm_textbook as textbook
import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given, strategies as st

from coastwatch.kernels.filters import motion_models
from coastwatch.kernels.filters.imm import FLOOR, estimate_filters, predict_filters, update_filters

pytestmark = pytest.mark.oracle

ROUNDING = 1e-9  # relative to the largest element of its kind: condition numbers here are below 1e6
NUMERIC_JACOBIAN = 2e-6  # relative: the oracle takes derivatives by differences


def bank(n: int, j: int, seed: int):
    """Random filters, and models with unlike settings, so that a transposed transition shows."""
    rng = np.random.default_rng([seed, 7])
    scale = np.array([50.0, 50.0, 4.0, 4.0, 0.01])
    x = rng.normal(size=(n, j, 5)) * scale * 5.0
    a = rng.normal(size=(n, j, 5, 7)) * scale[:, None]
    mode = rng.dirichlet(np.ones(j), n).reshape(n, j) * (1.0 - j * 1e-6) + 1e-6
    kind = np.arange(j)[::-1] % 2
    models = (kind, 10.0 ** rng.uniform(-4, 0, j), 10.0 ** rng.uniform(-9, -5, j), rng.uniform(0.001, 0.05, j))
    return x, a @ a.swapaxes(-1, -2), mode, (*models, rng.uniform(2.0, 90.0, j))


def table(kind, noise, turn_noise, turn_sigma, sojourn):
    """These models as the kernels take them; a kind of the oracle is STRAIGHT or TURNING."""
    return motion_models.table(
        kind=kind, noise=noise, manoeuvre_noise=turn_noise, manoeuvre_sigma=turn_sigma, sojourn=sojourn, prior_probability=1.0
    )


def imm_predict(x, p, mode, dt, *models):
    return predict_filters(x, p, mode, dt, np.inf, table(*models))


def one_model(x, dt, kind, noise, turn_noise, turn_sigma):
    """One state moved by one model: the state, its Jacobian F and the process noise Q."""
    model = table(np.array([kind]), noise, turn_noise, turn_sigma, 1.0)[0]
    moved, jacobian, q = x.copy(), np.eye(5), np.zeros((5, 5))
    motion_models.move(model, moved, dt, jacobian)
    motion_models.add_process_noise(model, dt, q)
    return moved, jacobian, q


def close(got, want, tolerance=ROUNDING):
    """Equal, each component relative to the largest of its kind in the batch."""
    size = np.abs(want).max(initial=1e-12)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=tolerance * size)


@given(st.integers(0, 5), st.integers(1, 4), st.integers(0, 10**6))
def test_predict_is_the_textbook(n, j, seed):
    x, p, mode, models = bank(n, j, seed)
    dt = np.random.default_rng([seed, 8]).uniform(0.01, 20.0, n)
    xs, ps, modes = imm_predict(x, p, mode, dt, *models)
    assert xs.shape == x.shape
    assert ps.shape == p.shape
    for row in range(n):
        want = textbook.predict(x[row], p[row], mode[row], dt[row], *models)
        close(xs[row], want[0])
        close(ps[row], want[1], NUMERIC_JACOBIAN)
        close(modes[row], want[2])


@given(st.integers(0, 5), st.integers(1, 4), st.integers(0, 10**6), st.floats(-2.0, 4.0))
def test_update_is_the_textbook(n, j, seed, exponent):
    x, p, mode, _ = bank(n, j, seed)
    rng = np.random.default_rng([seed, 9])
    z = x.mean(axis=1)[:, :4] + rng.normal(size=(n, 4))
    a = rng.normal(size=(n, 4, 6))
    r = a @ a.swapaxes(-1, -2) * 10.0**exponent
    has_velocity = rng.random(n) < 0.5
    xs, ps, modes, fit = update_filters(x, p, mode, z, r, has_velocity)
    for row in range(n):
        d = 4 if has_velocity[row] else 2
        want = textbook.update(x[row], p[row], mode[row], z[row, :d], r[row, :d, :d])
        close(xs[row], want[0], 1e-7)  # the two forms of the gain differ by rounding times the condition of the innovation
        close(ps[row], want[1], 1e-7)
        np.testing.assert_allclose(modes[row], np.maximum(want[2], FLOOR), rtol=1e-6, atol=1e-10)
        np.testing.assert_allclose(fit[row], want[3], rtol=1e-8)


@given(st.integers(0, 5), st.integers(1, 4), st.integers(0, 10**6))
def test_estimate_is_the_textbook(n, j, seed):
    x, p, mode, _ = bank(n, j, seed)
    mode = mode / mode.sum(axis=1, keepdims=True)
    mean, cov = estimate_filters(x, p, mode)
    for row in range(n):
        want = textbook.estimate(x[row], p[row], mode[row])
        close(mean[row], want[0])
        close(cov[row], want[1])


def test_no_time_changes_nothing():
    x, p, mode, models = bank(4, 3, 1)
    xs, ps, modes = imm_predict(x, p, mode, np.zeros(4), *models)
    close(xs, x, 1e-14)
    close(ps, p, 1e-14)
    np.testing.assert_allclose(modes, mode, rtol=1e-14)


def test_short_predictions_make_a_long_one():
    x, p, mode, models = bank(3, 1, 2)
    models = (np.array([0]), *models[1:])
    long = imm_predict(x, p, mode, np.full(3, 9.0), *models)
    short = (x, p, mode)
    for _ in range(3):
        short = imm_predict(*short, np.full(3, 3.0), *models)
    close(short[1], long[1])
    close(short[0], long[0])


def test_equal_sojourns_make_a_chain_of_continuous_time():
    x, p, mode, models = bank(3, 3, 3)
    models = (*models[:4], np.full(3, 20.0))
    long = imm_predict(x, p, mode, np.full(3, 30.0), *models)[2]
    short = (x, p, mode)
    for _ in range(10):
        short = imm_predict(*short, np.full(3, 3.0), *models)
    np.testing.assert_allclose(short[2], long, rtol=1e-12)
    ages = imm_predict(x, p, mode, np.full(3, 1e9), *models)[2]
    np.testing.assert_allclose(ages, 1.0 / 3.0, rtol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 1e-9, 1e-4, 0.02, 0.1 - 1e-9, 0.1 + 1e-9, -0.1 + 1e-9, 0.3, -2.0])
def test_turn_is_smooth_through_straight_ahead(rate):
    x = np.array([10.0, -20.0, 7.0, 3.0, rate])
    moved, jacobian, _ = one_model(x, 1.0, 1, 0.1, 1e-6, 0.0)
    close(moved, textbook.moved(x, 1.0, 1), 1e-12)
    close(jacobian, textbook.jacobian(x, 1.0, 1), NUMERIC_JACOBIAN)


def test_turn_rate_is_positive_to_port():
    east = np.array([0.0, 0.0, 5.0, 0.0, 0.1])
    moved, _, _ = one_model(east, 1.0, 1, 0.0, 0.0, 0.0)
    assert moved[3] > 0.0


def test_a_row_does_not_depend_on_its_neighbours():
    x, p, mode, models = bank(33, 3, 4)
    dt = np.linspace(0.0, 6.0, 33)
    whole = imm_predict(x, p, mode, dt, *models)
    z, r = np.zeros((33, 4)), np.tile(np.eye(4) * 30.0, (33, 1, 1))
    after = update_filters(*whole, z, r, np.arange(33) % 2 == 0)
    for rows in (slice(7, 8), slice(3, 20, 4), np.arange(33)[::-1]):
        part = imm_predict(x[rows], p[rows], mode[rows], dt[rows], *models)
        again = update_filters(*part, z[rows], r[rows], (np.arange(33) % 2 == 0)[rows])
        for got, want in zip((*part, *again), (*whole, *after), strict=True):
            assert np.array_equal(got, want[rows])


def test_a_model_that_is_ruled_out_keeps_a_floor():
    x, p, mode, models = bank(1, 2, 5)
    x[0, 1, :2] += 1e6
    p[:] = np.eye(5)
    *_, modes, fit = update_filters(x, p, mode, x[:, 0, :4], np.eye(4)[None], np.array([False]))
    assert FLOOR / 2.0 <= modes[0, 1] <= 2.0 * FLOOR
    assert np.isfinite(fit).all()
    assert np.isfinite(imm_predict(x, p, modes, np.zeros(1), *models)[0]).all()


def test_arguments_are_not_written_to():
    x, p, mode, models = bank(3, 3, 6)
    kept = x.copy(), p.copy(), mode.copy()
    imm_predict(x, p, mode, np.ones(3), *models)
    update_filters(x, p, mode, np.zeros((3, 4)), np.tile(np.eye(4), (3, 1, 1)), np.ones(3, np.bool_))
    for now, before in zip((x, p, mode), kept, strict=True):
        assert np.array_equal(now, before)


def test_filterpy_with_an_asymmetric_transition_agrees():
    x, p, mode, (_, noise, turn_noise, turn_sigma, _) = bank(1, 2, 7)
    kind, sojourn, dt = np.zeros(2, np.int64), np.array([3.0, 40.0]), 2.0
    filters = []
    for j in range(2):
        one = KalmanFilter(5, 2)
        one.x, one.P = x[0, j].copy(), p[0, j].copy()
        _, one.F, one.Q = one_model(x[0, j], dt, 0, noise[j], turn_noise[j], turn_sigma[j])
        one.H, one.R = np.eye(2, 5), np.diag([20.0, 50.0])
        filters.append(one)
    imm = IMMEstimator(filters, mode[0].copy(), textbook.transition_matrix(sojourn, dt))
    imm.predict()
    imm.update(np.array([3.0, 4.0]))
    predicted = imm_predict(x, p, mode, np.array([dt]), kind, noise, turn_noise, turn_sigma, sojourn)
    r = np.zeros((1, 4, 4))
    r[0, :2, :2] = np.diag([20.0, 50.0])
    xs, ps, modes, _ = update_filters(*predicted, np.array([[3.0, 4.0, 0.0, 0.0]]), r, np.array([False]))
    close(modes[0], imm.mu)
    mean, cov = estimate_filters(xs, ps, modes)
    close(mean[0], imm.x)
    close(cov[0], imm.P)
