"""Hysteresis in seconds: the same times of beginning and end for any period, and for cycles that are merged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.alarms.lasting import KEYS, Holding, Lasting, extend

pytestmark = pytest.mark.contract

KEY = np.array([5 * KEYS + 3])
NONE = np.zeros(0, np.int64)


def holding(holds: bool) -> Holding:
    rows = slice(0, 1 if holds else 0)
    return Holding(KEY[rows], np.zeros(1, np.int64)[rows], np.ones(1, np.bool_)[rows], np.zeros(1, np.bool_)[rows])


def open_times(
    times: list[float], holds: list[bool], open_s: float, close_s: float, frozen: list[bool] | None = None
) -> list[float]:
    """The times at which the condition is open."""
    state, out = Lasting.empty(), []
    for k, (time_s, now) in enumerate(zip(times, holds, strict=True)):
        waits = np.array([5]) if frozen and frozen[k] else NONE
        state, _ = extend(state, holding(now), waits, open_s, close_s, time_s)
        out += [time_s] if state.open.any() else []
    return out


@pytest.mark.parametrize("period_s", [1.0, 3.0, 10.0])
def test_an_alarm_begins_and_ends_by_seconds_whatever_the_period(period_s: float) -> None:
    """It holds from 30 s to 120 s: it is open once it has held for 20 s, until it has not for 30 s, to the next cycle."""
    times = (1.7e9 + np.arange(0.0, 240.0, period_s)).tolist()
    found = open_times(times, [30.0 <= t - 1.7e9 <= 120.0 for t in times], 20.0, 30.0)
    assert 50.0 <= found[0] - 1.7e9 < 50.0 + period_s
    assert 150.0 - period_s <= found[-1] - 1.7e9 < 150.0 + period_s
    assert len(found) == round((found[-1] - found[0]) / period_s) + 1


@given(st.lists(st.integers(1, 10), min_size=30, max_size=60), st.integers(0, 20), st.integers(0, 20))
def test_merged_cycles_count_with_their_time(merged: list[int], open_s: int, close_s: int) -> None:
    """Cycles of 1 s, of which some are computed as one: the condition opens in the first of them that is late enough."""
    times = np.cumsum(merged).astype(float)
    holds = (times >= 20.0) & (times < 90.0)
    found = open_times(times.tolist(), holds.tolist(), float(open_s), float(close_s))
    first = times[holds][0]
    wanted = times[holds & (times - first >= open_s)]
    assert found[:1] == wanted[:1].tolist()
    if len(wanted):
        last = times[holds][-1]
        end = times[(times > last) & (times - last >= close_s)]
        assert found[-1] == (times[times < end[0]][-1] if len(end) else times[-1])


def test_what_is_frozen_counts_no_time() -> None:
    times, holds = [0.0, 10.0, 20.0, 100.0, 110.0, 120.0], [True, True, False, False, False, False]
    assert open_times(times, holds, 5.0, 15.0, [False, False, True, True, False, False]) == [10.0, 20.0, 100.0, 110.0]
