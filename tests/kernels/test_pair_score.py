"""The window kernels against numpy written the long way."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import multivariate_normal

from coastwatch import geodesy
from coastwatch.kernels.association.candidate_pairs import PAIR
from coastwatch.kernels.association.pair_features import ENTRY, TRACK
from coastwatch.kernels.association.pair_score import Rule, pair_scores, sample_statistics

pytestmark = pytest.mark.oracle

ROUNDING = 1e-9  # relative; the differences are of degrees, 1e-9 of a metre is 1e-14 of a degree


def tracks(seed, n, window):
    rng = np.random.default_rng([seed, 0])
    origin = np.array([-23.0, 179.999])
    metres = rng.normal(0.0, 100.0, (n, 1, 2)) + np.cumsum(rng.normal(0.0, 5.0, (n, window, 2)), axis=1)
    position = geodesy.offset_deg(np.broadcast_to(origin, metres.shape), metres)
    velocity = rng.normal(0.0, 2.0, (n, window, 2)).astype(np.float32).astype(float)
    variance = rng.uniform(50.0, 500.0, (n, window, 2)).astype(np.float32).astype(float)
    length = rng.integers(1, window + 1, n)
    return position, velocity, variance, length


def history_of(position, velocity, variance, seed):
    """The same windows in slots of any order, the newest in any column. Returns: values (S, W), slot of each track, newest column."""
    n, window = position.shape[:2]
    rng = np.random.default_rng([seed, 2])
    slot, newest = rng.permutation(n + 3)[:n], int(rng.integers(window))
    entry = np.zeros((n, window), ENTRY)
    entry["latitude_deg"], entry["longitude_deg"] = position[..., 0], position[..., 1]
    entry["east_m_s"], entry["north_m_s"] = velocity[..., 0], velocity[..., 1]
    entry["variance_m2"], entry["rate_variance_m2_s2"] = variance[..., 0], variance[..., 1]
    values = np.full((n + 3, window), np.nan).astype(ENTRY)
    values[slot] = np.roll(entry, newest + 1, axis=1)
    return values, slot, newest


def scored(first, second, density, history, length, covariance, registration, rule):
    values, slot, newest = history
    track, pair = np.zeros(len(slot), TRACK), np.zeros(len(first), PAIR)
    track["slot"], track["length"], track["covariance"], track["registration"] = slot, length, covariance, registration
    pair["first"], pair["second"], pair["density"] = first, second, density
    return pair_scores(pair, track, values, newest, rule)


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


@given(st.integers(0, 2**31), st.integers(1, 8), st.integers(1, 12), st.integers(1, 20))
def test_scores_equal_the_long_way(seed, n, window, pairs):
    position, velocity, variance, length = tracks(seed, n, window)
    rng = np.random.default_rng([seed, 1])
    first, second = rng.integers(0, n, (2, pairs))
    root = rng.normal(0.0, 5.0, (n, 4, 4))
    covariance = root @ root.transpose(0, 2, 1) + 5.0 * np.eye(4)
    registration = rng.uniform(0.0, 30.0, (n, 1, 1)) * np.eye(2)
    density = rng.uniform(1e-7, 1e-5, pairs)
    settings_ = (10.0, 0.5, 4.0, 0.9, 20.0, 0.01, 4.0)
    windows = history_of(position, velocity, variance, seed), length, covariance, registration
    got = scored(first, second, density, *windows, Rule(1000.0, *settings_, -np.inf))
    for p, (a, b) in enumerate(zip(first, second, strict=True)):
        m = min(length[a], length[b])
        want = score_by_hand(
            differences(a, b, position, velocity, m),
            (variance[a] + variance[b])[-m:],
            covariance[a] + covariance[b],
            registration[a] + registration[b],
            density[p],
            *settings_,
        )
        assert got[p] == pytest.approx(want, rel=1e-7, abs=1e-7)
    for threshold in (-20.0, 0.0, 20.0):
        above = scored(first, second, density, *windows, Rule(1000.0, *settings_, threshold))
        assert above[got > threshold].tolist() == got[got > threshold].tolist()
        assert (above[got <= threshold] <= threshold).all()


@given(st.integers(0, 2**31), st.integers(5, 12))
def test_sample_statistic_is_eq_7(seed, p):
    position, velocity, variance, _ = tracks(seed, 4, p)
    values, slot, newest = history_of(position, velocity, variance, seed)
    length = np.zeros(len(values), np.int32)
    length[slot] = [p, p, p - 1, p]
    first, second = np.array([0, 0, 0]), np.array([1, 2, 3])
    got = sample_statistics(first, second, slot, length, values, newest)
    assert np.isinf(got[1])
    for q in (0, 2):
        delta = differences(first[q], second[q], position, velocity, p)
        want = delta[-1] @ np.linalg.solve(np.cov(delta.T, ddof=1), delta[-1])
        assert got[q] == pytest.approx(want, rel=1e-6)


def test_a_bad_covariance_never_pairs_and_leaves_its_neighbours_alone():
    position, velocity, variance, length = tracks(1, 4, 4)
    history, none = history_of(position, velocity, variance, 1), np.zeros((4, 2, 2))
    covariance = np.tile(100.0 * np.eye(4), (4, 1, 1))
    rule = Rule(1000.0, 10.0, 0.5, 4.0, 0.9, 20.0, 0.01, 4.0, -np.inf)
    pairs = np.array([0, 0, 2]), np.array([1, 2, 3]), np.full(3, 1e-6)
    good = scored(*pairs, history, length, covariance, none, rule)
    covariance[1] *= -1.0
    got = scored(*pairs, history, length, covariance, none, rule)
    assert np.isfinite(good).all()
    assert got.tolist() == [-np.inf, *good[1:].tolist()]
