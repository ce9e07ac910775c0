"""The recursions over windows of bearings equal the densities written out with full covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import multivariate_normal

from coastwatch.geodesy import earth_centred, from_plane
from coastwatch.kernels.bearings.likelihood import Hypotheses, TrackPairs, log_odds
from coastwatch.kernels.bearings.null_hypothesis import UnknownVessel, unknown_log_density
from coastwatch.kernels.bearings.windows import BearingWindows, PositionWindows

pytestmark = pytest.mark.oracle

ROUNDING = 1e-6  # log density: the dense form inverts a matrix of condition 1e6
FLAT = 1e5  # rad^2, variance that stands for a flat offset in the dense form
FLAT_ERROR = 1e-4  # what that costs
SITE_DEG = np.array([-22.9, -43.1])
GIVE_UP = -1e9
UNKNOWN = UnknownVessel(np.array([1.0, 0.3]), np.array([0.8, 0.2]), 5.0, 0.01)


def window(seed: int, length: int, missing: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([seed, 3])
    time = np.cumsum(rng.uniform(0.5, 6.0, length))
    bearing = 0.4 + 0.002 * time + rng.normal(0.0, 0.02, length)
    time[:missing], bearing[:missing] = np.nan, np.nan
    return time, bearing


@given(seed=st.integers(0, 10_000), length=st.integers(1, 12), missing=st.integers(0, 12))
def test_unknown_vessel_is_the_dense_gaussian_mixture(seed: int, length: int, missing: int) -> None:
    missing = min(missing, length)
    time, bearing = window(seed, length, missing)
    share, weight, speed, kick = UNKNOWN
    variance, reach = np.random.default_rng([seed, 5]).uniform(4e-4, 9e-4, length), 5000.0
    out = np.empty(length + 1)
    unknown_log_density(time, bearing, variance, reach, UNKNOWN, out)
    assert out[0] == 0.0
    for n in range(1, length - missing + 1):
        t, z = time[length - n :][::-1], bearing[length - n :][::-1]
        a, noises = t[0] - t, variance[length - n :][::-1]
        terms = []
        for s in share:
            r = reach * s
            noise = (speed / r) ** 3 + kick / r**2
            low, high = np.minimum.outer(a, a), np.maximum.outer(a, a)
            cov = np.diag(noises) + FLAT + (speed / r) ** 2 * np.outer(a, a) + noise * low**2 * (3.0 * high - low) / 6.0
            terms.append(multivariate_normal.logpdf(z, np.zeros(n), cov) + 0.5 * np.log(2.0 * np.pi * FLAT))
        assert out[n] == pytest.approx(np.log(np.exp(terms) @ weight), abs=FLAT_ERROR * n)
    assert (out[length - missing :] == out[length - missing]).all()


HEARD, HEARD_OUTSIDE = 1.0 / (1.0 + np.exp(-2.0)), 1.0 / (1.0 + np.exp(1.0))  # log odds 2 and -1


def test_a_bearing_that_no_range_explains_has_a_finite_density() -> None:
    time, bearing = np.arange(4.0), np.array([0.1, 0.1, 3.0, 0.1])
    out = np.empty(5)
    unknown_log_density(time, bearing, np.full(4, 1e-6), 5000.0, UNKNOWN, out)
    assert np.isfinite(out).all()
    assert out[3] < -1e4


def scores(
    time, bearing, values, slot, start, bias_sigma=0.01, bias=0.0, sigma=0.02, memory=20.0, rejection_log_odds=GIVE_UP, arc=2 * np.pi,
    reach=9000.0, instant=None, site=SITE_DEG, row=None,
):  # fmt: skip
    """Log odds and mean differences of pairs: time, bearing (N, W), values (T, S, 4), slot (A,), start (N + 1,)."""
    n, w = time.shape
    full, value = np.full, np.ascontiguousarray(np.moveaxis(values, 0, 1))
    site = np.broadcast_to(site, (n, w, 2)).copy()
    windows = BearingWindows(
        time, bearing, site, np.zeros(n), full(n, HEARD_OUTSIDE), full(n, reach), np.zeros(n), full(n, arc), full(n, bias),
        full(n, bias_sigma**2), np.broadcast_to(np.square(sigma), (n, w)).copy(),
    )  # fmt: skip
    positions = PositionWindows(np.asarray(instant, float), np.arange(len(instant)), value)
    row, out = np.arange(n) if row is None else row, np.empty((len(slot), 2))
    hypotheses = Hypotheses(HEARD, memory, rejection_log_odds, UNKNOWN)
    log_odds(0, len(row), TrackPairs(row, start, slot), windows, positions, hypotheses, out)
    return out.T


def score(time, bearing, values, instant, **more):
    """Log odds and mean difference of one pair; values: (T, 4) at the instants (T,)."""
    odds, difference = scores(
        time[None], bearing[None], values[:, None], np.zeros(1, np.int64), np.array([0, 1]), instant=instant, **more
    )
    return odds[0], difference[0]


def unknown(time, bearing, sigma=0.02, reach=9000.0):
    """Log density of the whole window if it comes from an unknown vessel."""
    out = np.empty(len(time) + 1)
    unknown_log_density(time, bearing, np.broadcast_to(np.square(sigma), time.shape).copy(), reach, UNKNOWN, out)
    return out[-1]


def sailing(metres: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    return np.column_stack([earth_centred(from_plane(metres, SITE_DEG)), sigma])


def sighting(seed: int, length: int, missing: int) -> dict[str, np.ndarray]:
    """A window, the path of a vessel at its own instants, and where the vessel was when each bearing was taken."""
    rng = np.random.default_rng([seed, 4])
    time, _ = window(seed, length, missing)
    first = time[missing]
    instant = np.concatenate([[first - 1.0], np.sort(rng.uniform(first, time[-1] + 1.0, 6)), [time[-1] + 1.0]])
    metres = np.array([2500.0, -1500.0]) + np.cumsum(rng.normal(0.0, 15.0, (8, 2)), axis=0)
    sigma = rng.uniform(3.0, 40.0, 8)
    used = slice(missing, length)
    where = np.column_stack([np.interp(time[used], instant, metres[:, k]) for k in range(2)])
    seen = np.full(length, np.nan)
    direction, distance = np.arctan2(where[:, 0], where[:, 1]), np.hypot(where[:, 0], where[:, 1])
    seen[used] = direction + rng.normal(0.0, 0.03, length - missing)
    h = np.interp(time[used], instant, sigma) / distance
    return {"time": time, "bearing": seen, "path": sailing(metres, sigma), "instant": instant, "direction": direction, "h": h}


@given(seed=st.integers(0, 10_000), length=st.integers(1, 12), missing=st.integers(0, 11))
def test_known_vessel_is_the_dense_gaussian(seed: int, length: int, missing: int) -> None:
    s = sighting(seed, length, min(missing, length - 1))
    bias, bias_sigma, noise, memory = 0.004, 0.01, np.random.default_rng([seed, 6]).uniform(0.01, 0.04, length), 20.0
    given_ = {"bias_sigma": bias_sigma, "bias": bias, "sigma": noise, "memory": memory}
    gain, residual = score(s["time"], s["bearing"], s["path"], s["instant"], **given_)
    used = np.isfinite(s["time"])
    d, t, h = s["bearing"][used] - s["direction"] - bias, s["time"][used], s["h"]
    lag = np.abs(np.subtract.outer(t, t))
    cov = np.diag(noise[used] ** 2) + bias_sigma**2 + np.outer(h, h) * np.exp(-lag / memory)
    known = multivariate_normal.logpdf(d, np.zeros(len(d)), cov)
    assert gain == pytest.approx(2.0 + known - unknown(s["time"], s["bearing"], noise), abs=ROUNDING * 10)
    weight = 1.0 / (noise[used] ** 2 + h * h)
    assert residual == pytest.approx(bias + (weight @ d) / weight.sum(), abs=ROUNDING)


def test_pairs_are_the_same_alone_and_in_company() -> None:
    """Tracks with windows of all lengths, some pairs given up, some vessels absent: each as alone, whatever order."""
    rng = np.random.default_rng([8, 3])
    n, w, vessels = 40, 20, 30
    time = np.tile(np.arange(w) * 3.0, (n, 1)) + rng.uniform(0.0, 1.0, (n, w))
    bearing = np.cumsum(rng.normal(0.0, 0.002, (n, w)), axis=1) + rng.uniform(-0.3, 0.3, (n, 1))
    for i in range(n):
        time[i, : i % w], bearing[i, : i % w] = np.nan, np.nan
    instant = np.arange(w + 1) * 3.0 - 0.5
    start_m = np.column_stack([rng.uniform(-1500.0, 1500.0, vessels), rng.uniform(3000.0, 6000.0, vessels)])
    metres = start_m[None] + np.cumsum(rng.normal(0.0, 5.0, (w + 1, vessels, 2)), axis=0)
    values = np.array([sailing(m, np.full(vessels, 10.0)) for m in metres])
    values[5, ::3] = np.nan
    slot = np.tile(np.append(np.arange(vessels), -1), n)
    site = SITE_DEG + rng.normal(0.0, 1e-3, (n, w, 2)) * (np.arange(n) % 2)[:, None, None]  # every second sensor moves
    size = len(slot) // n
    more = {"instant": instant, "rejection_log_odds": -25.0, "arc": np.pi}
    odds, difference = scores(time, bearing, values, slot, np.arange(n + 1) * size, site=site, **more)
    whole = scores(time, bearing, values, slot, np.arange(n + 1) * size, site=site, **{**more, "rejection_log_odds": GIVE_UP})
    assert np.isneginf(odds).sum() == n
    assert (odds < -25.0).sum() > 100
    assert (odds > 0.0).sum() > 20
    np.testing.assert_array_equal(odds[odds >= -20.0], whole[0][odds >= -20.0])  # whoever was given up has less
    for i in rng.permutation(n)[:12]:
        for a in range(i * size, (i + 1) * size):
            one = scores(time, bearing, values, slot[a : a + 1], np.array([0, 1]), site=site, row=np.array([i]), **more)
            np.testing.assert_array_equal(one, ([odds[a]], [difference[a]]))


def test_window_ends_where_the_path_does() -> None:
    time, instant = np.arange(6.0), np.arange(7.0) - 0.25
    metres = np.tile([0.0, -4000.0], (7, 1))  # due south: the bearing is at the wrap
    bearing = np.array([9.0, 9.0, 9.0, np.pi - 0.01, -np.pi + 0.01, np.pi])  # the first three are nonsense
    whole = score(time[3:], bearing[3:], sailing(metres[:4], np.ones(4)), instant[3:])
    path = sailing(metres, np.ones(7))
    path[2] = np.nan  # absent: neither this instant nor any before counts
    assert score(time, bearing, path, instant) == whole
    assert score(time, bearing, sailing(metres[:4], np.ones(4)), instant[3:]) == whole  # no instants before
    assert abs(whole[1]) < 0.02


def test_nothing_to_compare_is_never_a_pair() -> None:
    time, bearing, path = np.array([np.nan]), np.array([np.nan]), sailing(np.full((2, 2), 100.0), np.ones(2))
    for instants in (0, 1, 2):
        some = path[:instants]
        gain, residual = score(time, bearing, some, np.arange(float(instants)))
        assert gain == -np.inf
        assert np.isnan(residual)


def test_prior_depends_on_coverage() -> None:
    time, instant, metres = np.zeros(1), np.array([-0.5, 0.5]), np.array([[1000.0, 1000.0], [1000.0, 1000.0]])
    bearing = np.array([np.pi / 4])
    args = (time, bearing, sailing(metres, np.ones(2)), instant)
    inside, outside = score(*args)[0], score(*args, arc=0.5)[0]
    assert inside - outside == pytest.approx(3.0)
    far = score(time, bearing, sailing(metres * 10.0, np.full(2, 10.0)), instant)[0]
    assert inside - far == pytest.approx(3.0)
    on_the_arc = score(*args, arc=np.pi / 4)[0]
    half = 0.5 * (HEARD + HEARD_OUTSIDE)
    assert on_the_arc - inside == pytest.approx(np.log(half / (1.0 - half)) - 2.0, abs=0.01)


def test_one_bearing_from_outside_the_coverage_counts() -> None:
    time, east = np.arange(5.0), np.full(6, 1000.0)
    east[1] = 9100.0  # the second bearing was taken there
    path, instant = sailing(np.column_stack([east, np.full(6, 10.0)]), np.ones(6)), np.arange(6.0)
    where = np.arctan2(east[:5], 10.0)
    with_it = score(time, where, path, instant)[0]
    kept = score(time, where, path, instant, reach=9200.0)[0]
    null = unknown(time, where, reach=9200.0) - unknown(time, where)
    assert kept + null - with_it == pytest.approx(3.0)


def test_gives_up_only_below_the_limit() -> None:
    time, bearing = np.arange(5.0), np.full(5, 0.5)  # half a radian off
    args = (time, bearing, sailing(np.tile([0.0, 5000.0], (6, 1)), np.ones(6)), np.arange(6.0))
    assert score(*args)[0] < score(*args, rejection_log_odds=-20.0)[0] < -20.0
