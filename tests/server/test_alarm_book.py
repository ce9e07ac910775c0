"""The book of alarms: what begins, ends, returns and is acknowledged, each with a number; the most urgent first, within a bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from alarm_world import NUMBER, begun

from coastwatch.alarms import EventMemory
from coastwatch.batches import ALARM_KINDS, EventChanges, EventSpans
from coastwatch.batches.kinds import DISTRESS, PRIORITIES
from coastwatch.server import alarm_book
from coastwatch.server.alarm_book import Alarm, AlarmBook, id_of, key_of, known_of
from coastwatch.store import Acknowledgement, AlarmKey, Beginnings, Rows

pytestmark = pytest.mark.contract

BY = Acknowledgement(2000.0, "Ana", "called on 16", "watch")


def spans(*rows: tuple[int, str, float, float]) -> EventSpans:
    """Events. Args: rows: vessel, kind, start, end."""
    vessel, kind, start, end = (np.array(column) for column in zip(*rows, strict=True))
    number = np.array([NUMBER[name] for name in kind])
    return EventSpans(vessel, number, np.zeros(len(rows), np.int64), start, end)


def test_an_alarm_begins_ends_returns_and_is_acknowledged() -> None:
    book = AlarmBook()
    book.begin(7)
    book.apply(begun((4, "dark", 100.0), (4, "coasting", 100.0)))
    book.apply(replace(EventChanges.empty(), ended=spans((4, "dark", 100.0, 103.0))))
    book.apply(replace(EventChanges.empty(), returned=spans((4, "dark", 100.0, 103.0))))
    alarm_id = id_of(AlarmKey(4, "dark", 0, 100.0))
    assert book.acknowledge(alarm_id, BY) is not None
    again = book.acknowledge(alarm_id, BY._replace(name="Bia"))
    changes = book.since(7, 0)
    assert changes is not None
    assert [(change.number, change.what) for change in changes] == [
        (1, "opened"), (2, "closed"), (3, "returned"), (4, "acknowledged"),
    ]  # fmt: skip
    assert [change.alarm.end_s for change in changes] == [None, 103.0, None, None]
    assert (changes[-1].alarm.gaps, changes[-1].alarm.acknowledged_by, changes[-1].alarm.note) == (1, "Ana", "called on 16")
    assert again == changes[-1].alarm, "the first acknowledgement counts"
    assert book.since(7, 4) == []
    assert book.since(8, 0) is None
    assert book.since(7, 5) is None


def test_a_run_that_is_begun_again_gives_all_its_alarms_anew_to_who_had_every_change() -> None:
    book = AlarmBook()
    book.begin(7)
    book.apply(begun((4, "dark", 100.0)))
    assert book.since(7, 1) == []
    book.begin(7)  # from its checkpoint, which does not know the alarm
    assert book.since(7, 1) is None
    run, at, alarms = book.snapshot()
    assert (run, book.since(run, at), alarms) == (7, [], [])


def test_distress_comes_first_then_silent_sensors_danger_and_the_newest() -> None:
    book = AlarmBook()
    book.begin(1)
    book.apply(begun((1, "dark", 5.0), (2, "odd_mmsi", 9.0), (3, "man_overboard", 1.0), (4, "dark", 6.0), (5, "lost", 2.0)))
    book.apply(begun((0, "radar_silent", 3.0)))
    assert [alarm.vessel_id for alarm in book.alarms()] == [3, 0, 5, 4, 1, 2]
    assert {PRIORITIES[kind] for kind in ("ais_sart", "man_overboard", "epirb")} == {DISTRESS}
    assert set(ALARM_KINDS) <= set(PRIORITIES)


def test_alarms_are_chosen_by_what_they_wait_for() -> None:
    book = AlarmBook()
    book.begin(1)
    book.apply(begun((1, "dark", 5.0), (2, "dark", 5.0), (3, "dark", 5.0)))
    book.apply(replace(EventChanges.empty(), ended=spans((2, "dark", 5.0, 8.0), (3, "dark", 5.0, 8.0))))
    for vessel in (1, 3):
        book.acknowledge(id_of(AlarmKey(vessel, "dark", 0, 5.0)), BY)
    found = {name: {alarm.vessel_id for alarm in book.alarms(name)} for name in ("lasting", "unacknowledged", "waiting")}
    assert found == {"lasting": {1}, "unacknowledged": {2}, "waiting": {1, 2}}


def test_together_those_of_a_span_and_kind_are_acknowledged() -> None:
    book = AlarmBook()
    book.begin(1)
    book.apply(begun((1, "dark", 5.0), (2, "lost", 5.0), (3, "dark", 9.0), (4, "dark", 5.0004)))
    assert book.acknowledge_all(Beginnings(("dark",), None, 5.0, 5.0), BY, 0.0006) == 2
    assert book.acknowledge_all(Beginnings(("dark",), None, 5.0, 5.0), BY, 0.0006) == 0
    assert {alarm.vessel_id for alarm in book.alarms("unacknowledged")} == {2, 3}


def test_with_too_many_the_acknowledged_the_least_urgent_and_the_oldest_are_forgotten_and_none_that_lasts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(alarm_book, "MOST_ENDED", 100)
    book = AlarmBook()
    book.begin(1)
    book.apply(begun((9999, "man_overboard", 0.5), (9998, "dark", 0.5)))
    book.apply(replace(EventChanges.empty(), ended=spans((9999, "man_overboard", 0.5, 0.9))))
    for k in range(300):
        when = 1.0 + k
        book.apply(begun((k, "odd_mmsi", when)))
        book.apply(replace(EventChanges.empty(), ended=spans((k, "odd_mmsi", when, when + 0.5))))
    kept = {alarm.vessel_id for alarm in book.alarms()}
    assert {9999, 9998} <= kept
    assert 299 in kept
    assert len(kept) <= 102
    assert book.forgotten == 302 - len(kept)


def test_those_that_ended_before_a_time_are_dropped_and_cannot_be_acknowledged() -> None:
    book = AlarmBook()
    book.begin(1)
    book.apply(begun((1, "dark", 5.0), (2, "dark", 5.0), (3, "dark", 5.0)))
    book.apply(replace(EventChanges.empty(), ended=spans((1, "dark", 5.0, 8.0), (2, "dark", 5.0, 9.0))))
    first = next(alarm for alarm in book.alarms() if alarm.vessel_id == 1)
    book.forget_ended(9.0)
    assert {alarm.vessel_id for alarm in book.alarms()} == {2, 3}
    assert book.acknowledge(first.alarm_id, BY) is None
    assert book.forgotten == 0


def test_a_reader_that_is_too_far_behind_begins_with_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alarm_book, "MOST_CHANGES", 10)
    book = AlarmBook()
    book.begin(1)
    for k in range(30):
        book.apply(begun((k, "dark", float(k))))
    assert book.since(1, 5) is None
    changes = book.since(1, book.first - 1)
    assert changes is not None
    assert [change.number for change in changes] == list(range(21, 31))


def test_a_run_that_goes_on_has_the_alarms_of_its_checkpoint() -> None:
    """Of three alarms in the database one ended after the checkpoint, one ended before it, and one is as it was."""
    rows = Rows(
        Alarm._fields,
        [
            (k, "dark", 0, 5.0, end, 0, None, None, 1.0, 2.0, 3.0, "", None, None, None)
            for k, end in ((1, 50.0), (2, 8.0), (3, None))
        ],
    )
    keys = np.array([1, 3]) * 64 + NUMBER["dark"]
    memory = EventMemory(keys, np.zeros(2, np.int64), np.full(2, 5.0), np.full(2, np.nan), 20.0)
    assert [(alarm.vessel_id, alarm.end_s) for alarm in known_of(rows, memory)] == [(1, None), (2, 8.0), (3, None)]


@pytest.mark.parametrize("text", ["4-dark-1000", "0-lost-5-77", "12-man_overboard-1750000000000"])
def test_an_id_is_the_alarm_and_back(text: str) -> None:
    key = key_of(text)
    assert key is not None
    assert id_of(key) == text


@pytest.mark.parametrize("text", ["", "4-dark", "4-nothing-1000", "x-dark-1", "4-coasting-1000", "4-dark-1000-"])
def test_other_texts_are_no_alarm(text: str) -> None:
    assert key_of(text) is None
