"""The recursions over windows of bearings equal the densities written out with full covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from coastwatch.geodesy import earth_centred, from_plane
from coastwatch.kernels.association.history import addresses
from coastwatch.kernels.bearings.likelihood import known_vessels
from coastwatch.kernels.bearings.null_hypothesis import RANGES, Strangers, unknown_vessels
from coastwatch.kernels.bearings.windows import LANES, Paths, Rule, Windows

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
def test_unknown_vessel_is_the_dense_gaussian_mixture(seed: int, length: int, missing: int) -> None:
    missing = min(missing, length)
    time, bearing = window(seed, length, missing)
    share, weight = np.array([1.0, 0.3]), np.array([0.8, 0.2])
    variance, reach, speed, kick = 4e-4, 5000.0, 5.0, 0.01
    one, strangers = np.zeros(1, np.int64), Strangers(share, weight, speed, kick)
    out = unknown_vessels(one, time[None], bearing[None], np.array([variance]), np.array([reach]), strangers)
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


def test_unknown_vessels_are_the_same_alone_and_in_company() -> None:
    rng = np.random.default_rng([7, 3])
    windows = [window(seed, 9, seed % 10) for seed in range(70)]
    time, bearing = (np.array([w[k] for w in windows]) for k in range(2))
    variance, reach = rng.uniform(1e-4, 1e-3, 70), rng.uniform(1e3, 2e4, 70)
    strangers = Strangers(np.array([1.0, 0.5, 0.1]), np.array([0.7, 0.2, 0.1]), 5.0, 0.01)
    row = rng.permutation(70)
    whole = unknown_vessels(row, time, bearing, variance, reach, strangers)
    alone = [unknown_vessels(row[k : k + 1], time, bearing, variance, reach, strangers) for k in range(70)]
    np.testing.assert_array_equal(whole, np.concatenate(alone))
    many = Strangers(np.ones(RANGES + 1), np.ones(RANGES + 1), 5.0, 0.01)
    with pytest.raises(ValueError, match="at most"):
        unknown_vessels(row, time, bearing, variance, reach, many)


def scores(
    time, bearing, paths, slot, start, bias_sigma=0.01, bias=0.0, sigma=0.02, memory=20.0, give_up=GIVE_UP, arc=2 * np.pi,
    reach=9000.0, instant=None, site=SITE_DEG, row=None,
):  # fmt: skip
    """Gains (against a null of 0) and residuals of pairs: time, bearing (N, W), paths (T, S, 4), slot (A,), start (N + 1,)."""
    n, w = time.shape
    arrays, full = tuple(np.ascontiguousarray(a) for a in paths), np.full
    site = np.broadcast_to(site, (n, w, 2)).copy()
    windows = Windows(
        time, bearing, site, np.zeros(n), full(n, HEARD_OUTSIDE), full(n, reach), np.zeros(n), full(n, arc), full(n, bias),
        full(n, bias_sigma**2), full(n, sigma**2),
    )  # fmt: skip
    table = addresses(arrays, 4)[::-1].copy()
    known = Paths(np.asarray(instant, float), table, np.array([len(a) for a in arrays], np.int64))
    row = np.arange(n) if row is None else row
    gain, residual = np.empty(len(slot)), np.empty(len(slot))
    rule = Rule(HEARD, 2.0, memory, give_up)
    known_vessels(0, len(row), row, start, slot, windows, np.zeros((len(row), w + 1)), known, rule, gain, residual)
    return gain, residual


def score(time, bearing, path, instant, **more):
    """Gain and residual of one pair; path: (T, 4) at the instants (T,)."""
    gain, residual = scores(
        time[None], bearing[None], path[:, None], np.zeros(1, np.int64), np.array([0, 1]), instant=instant, **more
    )
    return gain[0], residual[0]


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
    bias, bias_sigma, noise, memory = 0.004, 0.01, 0.02, 20.0
    given_ = {"bias_sigma": bias_sigma, "bias": bias, "sigma": noise, "memory": memory}
    gain, residual = score(s["time"], s["bearing"], s["path"], s["instant"], **given_)
    used = np.isfinite(s["time"])
    d, t, h = s["bearing"][used] - s["direction"] - bias, s["time"][used], s["h"]
    lag = np.abs(np.subtract.outer(t, t))
    cov = noise**2 * np.eye(len(d)) + bias_sigma**2 + np.outer(h, h) * np.exp(-lag / memory)
    assert gain == pytest.approx(2.0 + multivariate_normal.logpdf(d, np.zeros(len(d)), cov), abs=ROUNDING * 10)
    weight = 1.0 / (noise**2 + h * h)
    assert residual == pytest.approx(bias + (weight @ d) / weight.sum(), abs=ROUNDING)


def test_pairs_are_the_same_alone_and_in_company() -> None:
    """More pairs than lanes, of tracks with windows of all lengths, some given up, some absent: each as alone, whatever order."""
    rng = np.random.default_rng([8, 3])
    n, w, vessels = 40, 20, 30
    time = np.tile(np.arange(w) * 3.0, (n, 1)) + rng.uniform(0.0, 1.0, (n, w))
    bearing = np.cumsum(rng.normal(0.0, 0.002, (n, w)), axis=1) + rng.uniform(-0.3, 0.3, (n, 1))
    for i in range(n):
        time[i, : i % w], bearing[i, : i % w] = np.nan, np.nan
    instant = np.arange(w + 1) * 3.0 - 0.5
    start_m = np.column_stack([rng.uniform(-1500.0, 1500.0, vessels), rng.uniform(3000.0, 6000.0, vessels)])
    metres = start_m[None] + np.cumsum(rng.normal(0.0, 5.0, (w + 1, vessels, 2)), axis=0)
    paths = np.array([sailing(m, np.full(vessels, 10.0)) for m in metres])
    paths[5, ::3] = np.nan
    slot = np.tile(np.append(np.arange(vessels), [-1, vessels + 3]), n)
    site = SITE_DEG + rng.normal(0.0, 1e-3, (n, w, 2)) * (np.arange(n) % 2)[:, None, None]  # every second sensor moves
    size = len(slot) // n
    said = {"instant": instant, "give_up": -25.0, "arc": np.pi}
    gain, residual = scores(time, bearing, paths, slot, np.arange(n + 1) * size, site=site, **said)
    assert len(slot) > 10 * LANES
    assert np.isneginf(gain).sum() >= 2 * n
    assert (gain < -25.0).sum() > 100
    assert (gain > 0.0).sum() > 20
    for i in rng.permutation(n)[:12]:
        for a in range(i * size, (i + 1) * size):
            one = scores(time, bearing, paths, slot[a : a + 1], np.array([0, 1]), site=site, row=np.array([i]), **said)
            np.testing.assert_array_equal(one, ([gain[a]], [residual[a]]))


def test_the_newest_bearing_rules_out_only_what_it_alone_would() -> None:
    """Vessels all around, near and far, known well and badly: whoever has log odds left after the newest bearing is walked on with."""
    rng = np.random.default_rng([9, 3])
    vessels, limit = 800, -25.0
    turn, distance = rng.uniform(-np.pi, np.pi, vessels), 10.0 ** rng.uniform(-1.0, 4.0, vessels)
    place = sailing(distance[:, None] * np.column_stack([np.sin(turn), np.cos(turn)]), rng.uniform(0.1, 300.0, vessels))
    time, bearing = np.array([[0.0, 1.0, 2.0]]), np.full((1, 3), 0.3)
    pairs, start, paths = np.arange(vessels), np.array([0, vessels]), np.array([place] * 4)
    said = {"instant": np.arange(4.0) - 0.5, "bias": 0.01}
    first, _ = scores(time[:, 2:], bearing[:, 2:], paths[2:], pairs, start, instant=said["instant"][2:], bias=0.01)
    whole, _ = scores(time, bearing, paths, pairs, start, **said)
    gain, residual = scores(time, bearing, paths, pairs, start, give_up=limit, **said)
    ruled_out = np.isnan(residual)
    assert ruled_out.sum() > 100
    assert (first[ruled_out] < limit).all()
    assert (gain[ruled_out] < limit).all()
    assert np.isfinite(residual[first >= limit]).all()
    kept = gain >= limit
    assert kept.sum() > 100
    np.testing.assert_array_equal(gain[kept], whole[kept])


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


def test_a_slot_that_came_later_was_absent() -> None:
    time, instant, metres = np.arange(3.0), np.arange(4.0) - 0.5, np.tile([0.0, 4000.0], (4, 1))
    bearing, path = np.array([[0.3, 0.01, -0.01]]), sailing(metres, np.ones(4))
    late = [path[0][None], *(np.stack([p, p]) for p in path[1:])]  # slot 1 was not there at first
    slot, start = np.array([1]), np.array([0, 1])
    gain, _ = scores(time[None], bearing, late, slot, start, instant=instant)
    assert gain[0] == score(time[1:], bearing[0, 1:], path[1:], instant[1:])[0]


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
    assert kept - with_it == pytest.approx(3.0)


def test_gives_up_only_below_the_limit() -> None:
    time, bearing = np.arange(5.0), np.full(5, 0.5)  # half a radian off
    args = (time, bearing, sailing(np.tile([0.0, 5000.0], (6, 1)), np.ones(6)), np.arange(6.0))
    assert score(*args)[0] < score(*args, give_up=-20.0)[0] < -20.0
