"""Rows of ids among other ids, and rows in groups, against dictionaries and numpy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.tables.counting_sort import counting_sort, preferred
from coastwatch.kernels.tables.match_ids import LOOK_AHEAD, index_of, match_ids

pytestmark = pytest.mark.oracle

IDS = st.lists(st.integers(-(2**62), 2**62), max_size=40, unique=True)


def check(before, now):
    at, to = match_ids(np.array(before, np.int64), np.array(now, np.int64))
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
    ids = np.arange(80 * LOOK_AHEAD) * 7
    for gone in (slice(0, 20 * LOOK_AHEAD), slice(100, 40 * LOOK_AHEAD), slice(0, None, 2)):
        some = np.delete(ids, gone)
        check(ids.tolist(), some.tolist())
        check(some.tolist(), ids.tolist())
    check(ids.tolist(), ids[::-1].tolist())
    check([], ids.tolist())
    check(ids.tolist(), [])


@given(st.lists(st.integers(0, 30), max_size=60, unique=True), st.lists(st.integers(0, 40), max_size=60))
def test_an_id_may_be_wanted_more_than_once(ids, wanted):
    rows = {k: row for row, k in enumerate(ids)}
    for order in (wanted, sorted(wanted)):
        found = index_of(np.array(ids, np.int64), np.array(order, np.int64))
        assert found.tolist() == [rows.get(k, -1) for k in order]


@given(st.lists(st.integers(0, 9), max_size=60), st.integers(0, 10**6))
def test_rows_in_groups(group, seed):
    group = np.array(group, np.int64)
    start, row = counting_sort(group, 10)
    assert start.tolist() == np.searchsorted(np.sort(group), np.arange(11)).tolist()
    assert row.tolist() == np.argsort(group, kind="stable").tolist()
    preference = np.random.default_rng(seed).integers(0, 4, len(group))
    assert preferred(start, row, preference).tolist() == np.lexsort((preference, group)).tolist()
