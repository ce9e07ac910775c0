"""The IMM kernel with kicks against the textbook, with late measurements, and that a filter does not depend on its neighbours."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.filters.velocity_jumps import WIDTH, absorb, foresee

sys.path.insert(0, str(Path(__file__).parents[1] / "oracles"))
import imm_textbook
import kicked_textbook

SIMILAR = 1e-5  # of the largest of its kind: the oracle takes derivatives by differences, which errs by 2e-6 a step
ROUNDING = 1e-9
LOW = np.tril_indices(5)
SIZES = np.array([50.0, 50.0, 4.0, 4.0, 0.01])


def packed(x, p):
    out = np.empty((*x.shape[:2], WIDTH))
    out[..., :5], out[..., 5:] = x, p[..., LOW[0], LOW[1]]
    return out


def unpacked(rows):
    p = np.empty((*rows.shape[:-1], 5, 5))
    p[..., LOW[0], LOW[1]] = p[..., LOW[1], LOW[0]] = rows[..., 5:]
    return rows[..., :5], p


def bank(n, j, seed):
    """Random filters; models with unlike settings, some of which can be kicked."""
    rng = np.random.default_rng([seed, 17])
    kind = np.arange(j)[::-1] % 2
    x = rng.normal(size=(n, j, 5)) * SIZES
    a = rng.normal(size=(n, j, 5, 7)) * SIZES[:, None]
    p = a @ a.swapaxes(-1, -2)
    x[:, kind == 0, 4] = p[:, kind == 0, 4, :4] = p[:, kind == 0, :4, 4] = 0.0  # as the kernel keeps what does not turn
    mode = rng.dirichlet(np.ones(j), n).reshape(n, j) * (1.0 - j * 1e-6) + 1e-6
    noises = 10.0 ** rng.uniform(-4, 0, j), 10.0 ** rng.uniform(-9, -5, j), rng.uniform(0.001, 0.05, j)
    kicks = rng.uniform(0.0, 0.1, j) * (rng.random(j) < 0.6), rng.uniform(0.01, 2.0, j)
    return x, p, mode, (kind, *noises, rng.uniform(2.0, 90.0, j)), kicks


def measurements(n, count, seed, earliest_s):
    """(time, z, R) of `count` measurements of each filter, in order, about half of them with velocities."""
    rng = np.random.default_rng([seed, 18])
    time = np.sort(rng.uniform(earliest_s, 10.0, (n, count)), axis=1)
    z = rng.normal(size=(n, count, 4)) * SIZES[:4]
    a = rng.normal(size=(n, count, 4, 6)) * SIZES[:4, None]
    r = a @ a.swapaxes(-1, -2)
    r[..., :2, 2:] = r[..., 2:, :2] = 0.0
    z[rng.random((n, count)) < 0.5, 2:] = np.nan
    return time, z, r


def kernel(x, p, mode, time, z, r, models, kicks):
    """The filters after these measurements, all of which the kernel gets shuffled; the log-likelihoods."""
    n, count = time.shape
    place = np.random.default_rng([n, count]).permutation(n * count)
    flat = np.empty((n * count, 10))
    flat[place, :4] = z.reshape(-1, 4)
    rows = r.reshape(-1, 4, 4)
    flat[place, 4:7], flat[place, 7:] = rows[:, [0, 1, 1], [0, 0, 1]], rows[:, [2, 3, 3], [2, 2, 3]]
    when = np.empty(n * count)
    when[place] = time.ravel()
    filters, mode, newest, fit = packed(x, p), mode.copy(), np.zeros(n), np.empty(n)
    begin = np.arange(n + 1) * count
    absorb(0, n, filters, mode, newest, when, flat, place, begin, (*models, *kicks), fit)
    return filters, mode, newest, fit


def close(got, want, tolerance):
    np.testing.assert_allclose(got, want, rtol=0.0, atol=tolerance * np.abs(want).max(initial=1e-12))


@given(st.integers(0, 4), st.integers(1, 4), st.integers(0, 3), st.integers(0, 10**6))
def test_it_is_the_textbook(n, j, count, seed):
    x, p, mode, models, kicks = bank(n, j, seed)
    time, z, r = measurements(n, count, seed, 0.01)
    filters, modes, newest, fit = kernel(x, p, mode, time, z, r, models, kicks)
    mean, spread = np.empty((n, 5)), np.empty((n, 5, 5))
    foresee(0, n, filters, modes, newest, 12.0, (*models, *kicks), mean, spread)
    for row in range(n):
        state, now, total = (x[row], p[row], mode[row]), 0.0, 0.0
        for t, one, noise in zip(time[row], z[row], r[row], strict=True):
            d = 4 if np.isfinite(one).all() else 2
            *state, one_fit = kicked_textbook.step(*state, t - now, one[:d], noise[:d, :d], models, *kicks)
            now, total = t, total + one_fit
        got = unpacked(filters[row])
        close(got[0], state[0], SIMILAR)
        close(got[1], state[1], SIMILAR)
        np.testing.assert_allclose(modes[row], state[2], rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(fit[row], total, rtol=1e-5)
        assert newest[row] == now
        want = kicked_textbook.ahead(*state, 12.0 - now, models, *kicks)
        close(mean[row], want[0], SIMILAR)
        close(spread[row], want[1], SIMILAR)


@given(st.integers(1, 4), st.integers(0, 10**6), st.floats(0.0, 8.0))
def test_a_late_measurement_is_brought_forward_by_the_velocity(j, seed, late_s):
    x, p, mode, models, kicks = bank(1, j, seed)
    mode /= mode.sum()
    _, z, r = measurements(1, 1, seed, 0.01)
    filters, modes, newest, _ = kernel(x, p, mode, np.array([[-late_s]]), z, r, models, kicks)
    mean, spread = imm_textbook.estimate(x[0], p[0], mode[0])
    one, noise = z[0, 0].copy(), r[0, 0].copy()
    one[:2] += late_s * mean[2:4]
    noise[:2, :2] += late_s**2 * spread[2:4, 2:4]
    turned = (one[2] + 1j * one[3]) * np.exp(1j * mean[4] * late_s)
    one[2:] = turned.real, turned.imag
    d = 4 if np.isfinite(one).all() else 2
    want = imm_textbook.update(x[0], p[0], mode[0], one[:d], noise[:d, :d])
    got = unpacked(filters[0])
    close(got[0], want[0], ROUNDING)
    close(got[1], want[1], ROUNDING)
    np.testing.assert_allclose(modes[0], want[2], rtol=1e-6, atol=1e-9)
    assert newest[0] == 0.0


def test_a_filter_is_the_same_to_the_bit_in_any_company():
    x, p, mode, models, kicks = bank(40, 4, 3)
    time, z, r = measurements(40, 3, 3, -1.0)
    filters, modes, _, _ = kernel(x, p, mode, time, z, r, models, kicks)
    few = np.array([31, 4, 17])
    alone, modes_alone, _, _ = kernel(x[few], p[few], mode[few], time[few], z[few], r[few], models, kicks)
    np.testing.assert_array_equal(alone, filters[few])
    np.testing.assert_array_equal(modes_alone, modes[few])


def test_a_kick_is_followed_where_steadiness_is_all_else_that_is_known():
    models = (np.zeros(1, np.int64), np.full(1, 1e-6), np.zeros(1), np.full(1, 0.01), np.full(1, 60.0))
    x, p = np.zeros((1, 1, 5)), np.diag([1.0, 1.0, 1e-4, 1e-4, 1e-4])[None, None]
    time = np.arange(1.0, 31.0)[None]
    z = np.zeros((1, 30, 4))
    z[0, :, 0], z[0, :, 2] = 0.5 * time, 0.5  # kicked at time 0 by half a metre a second
    r = np.tile(np.diag([9.0, 9.0, 0.01, 0.01]), (1, 30, 1, 1))
    speeds = []
    for rate in (0.0, 1.0 / 60.0):
        filters, _, _, _ = kernel(x, p, np.ones((1, 1)), time, z, r, models, (np.full(1, rate), np.full(1, 0.04)))
        speeds.append(filters[0, 0, 2])
    assert speeds[0] < 0.15  # the filter that knows of no kicks stays with what it was sure of
    assert speeds[1] > 0.45
