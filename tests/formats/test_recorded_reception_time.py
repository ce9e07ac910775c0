"""Order of arrival and repeats against their definitions, row by row."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.formats.intake.reception_time import BACKWARDS, FAR, LATE, reception_times, repeated

pytestmark = pytest.mark.contract

STAMPS = st.lists(st.floats(0.0, 500.0).map(lambda t: round(t, 1)), max_size=40)


@given(STAMPS)
def test_within_the_lateness_all_are_believed_and_arrive_at_the_newest_stamp_so_far(stamps: list[float]) -> None:
    t = np.array(stamps)
    arrived = reception_times(t, lateness_s=500.0, longest_silence_s=500.0)
    assert arrived.accepted.all()
    assert arrived.received_s.tolist() == [max(stamps[: i + 1]) for i in range(len(stamps))]
    assert (arrived.faults[LATE] == (t < arrived.received_s)).all()


@given(STAMPS, st.floats(0.0, 50.0))
def test_what_is_believed_is_in_order_within_the_lateness(stamps: list[float], lateness: float) -> None:
    t = np.array(stamps)
    arrived = reception_times(t, lateness, longest_silence_s=1e9)
    kept = arrived.received_s[arrived.accepted]
    assert (np.diff(kept) >= 0.0).all()
    assert (kept - t[arrived.accepted] <= 2.0 * lateness + 1e-9).all()  # late behind a record that was itself early
    assert (arrived.accepted ^ arrived.faults[BACKWARDS] ^ arrived.faults[FAR]).all()


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60), st.data())
def test_single_wild_stamps_cost_only_themselves(steps: list[float], data: st.DataObject) -> None:
    t = np.cumsum(np.array(steps) + 0.1)
    wild = data.draw(st.sets(st.integers(0, len(t) - 1), max_size=max(len(t) // 4, 0)))
    rows = np.array(sorted(wild), np.int64)
    t[rows] += np.where(np.arange(len(rows)) % 2, -1e5, 1e5)
    arrived = reception_times(t, lateness_s=60.0, longest_silence_s=1000.0)
    assert set(np.flatnonzero(~arrived.accepted)) == wild


@given(st.lists(st.tuples(st.integers(0, 2), st.floats(0.0, 20.0)), max_size=40), st.floats(0.0, 5.0))
def test_repeated_is_what_its_sentence_says(rows: list[tuple[int, float]], within: float) -> None:
    key, time = np.array([r[0] for r in rows], np.int64), np.array([r[1] for r in rows], np.float64)
    want = np.zeros(len(rows), np.bool_)
    for i in range(len(rows)):
        before = [
            time[j] for j in range(len(rows)) if key[j] == key[i] and (time[j] < time[i] or (time[j] == time[i] and j < i))
        ]
        want[i] = bool(before) and time[i] - max(before) <= within
    assert repeated((key,), time, within).tolist() == want.tolist()
