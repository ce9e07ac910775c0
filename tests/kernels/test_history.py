"""Histories by slot against lists by id."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from coastwatch.kernels.association.history import History

pytestmark = pytest.mark.oracle

WINDOW = 4


def window_of(history, slot):
    """The values that count of a slot, newest first."""
    return history.values[slot, history.columns(np.arange(history.length[slot]))].tolist()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(st.integers(0, 30), unique=True, max_size=25), max_size=15), st.integers(0, WINDOW - 1), st.booleans())
def test_windows_are_those_of_lists(cycles, patience, ordered):
    history, wanted, absent = History.empty(WINDOW), {}, {}
    for number, ids in enumerate(cycles):
        now = np.array(ids, np.int64)
        history, slot = history.advanced(now, np.argsort(now) if ordered else None, patience)
        history.values[slot, history.column] = 100.0 * number + now
        absent = {k: 0 if k in ids else absent[k] + 1 for k in {*absent, *ids} if k in ids or absent[k] < patience}
        wanted = {k: [100.0 * number + k if k in ids else np.nan, *wanted.get(k, [])][:WINDOW] for k in absent}
        assert sorted(history.ids.tolist()) == sorted(wanted)
        assert sorted([*history.slot.tolist(), *history.free.tolist()]) == list(range(len(history.length)))
        assert history.slots_of(now).tolist() == slot.tolist()
        for k, s in zip(history.ids.tolist(), history.slot.tolist(), strict=True):
            np.testing.assert_array_equal(window_of(history, s), wanted[k])
        assert history.slots_of(np.array([99])).tolist() == [-1]


def test_records_in_place_and_slots_of_new_ids_in_the_order_asked():
    record = np.dtype([("latitude_deg", np.float64), ("variance", np.float32)])
    history, slot = History.empty(3, record).advanced(np.array([7, 5, 9]), np.array([2, 0, 1]))
    assert np.argsort(slot).tolist() == [2, 0, 1]
    history.values["variance"][slot, history.column] = [1.0, 2.0, 3.0]
    after, same = copy.deepcopy(history).advanced(np.array([9, 7]))
    assert same.tolist() == slot[[2, 0]].tolist()
    assert after.length[same].tolist() == [2, 2]
    again, _ = history.advanced(np.array([9, 7, 11]))
    assert again.values is history.values
    assert again.length.max() == 2
