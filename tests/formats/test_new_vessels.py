"""New MMSI of one sender: many honest vessels, more than there is room for, and the table that holds those that wait."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from nmea_sentences import T0, wire

from coastwatch.formats.nmea import mmsi_table, new_vessels
from coastwatch.formats.nmea.ais import AisDecoder
from coastwatch.formats.nmea.mmsi_table import NONE_S, MmsiTable
from coastwatch.formats.nmea.new_vessels import AGREES_WITHIN_S, BURST, MOST_WAITING, NAME_BEYOND, NewVessels

pytestmark = pytest.mark.contract

FIRST = 200_000_000


def heard(new: NewVessels, mmsi: np.ndarray, time_s: float) -> np.ndarray:
    """Which reports of these MMSI at one place are used, all of one sender at one time."""
    none = np.zeros(len(mmsi), np.int64)
    return new.accepted(mmsi, np.full(len(mmsi), time_s), np.zeros((len(mmsi), 2)), none, none)


def test_all_of_400_000_vessels_of_one_sender_are_used_from_their_second_report_on() -> None:
    new, every = NewVessels(), FIRST + np.random.default_rng(1).permutation(400_000)
    turns = [
        [int(heard(new, part, 180.0 * turn + second).sum()) for second, part in enumerate(np.array_split(every, 40))]
        for turn in range(2)
    ]
    assert sum(turns[0]) < 5_000  # the budget of the sender
    assert sum(turns[1]) == 400_000


def test_a_million_have_room() -> None:
    assert MOST_WAITING - MOST_WAITING // 10 >= 1_000_000


def test_where_more_wait_than_there_is_room_for_those_heard_longest_ago_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_vessels, "MOST_WAITING", 1_000)
    new = NewVessels()
    for second in range(20):
        heard(new, FIRST + 500 * second + np.arange(500), 0.01 * second)
        assert new._waiting.rows <= 1_000
    assert not np.isin(new._waiting.mmsi, FIRST + np.arange(8_500)).any()
    assert heard(new, FIRST + np.arange(9_500, 10_000), 1.0).all()
    assert heard(new, FIRST + np.arange(BURST, 8_500), 1.1).sum() < 50  # what the budget grants by now


def test_a_report_waits_for_a_quarter_of_an_hour() -> None:
    new = NewVessels()
    mmsi = FIRST + np.arange(BURST + 2_000)
    heard(new, mmsi, 0.0)
    late, in_time = mmsi[BURST : BURST + 1_000], mmsi[BURST + 1_000 :]
    assert heard(new, in_time, AGREES_WITHIN_S).all()
    new._budgets.clear()  # the budget has filled again by now
    new._of_feeds.clear()
    taken = heard(new, np.concatenate([late, FIRST + 10_000 + np.arange(5_000)]), AGREES_WITHIN_S + 0.1)
    assert taken.sum() == BURST


def test_what_waits_and_what_had_no_room_is_counted_for_each_feed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_vessels, "MOST_WAITING", 1_000)
    new = NewVessels()
    for feed in (0, 1):
        mmsi = FIRST + 10_000 * feed + np.arange(BURST + 600)
        new.accepted(
            mmsi, np.full(len(mmsi), 1.0 * feed), np.zeros((len(mmsi), 2)), np.full(len(mmsi), feed), np.zeros_like(mmsi)
        )
    assert [counts.tolist() for counts in new.set_aside(1.0, 3)] == [[300, 600, 0], [300, 0, 0]]
    assert [counts.tolist() for counts in new.set_aside(AGREES_WITHIN_S, 3)] == [[0, 600, 0], [300, 0, 0]]


OF_TABLE = st.lists(st.tuples(st.sampled_from("pprk"), st.lists(st.integers(0, 20), max_size=8)), max_size=12)


@given(OF_TABLE, st.integers(0, 8))
def test_a_table_holds_what_a_dict_does(steps: list[tuple[str, list[int]]], tail: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mmsi_table, "LEAST_TAIL", tail)
        table, known, now_s = MmsiTable(2), dict[int, tuple[float, float]](), 0.0
        for kind, numbers in steps:
            now_s += 1.0
            mmsi = np.array(numbers, np.int64)
            values = np.stack([now_s + 0.01 * np.arange(len(mmsi)), mmsi + 0.5], 1)
            if kind == "p":
                table.put(mmsi, values)
                known |= {number: (float(t), float(v)) for number, (t, v) in zip(numbers, values, strict=True)}
            elif kind == "r":
                table.remove(mmsi)
                known = {number: row for number, row in known.items() if number not in numbers}
            else:
                newest = sorted((number for number, row in known.items() if row[0] > now_s - 5.0), key=lambda n: known[n][0])
                went = table.keep_after(now_s - 5.0, 10)
                assert went[:, 0].tolist() == [known[number][0] for number in newest[:-10]]
                known = {number: known[number] for number in newest[-10:]}
            assert table.mmsi.tolist() == sorted(known)
            assert table.values(np.arange(21))[:, 0].tolist() == [known.get(n, (NONE_S, 0.0))[0] for n in range(21)]
            assert table.values(table.mmsi)[:, 1].tolist() == [known[n][1] for n in sorted(known)]
            assert table.has(np.arange(21)).tolist() == [number in known for number in range(21)]
            assert sorted(table.column(1, now_s - 3.0)) == sorted(v for t, v in known.values() if t > now_s - 3.0)
            assert table.rows >= len(known)


def test_names_of_mmsi_without_a_position_have_a_budget_and_those_of_vessels_none() -> None:
    new, vessels = NewVessels(), FIRST + np.arange(BURST)
    names = FIRST + np.arange(500_000)
    first_s = [int(new.named(0, part, second).sum()) for second, part in enumerate(np.array_split(names, 18))]
    assert sum(first_s) < 15_000
    assert heard(new, vessels, 20.0).all()
    assert new.named(0, np.concatenate([vessels, vessels]), 20.0).all()
    assert new.named(1, names[-5_000:], 20.0).all(), "another feed"


def test_a_name_that_comes_before_the_first_position_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_vessels, "BURST_OF_FEED", 3)
    made = AisDecoder("feed", 0, True)
    said = [{"msg_type": 24, "mmsi": FIRST + k, "partno": 0, "shipname": f"SHIP {k}"} for k in range(5)]
    at = {"msg_type": 1, "mmsi": FIRST + 4, "lat": 59.5, "lon": 10.5, "speed": 3.0, "course": 4.0, "second": 60}
    made.decode([(T0, line.encode(), 0) for row in [*said, at] for line in wire(row)], None)
    found = made.reports_between(T0 - 9.0, T0)
    assert found.statics.name.tolist() == ["SHIP 0", "SHIP 1", "SHIP 2", "SHIP 4"], "one of which has a position"
    assert made.tally.count(NAME_BEYOND) == 1
    late = {"msg_type": 24, "mmsi": FIRST + 3, "partno": 0, "shipname": "SHIP 3"}
    made.decode([(T0 + 60.0, line.encode(), 0) for line in wire(late)], None)
    assert made.reports_between(T0, T0 + 60.0).statics.name.tolist() == ["SHIP 3"]
