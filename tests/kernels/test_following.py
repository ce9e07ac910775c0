"""Rows of one cycle found in the last, ids among others, and rows in groups, against dictionaries and numpy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.tables.grouping import grouped, preferred
from coastwatch.kernels.tables.match_ids import PATIENCE, among, followed, standing

IDS = st.lists(st.integers(-(2**62), 2**62), max_size=40, unique=True)


def check(before, now):
    at, to = followed(np.array(before, np.int64), np.array(now, np.int64))
    rows = {k: row for row, k in enumerate(before)}
    assert at.tolist() == [rows.get(k, -1) for k in now]
    rows = {k: row for row, k in enumerate(now)}
    assert to.tolist() == [rows.get(k, -1) for k in before]


@given(IDS, IDS, st.randoms(use_true_random=False))
def test_rows_are_found_in_any_order(kept, more, random):
    before = kept + [k for k in more if k not in kept][::2]
    now = kept + [k for k in more if k not in kept][1::2]
    check(before, now)
    random.shuffle(now)
    check(before, now)


def test_rows_are_found_after_many_have_gone_or_come():
    ids = np.arange(20 * PATIENCE) * 7
    for gone in (slice(0, 5 * PATIENCE), slice(100, 10 * PATIENCE), slice(0, None, 2)):
        some = np.delete(ids, gone)
        check(ids.tolist(), some.tolist())
        check(some.tolist(), ids.tolist())
    check(ids.tolist(), ids[::-1].tolist())
    check([], ids.tolist())
    check(ids.tolist(), [])


def test_the_same_arrays_are_followed_once_and_others_anew():
    before, now = np.array([3, 1, 2]), np.array([2, 3, 9])
    once = followed(before, now)
    assert followed(before, now) is once
    assert followed(before, now[::-1].copy())[0].tolist() == [-1, 0, 2]
    assert followed(before[::-1].copy(), now)[0].tolist() == [0, 2, -1]
    assert followed(before, now)[0].tolist() == once[0].tolist() == [2, 0, -1]


@given(st.lists(st.integers(0, 30), max_size=60), st.lists(st.integers(0, 30), max_size=20))
def test_wanted_ids_are_among_others(ids, wanted):
    ids, wanted = np.array(ids, np.int64), np.array(wanted, np.int64)
    np.testing.assert_array_equal(among(ids, wanted), np.isin(ids, wanted))


@given(IDS, IDS, st.integers(-2, 5))
def test_wanted_ids_stand_where_they_are_guessed_or_elsewhere(ids, more, shift):
    wanted = np.array(list(dict.fromkeys(ids[::3] + more))[:20], np.int64)
    guess = np.arange(len(wanted)) * 3 + shift
    rows = {k: row for row, k in enumerate(ids)}
    assert standing(np.array(ids, np.int64), wanted, guess).tolist() == [rows.get(int(k), -1) for k in wanted]


@given(st.lists(st.integers(0, 9), max_size=60), st.integers(0, 10**6))
def test_rows_in_groups(group, seed):
    group = np.array(group, np.int64)
    start, row = grouped(group, 10)
    assert start.tolist() == np.searchsorted(np.sort(group), np.arange(11)).tolist()
    assert row.tolist() == np.argsort(group, kind="stable").tolist()
    preference = np.random.default_rng(seed).integers(0, 4, len(group))
    assert preferred(start, row, preference).tolist() == np.lexsort((preference, group)).tolist()
