"""Paths: what vessels were at past instants, against what was put in."""

from __future__ import annotations

import numpy as np
from bearing_run import SEED

from coastwatch.associations.bearing_history import Path, values_of


def test_path_keeps_what_the_window_needs() -> None:
    path = Path.empty()
    for k in range(10):
        ids = np.array([1, 5]) if k % 2 else np.array([5])
        path = path.extended(ids, np.full((len(ids), 1), float(k)), 10.0 * k, 35.0, 1.0)
    assert path.ids.tolist() == [1, 5]
    assert path.time_s.tolist() == [50.0, 60.0, 70.0, 80.0, 90.0]  # one at or before 55, then the window
    held = values_of(path.values, path.slots(np.array([1, 5, 6])))[:, :, 0]
    nothing = [np.nan] * 5
    np.testing.assert_array_equal(held, [[5.0, np.nan, 7.0, np.nan, 9.0], [5.0, 6.0, 7.0, 8.0, 9.0], nothing])
    newest = path.newest(2)
    np.testing.assert_array_equal(values_of(newest.values, newest.slots(np.array([1]))), [[[np.nan], [9.0]]])
    for k in range(1, 200):
        path = path.extended(np.array([7]), np.full((1, 1), float(k)), 90.0 + 0.3 * k, 35.0, 1.0)
    assert path.ids.tolist() == [7]
    assert len(path.time_s) <= 36
    assert path.time_s[-1] == 90.0 + 0.3 * 199
    again = path.extended(np.array([7]), np.ones((1, 1)), float(path.time_s[-1]), 35.0, 1.0)
    assert again.time_s.tolist() == path.time_s.tolist()


def test_a_slot_is_used_again_once_nothing_of_its_vessel_is_left() -> None:
    """Against a dict of what each vessel had at each instant, with vessels that come, go, are unknown for a while and come back."""
    rng = np.random.default_rng([SEED, 12])
    path, had, most, time_s = Path.empty(), {}, 0, 0.0
    for k in range(200):
        time_s += [0.4, 3.0][int(rng.integers(2))]
        ids = rng.permutation(np.arange(k // 4, k // 4 + 40))[: int(rng.integers(1, 40))]
        values = rng.normal(size=(len(ids), 2))
        values[rng.uniform(size=len(ids)) < 0.2] = np.nan
        before = path.time_s
        path = path.extended(ids, values, time_s, 20.0, 1.0)
        for gone in set(before.tolist()) - set(path.time_s.tolist()):
            had.pop(gone)
        had[time_s] = dict(zip(ids.tolist(), values, strict=True))
        assert sorted(had) == path.time_s.tolist()
        every = np.arange(k // 4 + 60)
        got = values_of(path.values, path.slots(every))
        for t, instant in enumerate(path.time_s.tolist()):
            expected = [had[instant].get(i, np.full(2, np.nan)) for i in every.tolist()]
            np.testing.assert_array_equal(got[:, t], expected)
        assert (np.diff(path.ids) > 0).all()
        most = max(most, int(path.slot.max(initial=-1)) + 1)
    assert most < 70  # of 90 vessels, of which 40 and those of the window are there at a time
