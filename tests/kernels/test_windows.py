"""The window kernels against numpy written the long way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from coastwatch import geodesy
from coastwatch.kernels.windows import sample_statistics, windowed_scores

ROUNDING = 1e-9  # relative; the differences are of degrees, 1e-9 of a metre is 1e-14 of a degree


def tracks(seed, n, window):
    rng = np.random.default_rng([seed, 0])
    origin = np.array([-23.0, 179.999])
    metres = rng.normal(0.0, 100.0, (n, 1, 2)) + np.cumsum(rng.normal(0.0, 5.0, (n, window, 2)), axis=1)
    position = geodesy.offset_deg(np.broadcast_to(origin, metres.shape), metres)
    velocity = rng.normal(0.0, 2.0, (n, window, 2))
    variance = rng.uniform(50.0, 500.0, (n, window, 2))
    length = rng.integers(1, window + 1, n)
    return position, velocity, variance, length


def differences(a, b, position, velocity, n):
    here, there = position[a, -n:], position[b, -n:]
    north, east = geodesy.scale_m_deg(0.5 * (position[a, -1, 0] + position[b, -1, 0]))
    d = np.stack([geodesy.wrap_deg(there[:, 1] - here[:, 1]) * east, (there[:, 0] - here[:, 0]) * north], axis=1)
    return np.concatenate([d, velocity[b, -n:] - velocity[a, -n:]], axis=1)


def score_by_hand(delta, variance, phi, registration, density, prior, floor, cap, memory, limit, misled, null_speed):
    n = len(delta)
    gain = [1.0, 1.0]
    if n > 2:
        for block in (0, 1):
            part = slice(2 * block, 2 * block + 2)
            s = np.cov(delta[:, part].T, ddof=1)
            shown = np.trace(np.linalg.solve(phi[part, part], s)) / 2.0
            gain[block] = np.clip(((n - 1) * shown + prior) / (n - 1 + prior), floor, cap)
    grown = np.diag(np.sqrt(np.repeat(gain, 2))) @ phi @ np.diag(np.sqrt(np.repeat(gain, 2)))
    grown[:2, :2] += registration
    v2 = 2.0 * null_speed**2
    total = 0.0
    for k in range(n):
        older = np.diag(np.sqrt(np.repeat(np.maximum(variance[k] / variance[-1], 1.0), 2)))
        scaled = older @ grown @ older
        unrelated = multivariate_normal.logpdf(delta[k, 2:], cov=v2 * np.eye(2))
        place = multivariate_normal.logpdf(delta[k, :2], cov=scaled[:2, :2])
        whole = multivariate_normal.logpdf(delta[k], cov=scaled)
        same = np.logaddexp(np.log1p(-misled) + whole, np.log(misled) + place + unrelated)
        step = same - np.log(density) - unrelated
        total = max(memory * total + np.clip(step, -limit, limit), -limit)
    return total


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 8), st.integers(1, 12))
def test_scores_equal_the_long_way(seed, n, window):
    position, velocity, variance, length = tracks(seed, n, window)
    rng = np.random.default_rng([seed, 1])
    first, second = rng.integers(0, n, (2, 5))
    root = rng.normal(0.0, 5.0, (5, 4, 4))
    phi = root @ root.transpose(0, 2, 1) + 10.0 * np.eye(4)
    registration = rng.uniform(0.0, 30.0, (5, 1, 1)) * np.eye(2)
    density = rng.uniform(1e-7, 1e-5, 5)
    settings_ = (10.0, 0.5, 4.0, 0.9, 20.0, 0.01, 4.0)
    got = windowed_scores(first, second, position, velocity, variance, length, phi, registration, density, *settings_)
    for p, (a, b) in enumerate(zip(first, second, strict=True)):
        m = min(length[a], length[b])
        want = score_by_hand(
            differences(a, b, position, velocity, m),
            (variance[a] + variance[b])[-m:],
            phi[p],
            registration[p],
            density[p],
            *settings_,
        )
        assert got[p] == pytest.approx(want, rel=1e-7, abs=1e-7)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(5, 12))
def test_sample_statistic_is_eq_7(seed, p):
    position, velocity, _, _ = tracks(seed, 4, p + 2)
    length = np.array([p + 2, p, p - 1, p + 1])
    first, second = np.array([0, 0, 0]), np.array([1, 2, 3])
    got = sample_statistics(first, second, position, velocity, length, p)
    assert np.isinf(got[1])
    for q in (0, 2):
        delta = differences(first[q], second[q], position, velocity, p)
        want = delta[-1] @ np.linalg.solve(np.cov(delta.T, ddof=1), delta[-1])
        assert got[q] == pytest.approx(want, rel=1e-6)


def test_a_bad_covariance_never_pairs():
    position, velocity, variance, length = tracks(1, 2, 4)
    got = windowed_scores(
        np.array([0]),
        np.array([1]),
        position,
        velocity,
        variance,
        length,
        -np.eye(4)[None],
        np.zeros((1, 2, 2)),
        np.array([1e-6]),
        10.0,
        0.5,
        4.0,
        0.9,
        20.0,
        0.01,
        4.0,
    )
    assert got[0] == -np.inf
