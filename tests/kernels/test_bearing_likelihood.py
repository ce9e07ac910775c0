"""The recursions over windows of bearings equal the densities written out with full covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from coastwatch.geodesy import axes, earth_centred, from_plane
from coastwatch.kernels.bearing import known_vessel, unknown_vessel, wrap

ROUNDING = 1e-6  # log density: the dense form inverts a matrix of condition 1e6
FLAT = 1e5  # rad^2, variance that stands for a flat offset in the dense form
FLAT_ERROR = 1e-4  # what that costs
SITE_DEG = np.array([-22.9, -43.1])
GIVE_UP = -1e9


def window(seed: int, length: int, missing: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([seed, 3])
    time = np.cumsum(rng.uniform(0.5, 6.0, length))
    bearing = 0.4 + 0.002 * time + rng.normal(0.0, 0.02, length)
    time[:missing], bearing[:missing] = np.nan, np.nan
    return time, bearing


@given(seed=st.integers(0, 10_000), length=st.integers(1, 12), missing=st.integers(0, 12))
@settings(deadline=None, max_examples=40)
def test_unknown_vessel_is_the_dense_gaussian_mixture(seed: int, length: int, missing: int) -> None:
    missing = min(missing, length)
    time, bearing = window(seed, length, missing)
    share, weight = np.array([1.0, 0.3]), np.array([0.8, 0.2])
    variance, reach, speed, kick = 4e-4, 5000.0, 5.0, 0.01
    out = np.empty((1, length + 1))
    unknown_vessel(time[None], bearing[None], np.array([variance]), np.array([reach]), share, weight, speed, kick, out)
    assert out[0, 0] == 0.0
    for n in range(1, length - missing + 1):
        t, z = time[length - n :][::-1], bearing[length - n :][::-1]
        a = t[0] - t
        terms = []
        for s in share:
            r = reach * s
            noise = (speed / r) ** 3 + kick / r**2
            low, high = np.minimum.outer(a, a), np.maximum.outer(a, a)
            cov = variance * np.eye(n) + FLAT + (speed / r) ** 2 * np.outer(a, a) + noise * low**2 * (3.0 * high - low) / 6.0
            terms.append(multivariate_normal.logpdf(z, np.zeros(n), cov) + 0.5 * np.log(2.0 * np.pi * FLAT))
        assert out[0, n] == pytest.approx(np.log(np.exp(terms) @ weight), abs=FLAT_ERROR * n)
    assert (out[0, length - missing :] == out[0, length - missing]).all()


HEARD, HEARD_OUTSIDE = 1.0 / (1.0 + np.exp(-2.0)), 1.0 / (1.0 + np.exp(1.0))  # log odds 2 and -1


def score(
    time,
    bearing,
    path,
    before,
    blend,
    bias_sigma=0.01,
    bias=0.0,
    sigma=0.02,
    memory=20.0,
    give_up=GIVE_UP,
    arc=2 * np.pi,
    reach=9000.0,
):
    """Gain (against a null of 0) and residual of one pair, seen from SITE_DEG."""
    w = len(time)
    gain, residual = np.empty(1), np.empty(1)
    one = np.zeros(1, np.int64)
    known_vessel(
        one,
        one,
        time[None],
        bearing[None],
        np.zeros((1, w), np.int64),
        earth_centred(SITE_DEG[None]),
        np.ascontiguousarray(axes(SITE_DEG[None])[:, :2]),
        before[None],
        blend[None],
        path[None],
        np.zeros((1, w + 1)),
        HEARD,
        np.zeros(1),
        np.array([HEARD_OUTSIDE]),
        np.array([reach]),
        np.array([0.0]),
        np.array([arc]),
        np.array([bias]),
        np.array([bias_sigma**2]),
        np.array([sigma**2]),
        memory,
        give_up,
        gain,
        residual,
    )
    return gain[0], residual[0]


def sailing(metres: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    return np.column_stack([earth_centred(from_plane(metres, SITE_DEG)), sigma])


@given(seed=st.integers(0, 10_000), length=st.integers(1, 12), missing=st.integers(0, 11))
@settings(deadline=None, max_examples=40)
def test_known_vessel_is_the_dense_gaussian(seed: int, length: int, missing: int) -> None:
    missing = min(missing, length - 1)
    rng = np.random.default_rng([seed, 4])
    time, _ = window(seed, length, missing)
    metres = np.array([2500.0, -1500.0]) + np.cumsum(rng.normal(0.0, 15.0, (length + 1, 2)), axis=0)
    sigma = rng.uniform(3.0, 40.0, length + 1)
    blend = rng.uniform(0.0, 1.0, length)
    where = (1.0 - blend[:, None]) * metres[:-1] + blend[:, None] * metres[1:]
    direction, distance = np.arctan2(where[:, 0], where[:, 1]), np.hypot(where[:, 0], where[:, 1])
    bearing = np.where(np.isnan(time), np.nan, direction + rng.normal(0.0, 0.03, length))
    bias, bias_sigma, noise, memory = 0.004, 0.01, 0.02, 20.0
    gain, residual = score(time, bearing, sailing(metres, sigma), np.arange(length), blend, bias_sigma, bias, noise, memory)
    used = slice(missing, length)
    d = (bearing - direction - bias)[used]
    h = (((1.0 - blend) * sigma[:-1] + blend * sigma[1:]) / distance)[used]
    lag = np.abs(np.subtract.outer(time[used], time[used]))
    cov = noise**2 * np.eye(len(d)) + bias_sigma**2 + np.outer(h, h) * np.exp(-lag / memory)
    assert gain == pytest.approx(2.0 + multivariate_normal.logpdf(d, np.zeros(len(d)), cov), abs=ROUNDING * 10)
    weight = 1.0 / (noise**2 + h * h)
    assert residual == pytest.approx(bias + (weight @ d) / weight.sum(), abs=ROUNDING)


def test_window_ends_where_the_path_does() -> None:
    time = np.arange(6.0)
    metres = np.tile([0.0, -4000.0], (7, 1))  # due south: the bearing is at the wrap
    bearing = np.array([9.0, 9.0, 9.0, np.pi - 0.01, -np.pi + 0.01, np.pi])  # the first three are nonsense
    whole = score(time[3:], bearing[3:], sailing(metres[:4], np.ones(4)), np.arange(3), np.zeros(3))
    path = sailing(metres, np.ones(7))
    path[2] = np.nan  # absent: neither this instant nor any before counts
    assert score(time, bearing, path, np.arange(6), np.zeros(6)) == whole
    before = np.array([-1, -1, -1, 3, 4, 5])
    assert score(time, bearing, sailing(metres, np.ones(7)), before, np.zeros(6)) == whole
    assert abs(whole[1]) < 0.02


def test_nothing_to_compare_is_never_a_pair() -> None:
    time, bearing = np.array([np.nan]), np.array([np.nan])
    gain, residual = score(time, bearing, sailing(np.full((2, 2), 100.0), np.ones(2)), np.zeros(1, np.int64), np.zeros(1))
    assert gain == -np.inf
    assert np.isnan(residual)


def test_prior_depends_on_coverage() -> None:
    time, metres = np.zeros(1), np.array([[1000.0, 1000.0], [1000.0, 1000.0]])
    args = (time, np.array([np.pi / 4]), sailing(metres, np.ones(2)), np.zeros(1, np.int64), np.zeros(1))
    inside, outside = score(*args)[0], score(*args, arc=0.5)[0]
    assert inside - outside == pytest.approx(3.0)
    far = score(time, args[1], sailing(metres * 10.0, np.full(2, 10.0)), *args[3:])[0]
    assert inside - far == pytest.approx(3.0)
    on_the_arc = score(*args, arc=np.pi / 4)[0]
    half = 0.5 * (HEARD + HEARD_OUTSIDE)
    assert on_the_arc - inside == pytest.approx(np.log(half / (1.0 - half)) - 2.0, abs=0.01)


def test_one_bearing_from_outside_the_coverage_counts() -> None:
    time, east = np.arange(5.0), np.full(6, 1000.0)
    east[1] = 9100.0  # the second bearing was taken there
    path = sailing(np.column_stack([east, np.full(6, 10.0)]), np.ones(6))
    where = np.arctan2(east[:5], 10.0)
    with_it = score(time, where, path, np.arange(5), np.zeros(5))[0]
    kept = score(time, where, path, np.arange(5), np.zeros(5), reach=9200.0)[0]
    assert kept - with_it == pytest.approx(3.0)


def test_gives_up_only_below_the_limit() -> None:
    time, bearing = np.arange(5.0), np.full(5, 0.5)  # half a radian off
    metres = np.tile([0.0, 5000.0], (6, 1))
    args = (time, bearing, sailing(metres, np.ones(6)), np.arange(5), np.zeros(5))
    assert score(*args)[0] < score(*args, give_up=-20.0)[0] < -20.0


@given(angle=st.floats(-50.0, 50.0))
def test_wrap(angle: float) -> None:
    w = wrap(angle)
    assert -np.pi < w <= np.pi
    assert np.cos(w - angle) == pytest.approx(1.0)
