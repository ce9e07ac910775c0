"""Histories of positions: where vessels were at past instants, against a dict of what was put in."""

from __future__ import annotations

import numpy as np
import pytest
from bearing_run import SEED

from coastwatch.associations.bearing_likelihood import PositionHistory
from coastwatch.batches import Floats, Ints

pytestmark = pytest.mark.contract


def rows(values: Floats) -> Floats:
    return np.repeat(np.asarray(values, float)[:, None], 4, axis=1)


def held(positions: PositionHistory, ids: Ints) -> Floats:
    """What each of these ids had at each instant, oldest first, NaN for nothing. Returns: (M, T)."""
    slot = positions.history.slots_of(ids)
    out: Floats = positions.history.values[np.maximum(slot, 0)][:, positions.columns(), 0]
    out[slot < 0] = np.nan
    return out


def instants(positions: PositionHistory) -> Floats:
    return positions.time_s[positions.columns()]


def test_the_window_and_one_instant_before_it() -> None:
    positions = PositionHistory.empty()
    for k in range(20):
        ids = np.array([1, 5]) if k % 2 else np.array([5])
        positions = positions.extended(ids, rows([k] * len(ids)), 10.0 * k, 35.0, 1.0)
    assert instants(positions)[-5:].tolist() == [150.0, 160.0, 170.0, 180.0, 190.0]  # one at or before 155, then the window
    expected = [[15.0, np.nan, 17.0, np.nan, 19.0], [15.0, 16.0, 17.0, 18.0, 19.0], [np.nan] * 5]
    np.testing.assert_array_equal(held(positions, np.array([1, 5, 6]))[:, -5:], expected)


def test_a_fast_clock_needs_no_more_memory() -> None:
    positions = PositionHistory.empty()
    for k in range(400):
        positions = positions.extended(np.array([7]), rows([k]), 0.3 * k, 35.0, 1.0)
    time_s = instants(positions)
    assert time_s[-1] == 0.3 * 399
    assert time_s[0] <= time_s[-1] - 35.0
    assert (np.diff(time_s)[:-1] >= 1.0).all()
    assert positions.history.window <= 48
    again = positions.extended(np.array([7]), rows([1.0]), float(time_s[-1]), 35.0, 1.0)
    assert instants(again).tolist() == time_s.tolist()


def test_against_a_dict_with_vessels_that_come_and_go() -> None:
    """Vessels come, go, are unknown for a while and come back; slots are used again, with nothing of the last vessel in them."""
    rng = np.random.default_rng([SEED, 12])
    positions, had, time_s, first_s = PositionHistory.empty(), {}, 0.0, 0.0
    for k in range(300):
        time_s += [0.4, 3.0][int(rng.integers(2))]
        ids = np.sort(rng.permutation(np.arange(k // 4, k // 4 + 40))[: int(rng.integers(1, 40))])
        values = rows(rng.normal(size=len(ids)))
        values[rng.uniform(size=len(ids)) < 0.2] = np.nan
        before = instants(positions).tolist()
        positions = positions.extended(ids, values, time_s, 20.0, 1.0)
        for gone in set(before) - set(instants(positions).tolist()):
            had.pop(gone)
        had[time_s] = dict(zip(ids.tolist(), values[:, 0].tolist(), strict=True))
        now = instants(positions)
        assert sorted(had) == now.tolist()
        first_s = first_s if k else time_s
        assert now[0] <= max(time_s - 20.0, first_s)
        every = np.arange(k // 4 + 60)
        expected = [[had[t].get(i, np.nan) for t in now.tolist()] for i in every.tolist()]
        np.testing.assert_array_equal(held(positions, every), expected)
    assert len(positions.history.values) < 100  # of 115 vessels, of which 40 and those of the window are there at a time
