"""The IMM kernel with jumps against the textbook, with late measurements, and that a filter does not depend on its neighbours."""

from __future__ import annotations

import imm_textbook
import numpy as np
import pytest
import velocity_jumps_textbook as jumps_textbook
from hypothesis import given, strategies as st

from coastwatch.kernels.filters import motion_models
from coastwatch.kernels.filters.fused_filters import Alternatives, TimedMeasurements, estimate, update

pytestmark = pytest.mark.oracle

SIMILAR = 1e-5  # of the largest of its kind: the oracle takes derivatives by differences, which errs by 2e-6 a step
ROUNDING = 1e-9
JUMP_VARIANCES, SOJOURNS_S = np.array([0.01, 0.04, 0.16, 0.64]), np.array([60.0, 600.0, 6000.0])
SIZES = np.array([50.0, 50.0, 4.0, 4.0, 0.01])


def table(models, jumps):
    """These models as the kernels take them."""
    kind, noise, turn_noise, turn_sigma, sojourn = models
    return motion_models.table(
        kind=kind,
        noise=noise,
        manoeuvre_noise=turn_noise,
        manoeuvre_sigma=turn_sigma,
        sojourn=sojourn,
        jump_rate=jumps[0],
        jump_variance=jumps[1],
    )


def bank(n, j, seed):
    """Random filters; models with unlike settings, some of which can be jumped."""
    rng = np.random.default_rng([seed, 17])
    kind = np.arange(j)[::-1] % 2
    x = rng.normal(size=(n, j, 5)) * SIZES
    a = rng.normal(size=(n, j, 5, 7)) * SIZES[:, None]
    p = a @ a.swapaxes(-1, -2)
    x[:, kind == 0, 4] = p[:, kind == 0, 4, :4] = p[:, kind == 0, :4, 4] = 0.0  # as the kernel keeps what does not turn
    mode = rng.dirichlet(np.ones(j), n).reshape(n, j) * (1.0 - j * 1e-6) + 1e-6
    noises = 10.0 ** rng.uniform(-4, 0, j), 10.0 ** rng.uniform(-9, -5, j), rng.uniform(0.001, 0.05, j)
    jumps = rng.uniform(0.0, 0.1, j) * (rng.random(j) < 0.6), rng.uniform(0.01, 2.0, j)
    return x, p, mode, (kind, *noises, rng.uniform(2.0, 90.0, j)), jumps


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


def kernel(x, p, mode, time, z, r, models, jumps, every=True, evidence=None):
    """The filters after these measurements. Args: every: measurements decide on jumps, not velocities alone; evidence: written."""
    n, count = time.shape
    filters = x.copy(), p.copy(), mode.copy(), np.zeros(n), np.zeros(n)
    begin, decides = np.arange(n + 1) * count, np.isfinite(z[..., 2].ravel()) | every
    measured = TimedMeasurements(time.ravel(), z.reshape(-1, 4), r.reshape(-1, 4, 4), np.full(z.size // 4, np.inf), decides)
    compared = Alternatives(JUMP_VARIANCES, SOJOURNS_S)
    out = np.zeros((n, len(JUMP_VARIANCES) + len(SOJOURNS_S))) if evidence is None else evidence
    update(0, n, filters, measured, begin, table(models, jumps), compared, out)
    return filters


def close(got, want, tolerance):
    np.testing.assert_allclose(got, want, rtol=0.0, atol=tolerance * np.abs(want).max(initial=1e-12))


@given(st.integers(0, 4), st.integers(1, 4), st.integers(0, 3), st.integers(0, 10**6))
def test_it_is_the_textbook(n, j, count, seed):
    x, p, mode, models, jumps = bank(n, j, seed)
    time, z, r = measurements(n, count, seed, 0.01)
    filters = kernel(x, p, mode, time, z, r, models, jumps)
    states, covariances, modes, newest, _ = filters
    mean, spread = np.empty((n, 5)), np.empty((n, 5, 5))
    estimate(0, n, filters, 12.0, table(models, jumps), mean, spread)
    for row in range(n):
        state, now = (x[row], p[row], mode[row]), 0.0
        for t, one, noise in zip(time[row], z[row], r[row], strict=True):
            d = 4 if np.isfinite(one).all() else 2
            *state, _ = jumps_textbook.step(*state, t - now, one[:d], noise[:d, :d], models, *jumps)
            now = t
        close(states[row], state[0], SIMILAR)
        close(covariances[row], state[1], SIMILAR)
        np.testing.assert_allclose(modes[row], state[2], rtol=1e-4, atol=1e-9)
        assert newest[row] == now
        want = jumps_textbook.ahead(*state, 12.0 - now, models, *jumps)
        close(mean[row], want[0], SIMILAR)
        close(spread[row], want[1], SIMILAR)


@given(st.integers(1, 4), st.integers(0, 10**6), st.floats(0.0, 8.0))
def test_a_late_measurement_is_brought_forward_by_the_velocity(j, seed, late_s):
    x, p, mode, models, jumps = bank(1, j, seed)
    mode /= mode.sum()
    _, z, r = measurements(1, 1, seed, 0.01)
    states, covariances, modes, newest, _ = kernel(x, p, mode, np.array([[-late_s]]), z, r, models, jumps)
    mean, spread = imm_textbook.estimate(x[0], p[0], mode[0])
    one, noise = z[0, 0].copy(), r[0, 0].copy()
    one[:2] += late_s * mean[2:4]
    noise[:2, :2] += late_s**2 * spread[2:4, 2:4]
    turned = (one[2] + 1j * one[3]) * np.exp(1j * mean[4] * late_s)
    one[2:] = turned.real, turned.imag
    d = 4 if np.isfinite(one).all() else 2
    want = imm_textbook.update(x[0], p[0], mode[0], one[:d], noise[:d, :d])
    close(states[0], want[0], ROUNDING)
    close(covariances[0], want[1], ROUNDING)
    np.testing.assert_allclose(modes[0], want[2], rtol=1e-6, atol=1e-9)
    assert newest[0] == 0.0


def test_a_filter_is_the_same_to_the_bit_in_any_company():
    x, p, mode, models, jumps = bank(40, 4, 3)
    time, z, r = measurements(40, 3, 3, -1.0)
    filters = kernel(x, p, mode, time, z, r, models, jumps)
    few = np.array([31, 4, 17])
    alone = kernel(x[few], p[few], mode[few], time[few], z[few], r[few], models, jumps)
    for got, want in zip(alone, filters, strict=True):
        np.testing.assert_array_equal(got, want[few])


def test_a_jump_is_followed_where_steadiness_is_all_else_that_is_known():
    models = (np.zeros(1, np.int64), np.full(1, 1e-6), np.zeros(1), np.full(1, 0.01), np.full(1, 60.0))
    x, p = np.zeros((1, 1, 5)), np.diag([1.0, 1.0, 1e-4, 1e-4, 1e-4])[None, None]
    time = np.arange(1.0, 31.0)[None]
    z = np.zeros((1, 30, 4))
    z[0, :, 0], z[0, :, 2] = 0.5 * time, 0.5  # jumped at time 0 by half a metre a second
    r = np.tile(np.diag([9.0, 9.0, 0.01, 0.01]), (1, 30, 1, 1))
    speeds = []
    for rate in (0.0, 1.0 / 60.0):
        states, *_ = kernel(x, p, np.ones((1, 1)), time, z, r, models, (np.full(1, rate), np.full(1, 0.04)))
        speeds.append(states[0, 0, 2])
    assert speeds[0] < 0.15  # the filter that knows of no jumps stays with what it was sure of
    assert speeds[1] > 0.45


def test_positions_do_not_decide_on_jumps_until_a_velocity_or_a_minute_has_come():
    x, p, mode, models, jumps = bank(1, 2, 5)
    jumps = np.array([0.1, 0.0]), np.array([1.0, 1.0])
    time, z, r = np.array([[1.0, 2.0, 3.0]]), np.zeros((1, 3, 4)), np.tile(100.0 * np.eye(4), (1, 3, 1, 1))
    z[0, :2, 2:] = np.nan
    *_, newest, judged = kernel(x, p, mode, time[:, :2], z[:, :2], r[:, :2], models, jumps, every=False)
    assert (newest[0], judged[0]) == (2.0, 0.0)
    *_, judged = kernel(x, p, mode, time, z, r, models, jumps, every=False)
    assert judged[0] == 3.0
    *_, judged = kernel(x, p, mode, np.array([[61.0, 62.0]]), z[:, :2], r[:, :2], models, jumps, every=False)
    assert judged[0] == 61.0


@pytest.mark.parametrize("jump_m_s", [0.1, 0.4])
def test_the_evidence_is_for_the_size_of_the_jumps_and_for_no_change_of_model(jump_m_s):
    rng, n, count = np.random.default_rng([7, 19]), 400, 20
    kind, sojourn_s = np.zeros(2, np.int64), np.array([600.0, 300.0])
    models = kind, np.array([1e-5, 0.2]), np.zeros(2), np.full(2, 0.01), sojourn_s
    x, p = np.zeros((n, 2, 5)), np.tile(np.diag([4.0, 4.0, 0.01, 0.01, 1e-4]), (n, 2, 1, 1))
    time = np.tile(10.0 * np.arange(1.0, count + 1.0), (n, 1))
    jumped = rng.random((n, count, 1)) < 1.0 - np.exp(-10.0 / 60.0)
    velocity = np.cumsum(jumped * rng.normal(0.0, jump_m_s, (n, count, 2)), axis=1)
    z = np.concatenate([np.cumsum(10.0 * velocity, axis=1), velocity], axis=2) + rng.normal(0.0, 1.0, (n, count, 4)) * [
        3,
        3,
        0.1,
        0.1,
    ]
    r = np.tile(np.diag([9.0, 9.0, 0.01, 0.01]), (n, count, 1, 1))
    evidence = np.zeros((n, len(JUMP_VARIANCES) + len(SOJOURNS_S)))
    jumps = np.array([1 / 60.0, 0.0]), np.array([jump_m_s**2, 0.0])
    kernel(x, p, np.tile([0.9, 0.1], (n, 1)), time, z, r, models, jumps, every=False, evidence=evidence)
    of_jumps, of_sojourns = np.split(evidence.sum(axis=0), [len(JUMP_VARIANCES)])
    assert np.sqrt(JUMP_VARIANCES[np.argmax(of_jumps)]) == pytest.approx(jump_m_s)
    assert np.argmax(of_sojourns) == len(SOJOURNS_S) - 1
