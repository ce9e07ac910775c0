"""The IMM whose motions are taken up anew against the textbook, and its passes in one against its steps."""

from __future__ import annotations

import imm_textbook as textbook
import numpy as np
import pytest
import renewal_textbook as renewed
from hypothesis import given, strategies as st

from coastwatch.kernels.filters import motion_models
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.imm import (
    combine_filters,
    estimate_filters,
    initialise_filters,
    predict_filters,
    predicted_estimates,
    update_by_plots,
    update_filters,
)
from coastwatch.kernels.filters.motion_models import SPEEDING, STRAIGHT, TURNING
from coastwatch.kernels.tracks.columns import PlotColumns

pytestmark = pytest.mark.oracle

ROUNDING = 1e-9  # relative to the largest element of its kind
KIND, NOISE, MEAN, SIGMA, DRIFT, PRIOR = range(6)  # columns of a model of the oracle
NUMERIC_JACOBIAN = 2e-6  # relative: the oracle takes derivatives by differences
INNOVATION = 1e-7  # relative: two forms of the gain differ by rounding times the condition of the innovation


def bank(n: int, j: int, seed: int):
    """Random filters, and models with unlike settings."""
    rng = np.random.default_rng([seed, 17])
    scale = np.array([50.0, 50.0, 4.0, 4.0, 0.01])
    models = np.zeros((j, 6))
    models[:, KIND] = rng.permutation(np.arange(j) % 3)
    models[:, NOISE] = 10.0 ** rng.uniform(-4, 0, j)
    models[:, MEAN], models[:, SIGMA] = rng.normal(size=j) * 0.01, rng.uniform(0.001, 0.05, j)
    models[:, DRIFT] = 10.0 ** rng.uniform(-9, -5, j)
    models[:, PRIOR] = rng.dirichlet(np.ones(j))
    straight = models[:, KIND] == STRAIGHT
    models[straight, MEAN:PRIOR] = 0.0
    x = rng.normal(size=(n, j, 5)) * scale * 5.0
    a = rng.normal(size=(n, j, 5, 7)) * scale[:, None]
    x[:, straight, 4], a[:, straight, 4] = 0.0, 0.0
    mode = rng.dirichlet(np.ones(j), n).reshape(n, j) * (1.0 - j * 1e-6) + 1e-6
    return x, a @ a.swapaxes(-1, -2), mode, float(rng.uniform(5.0, 500.0)), models


def table(models):
    """Models of the oracle as the kernels take them."""
    kind, noise, mean, sigma, drift, prior = models.T
    return motion_models.table(
        kind=kind,
        noise=noise,
        manoeuvre_mean=mean,
        manoeuvre_sigma=sigma,
        manoeuvre_noise=drift,
        prior_probability=prior,
        sojourn=np.inf,
    )


def close(got, want, tolerance=ROUNDING):
    """Equal, each component relative to the largest of its kind in the batch."""
    size = np.abs(want).max(initial=1e-12)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=tolerance * size)


def plots(x, seed):
    """Positions near the filters, with noise."""
    rng = np.random.default_rng([seed, 19])
    a = rng.normal(size=(len(x), 2, 4)) * 20.0
    return x.mean(axis=1)[:, :2] + 30.0 * rng.normal(size=(len(x), 2)), a @ a.swapaxes(-1, -2)


def combined(x, p, mode, models):
    """The combined estimates of filters at time 0."""
    n = len(x)
    estimates = Estimates(np.zeros(n), np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros(n))
    combine_filters((x, p, mode), estimates, np.arange(n), table(models))
    return estimates


def updated(x, p, mode, rows, dt, position, noise, renewal, models):
    """Filters at time 0 after plots at dt, and their combined estimates."""
    filters, estimates = (x.copy(), p.copy(), mode.copy()), combined(x, p, mode, models)
    none = np.zeros(len(rows), np.int64)
    update_by_plots(
        filters, estimates, rows, np.arange(len(rows)), PlotColumns(dt, position, noise, none, none), renewal, table(models)
    )
    return filters, estimates


@given(st.integers(0, 4), st.integers(1, 7), st.integers(0, 10**6))
def test_predict_is_the_textbook(n, j, seed):
    x, p, mode, renewal, models = bank(n, j, seed)
    dt = np.random.default_rng([seed, 18]).uniform(0.01, 20.0, n)
    xs, ps, modes = predict_filters(x, p, mode, dt, renewal, table(models))
    for row in range(n):
        want = renewed.predict(x[row], p[row], mode[row], dt[row], renewal, models)
        close(xs[row], want[0])
        close(ps[row], want[1], NUMERIC_JACOBIAN)
        close(modes[row], want[2])
    assert np.array_equal(ps, ps.swapaxes(-1, -2))


@given(st.integers(0, 4), st.integers(1, 7), st.integers(0, 10**6))
def test_update_is_the_textbook_by_place_and_by_place_and_velocity(n, j, seed):
    x, p, mode, _, _ = bank(n, j, seed)
    rng = np.random.default_rng([seed, 20])
    z = x.mean(axis=1)[:, :4] + rng.normal(size=(n, 4))
    a = rng.normal(size=(n, 4, 6))
    r, has_velocity = a @ a.swapaxes(-1, -2), rng.random(n) < 0.5
    xs, ps, modes, fit = update_filters(x, p, mode, z, r, has_velocity)
    for row in range(n):
        d = 4 if has_velocity[row] else 2
        want = textbook.update(x[row], p[row], mode[row], z[row, :d], r[row, :d, :d])
        close(xs[row], want[0], INNOVATION)
        close(ps[row], want[1], INNOVATION)
        np.testing.assert_allclose(modes[row], np.maximum(want[2], 1e-12), rtol=1e-6, atol=1e-10)
        np.testing.assert_allclose(fit[row], want[3], rtol=1e-8)


@given(st.integers(0, 5), st.integers(1, 7), st.integers(0, 10**6))
def test_one_pass_is_its_steps(n, j, seed):
    """Late plots too: what is older than its row is brought forward by the velocity."""
    x, p, mode, renewal, models = bank(n, j, seed)
    rng = np.random.default_rng([seed, 21])
    rows, dt = rng.permutation(n), rng.uniform(-5.0, 10.0, n)
    position, noise = plots(x[rows], seed)
    ahead = predict_filters(x[rows], p[rows], mode[rows], np.maximum(dt, 0.0), renewal, table(models))
    mean, cov = estimate_filters(*ahead)
    estimates = combined(x, p, mode, models)
    estimates.time[rows] = -dt
    seen = predicted_estimates((x, p, mode), estimates, rows, 0.0, renewal, table(models))
    close(seen.mean, mean[:, :4])
    close(seen.covariance, cov[:, :4, :4])
    close(seen.noise, ahead[2] @ models[:, NOISE])
    assert np.array_equal(seen.time, np.maximum(-dt, 0.0))
    late = np.minimum(dt, 0.0)
    z, r = np.zeros((n, 4)), np.zeros((n, 4, 4))
    z[:, :2] = position - mean[:, 2:4] * late[:, None]
    r[:, :2, :2] = noise + cov[:, 2:4, 2:4] * (late**2)[:, None, None]
    want = update_filters(*ahead, z, r, np.zeros(n, np.bool_))
    filters, estimates = updated(x, p, mode, rows, dt, position, noise, renewal, models)
    for got, expected in zip(filters, want[:3], strict=True):
        close(got[rows], expected, INNOVATION)
    mean, cov = estimate_filters(*filters)
    close(estimates.mean, mean[:, :4])
    close(estimates.covariance, cov[:, :4, :4])
    close(estimates.noise, filters[2] @ models[:, NOISE])
    np.testing.assert_allclose(estimates.time[rows], np.maximum(dt, 0.0))


def test_a_row_is_the_same_alone():
    x, p, mode, renewal, models = bank(6, 7, 1)
    position, noise = plots(x, 1)
    rows, dt = np.arange(6), np.linspace(-2.0, 8.0, 6)
    together, _ = updated(x, p, mode, rows, dt, position, noise, renewal, models)
    for k in range(6):
        at = slice(k, k + 1)
        alone, _ = updated(x[at], p[at], mode[at], rows[:1], dt[at], position[at], noise[at], renewal, models)
        assert all(np.array_equal(a[at], b) for a, b in zip(together, alone, strict=True))


def test_a_filter_takes_its_plots_in_their_order():
    """Two plots in one call are two calls; filters without a plot stay."""
    x, p, mode, renewal, models = bank(3, 4, 5)
    position, noise = plots(x[[1, 1]], 5)
    both, _ = updated(x, p, mode, np.array([1, 1]), np.array([2.0, 3.0]), position, noise, renewal, models)
    first, _ = updated(x, p, mode, np.array([1]), np.array([2.0]), position[:1], noise[:1], renewal, models)
    second, _ = updated(*first, np.array([1]), np.array([1.0]), position[1:], noise[1:], renewal, models)
    for got, want in zip(both, second, strict=True):
        close(got, want)
    assert np.array_equal(both[0][[0, 2]], x[[0, 2]])


def test_a_new_filter_knows_one_plot_and_the_prior():
    x, p, mode, _, models = bank(4, 5, 6)
    rows, (position, noise) = np.array([2, 0]), plots(x[:2], 6)
    filters = x.copy(), p.copy(), mode.copy()
    initialise_filters(filters, rows, position, noise, 16.0, table(models))
    want = np.zeros((2, 5, 5))
    want[:, 2, 2] = want[:, 3, 3] = 16.0
    want[:, :2, :2] = noise
    for j in range(5):
        want[:, 4, 4] = models[j, SIGMA] ** 2
        close(filters[0][rows, j], np.column_stack([position, np.zeros((2, 2)), np.full(2, models[j, MEAN])]))
        close(filters[1][rows, j], want)
    close(filters[2][rows], np.tile(models[:, PRIOR], (2, 1)))
    assert np.array_equal(filters[0][[1, 3]], x[[1, 3]])


def test_no_time_changes_nothing_and_nothing_is_written():
    x, p, mode, renewal, models = bank(3, 5, 2)
    kept = x.copy(), p.copy(), mode.copy()
    same = predict_filters(x, p, mode, np.zeros(3), renewal, table(models))
    update_filters(x, p, mode, np.zeros((3, 4)), np.tile(np.eye(4), (3, 1, 1)), np.zeros(3, np.bool_))
    for before, now, after in zip(kept, (x, p, mode), same, strict=True):
        assert np.array_equal(before, now)
        assert np.array_equal(before, after)


def test_the_chain_of_models_composes():
    """Three times 3 s is 9 s for the probabilities, exactly; a long time ends at the shares."""
    x, p, mode, renewal, models = bank(4, 7, 3)
    short = x, p, mode
    for _ in range(3):
        short = predict_filters(*short, np.full(4, 3.0), renewal, table(models))
    close(short[2], predict_filters(x, p, mode, np.full(4, 9.0), renewal, table(models))[2])
    close(predict_filters(x, p, mode, np.full(4, 1e6), renewal, table(models))[2], np.tile(models[:, PRIOR], (4, 1)))


def test_kinds_are_what_they_say():
    """One model, no noise: the vessel goes straight, turns to port at its rate, or gains speed along its course."""
    state = np.array([[[0.0, 0.0, 3.0, 4.0, 0.01]]])
    for kind, course_deg, speed in (
        (STRAIGHT, 0.0, 5.0),
        (TURNING, 5.7296, 5.0),
        (SPEEDING, 0.0, 5.0 + 0.1 * 5.0 / np.hypot(5.0, 0.5)),
    ):
        models = np.array([[kind, 0.0, 0.0, 1e-3, 0.0, 1.0]])
        x, _, _ = predict_filters(state, np.zeros((1, 1, 5, 5)), np.ones((1, 1)), np.array([10.0]), 1e12, table(models))
        turned = np.degrees(np.arctan2(x[0, 0, 3], x[0, 0, 2]) - np.arctan2(4.0, 3.0))
        np.testing.assert_allclose((turned, np.hypot(*x[0, 0, 2:4])), (course_deg, speed), atol=1e-3)
