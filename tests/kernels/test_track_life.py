"""Looks, confirmation, deletion and duplicates of radar tracks against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from tracker_world import columns_of, estimates_of

from coastwatch.kernels.tracks.columns import CONFIRMED, SINGLE, RadarColumns, TrackLife
from coastwatch.kernels.tracks.duplicates import possible_duplicates
from coastwatch.kernels.tracks.track_life import LifeRules, confirm_and_find_lost, record

pytestmark = pytest.mark.oracle

RULES = LifeRules(4, 5, 5, 0.5, 0.1, 30.0, own_looks=False)
BOTH = np.arange(2)
NOW = 20.0


def life_of(n: int, seed: int, radars: int = 2) -> TrackLife:
    rng = np.random.default_rng([seed, 61])
    hits = rng.integers(1, 12, n)
    status = np.where(hits == 1, SINGLE, rng.integers(1, 3, n))
    return TrackLife(
        status, hits, rng.uniform(-40.0, -12.0, n), rng.uniform(-12.0, 0.0, (n, radars)), rng.integers(0, 9, (n, 5))
    )


def looks(estimates, radars, since, slack):
    position = estimates.mean[:, :2] + estimates.mean[:, 2:] * (NOW - estimates.time)[:, None]
    covered = np.linalg.norm(position[:, None] - radars.site, axis=2) <= radars.range
    turns = np.floor(np.maximum(radars.newest - since[:, None], 0.0) / radars.period - slack)
    return np.where(covered, np.maximum(turns, 0.0), 0.0).sum(axis=1)


@given(st.integers(0, 30), st.integers(0, 10**6))
def test_the_lost_are_those_without_hits_in_their_looks(n, seed):
    life, estimates = life_of(n, seed), estimates_of(n, seed)
    radars = RadarColumns(
        np.array([[-300.0, 0.0], [300.0, 50.0]]), np.full(2, 400.0), np.array([4.0, 3.0]), np.array([19.0, -np.inf])
    )
    if seed % 2:
        radars.newest[1] = 18.0
    rows = np.flatnonzero(np.random.default_rng([seed, 62]).random(n) < 0.7)
    status = np.where(life.hits >= 4, CONFIRMED, life.status)
    newest = life.radar_time.max(axis=1)
    missed = looks(estimates, radars, newest, 0.1)
    age = 1 + looks(estimates, radars, life.started, 0.1)
    tries = np.where(status == SINGLE, 2, 5)
    lost = np.where(status == CONFIRMED, missed >= np.minimum(5, np.ceil(0.5 * life.hits)), age >= tries)
    lost |= newest < NOW - 30.0
    before = life.status.copy()
    got = confirm_and_find_lost(life, estimates, rows, radars, BOTH, RULES, NOW)
    assert np.array_equal(got, lost[rows])
    assert np.array_equal(life.status[rows], status[rows])
    assert np.array_equal(np.delete(life.status, rows), np.delete(before, rows))


@pytest.mark.parametrize("own_looks", [False, True])
@pytest.mark.parametrize(("hits", "status"), [(1, SINGLE), (3, 1), (20, CONFIRMED)])
def test_a_radar_that_turns_fast_does_not_delete_what_another_sees(own_looks, hits, status):
    """One radar turns 120 times a minute and never saw the track; the other saw it 2.9 s ago, in its turn of 3 s."""
    radars = RadarColumns(np.zeros((2, 2)), np.full(2, 5000.0), np.array([0.5, 3.0]), np.array([NOW, NOW]))
    estimates = estimates_of(1, 1)
    estimates.time[:] = NOW - 2.9
    started = np.array([NOW - 2.9 - 3.0 * (hits - 1)])
    life = TrackLife(
        np.array([status]), np.array([hits]), started, np.array([[-np.inf, NOW - 2.9]]), np.zeros((1, 5), np.int64)
    )
    rules = RULES._replace(own_looks=own_looks)
    assert confirm_and_find_lost(life, estimates, np.zeros(1, np.int64), radars, BOTH, rules, NOW)[0] != own_looks
    estimates.time[:] = life.radar_time[0, 1] = NOW - 3.0 * 5.2
    life.started[:] -= 3.0 * 5.2
    assert confirm_and_find_lost(life, estimates, np.zeros(1, np.int64), radars, BOTH, rules, NOW)[0], "its own looks end it"


def test_plots_are_recorded_in_their_order():
    life, columns = life_of(4, 1), columns_of(3, 1)
    columns.sensor[:] = [0, 1, 0]
    columns.origin[:] = [7, 8, 9]
    columns.time[:] = [1.0, 2.0, -50.0]
    kept = TrackLife(*(column.copy() for column in life))
    life.status[2] = SINGLE
    record(life, np.array([2, 0, 2]), np.array([0, 1, 2]), columns)
    assert (life.hits - kept.hits).tolist() == [1, 0, 2, 0]
    assert life.origins[2].tolist() == [9, 7, *kept.origins[2, :3]]
    assert life.radar_time[2, 0] == 1.0, "an older plot does not take the time back"
    assert life.radar_time[0, 1] == 2.0
    assert life.status[2] == 1
    assert np.array_equal(life.origins[[1, 3]], kept.origins[[1, 3]])


@given(st.integers(0, 40), st.integers(0, 10**6))
def test_possible_duplicates_are_all_pairs_alike(n, seed):
    estimates = estimates_of(n, seed)
    rows = np.random.default_rng([seed, 63]).permutation(n)[: n - n // 5]
    first, second = possible_duplicates(estimates, rows, NOW, 13.3, 0.0)
    want = []
    means, spreads = [], []
    for k in rows:
        dt, q = NOW - estimates.time[k], estimates.noise[k]
        f, noise = np.eye(4), np.zeros((4, 4))
        f[0, 2] = f[1, 3] = dt
        for a in (0, 1):
            noise[a, a], noise[a, a + 2], noise[a + 2, a], noise[a + 2, a + 2] = (
                q * dt**3 / 3,
                q * dt**2 / 2,
                q * dt**2 / 2,
                q * dt,
            )
        means.append(f @ estimates.mean[k])
        spreads.append(f @ estimates.covariance[k] @ f.T + noise)
    for a in range(len(rows)):
        for b in range(a + 1, len(rows)):
            gap = means[a] - means[b]
            if gap @ np.linalg.solve(spreads[a] + spreads[b], gap) <= 13.3:
                want.append((a, b))
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == want
