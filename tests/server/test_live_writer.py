"""The writer of a live run: it is never waited for, tries again, skips pictures and nothing else, and survives defects."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import store_world as world
from server_world import wait_for

from coastwatch import store
from coastwatch.batches import AisStatics, Flag
from coastwatch.errors import StoreError
from coastwatch.operators.api import service as api_service
from coastwatch.operators.api.service import Service
from coastwatch.scenario import StoreSettings, load_scenario
from coastwatch.server.alarm_book import AlarmBook
from coastwatch.server.input import Paced
from coastwatch.server.link import Backoff
from coastwatch.server.live import LiveRun, NotRunning
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writing import live_writer, skipped_cycles
from coastwatch.server.writing.live_writer import LiveWriter, NotYetStored
from coastwatch.store import CycleRecord, Store, Written
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.whole

RETRY = Backoff(0.01, 0.01)
KEEP = StoreSettings()
A, B = 12, 10
"""Vessels that are in the picture whenever they are dark here."""


def record(number: int, memory: dict[int, object], flagged: int | None = None) -> CycleRecord:
    """A cycle of the small sea, in which one vessel is dark, or none."""
    picture = world.picture_of(number, 30)
    flags = np.where(picture.vessel_id == flagged, int(Flag.DARK), 0)
    cycle = world.cycle_of(number, 30, replace(picture, flags=flags))
    before = memory.get(number, world.EventMemory.none())
    memory[number + 1], events = world.events_of(before, cycle, 0.0)  # type: ignore[arg-type]
    cycle = replace(cycle, events=events).to_write()
    return CycleRecord(number, cycle, world.reports_of(number, 30), world.SECONDS, b"memory %d" % number)


class Database:
    """A database that a test takes away."""

    def __init__(self, opened: Store) -> None:
        self.store, self.run_id = opened, world.begin(opened)
        self.away: Exception | None = None
        self.attempts: list[int] = []

    def write(self, one: CycleRecord) -> Written:
        self.attempts.append(one.number)
        if self.away is not None:
            raise self.away
        return store.write_cycle(self.store, self.run_id, one, KEEP)

    def rows(self, query: str) -> list[tuple[object, ...]]:
        with store.schema.database.reading(self.store) as connection:
            return [tuple(row) for row in connection.exec_driver_sql(query)]


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return Database(store.open_store(str(tmp_path / "sea.db")))


def writer_of(database: Database, announce: Callable[[CycleRecord], None] = lambda _: None) -> LiveWriter:
    return LiveWriter(Stopwatch(), database.write, announce, RETRY)


def test_a_database_that_is_away_for_a_while_gets_every_cycle(database: Database) -> None:
    memory: dict[int, object] = {}
    announced: list[int] = []
    with writer_of(database, lambda one: announced.append(one.number)) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        database.away = StoreError("database is locked")
        for number in range(1, 8):
            began_s = time.monotonic()
            writer.put(record(number, memory, flagged=A))
            assert time.monotonic() - began_s < 5.0
        wait_for(lambda: writer.state.failures > 1)
        assert (writer.state.error, writer.state.waiting) == ("database is locked", 7)
        wait_for(lambda: announced == list(range(8)))  # other centres do not wait for the database
        database.away = None
        wait_for(lambda: writer.is_idle)
        assert (writer.state.error, writer.state.since_s, writer.state.waiting, writer.state.not_stored) == (None, None, 0, 0)
    assert database.rows("SELECT number, skipped FROM cycle ORDER BY number") == [(n, None) for n in range(8)]
    assert database.rows("SELECT vessel_id, from_cycle, to_cycle FROM event") == [(A, 1, None)]
    assert announced == list(range(8))
    assert check(str(database.store.engine.url)) == []


def test_a_run_that_waits_for_input_is_noted_as_there(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_writer, "IDLE_S", 0.01)
    with store.schema.database.writing(database.store) as connection:
        connection.exec_driver_sql("UPDATE run SET written_utc = '2020-01-01T00:00:00Z'")

    def idle() -> None:
        if database.away is not None:
            raise database.away
        store.note_running(database.store, database.run_id)

    with LiveWriter(Stopwatch(), database.write, lambda _: None, RETRY, idle=idle) as writer:
        wait_for(lambda: database.rows("SELECT written_utc FROM run") > [("2021",)])
        database.away = StoreError("database is locked")
        wait_for(lambda: writer.state.failures > 1)
        database.away = None
        wait_for(lambda: writer.state.error is None)
        writer.put(record(0, {}))
        wait_for(lambda: writer.is_idle)
    assert database.rows("SELECT number FROM cycle") == [(0,)]


def test_of_too_many_cycles_the_newest_picture_and_every_event_name_and_change_are_stored(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_writer, "MOST_WAITING", 5)
    memory: dict[int, object] = {}
    with writer_of(database) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        database.away = StoreError("disk full")
        for number in range(1, 21):  # A is dark in cycles 5 to 9 only, B from 15 on
            writer.put(record(number, memory, flagged=A if 5 <= number < 10 else B if number >= 15 else None))
        said = writer.later(lambda: store.acknowledge_all(database.store, database.run_id, DARK, BY))
        wait_for(lambda: writer.state.failures > 0)
        assert writer.state.waiting <= 6
        database.away = None
        assert said.result(20.0) == 2, "written after the cycles in which the alarms began"
    skipped = writer.state.not_stored
    assert skipped >= 14
    numbers = database.rows("SELECT number, skipped FROM cycle ORDER BY number")
    assert [row[0] for row in numbers] == list(range(21)), "no cycle is without its row"
    assert sum(row[1] == "not_stored" for row in numbers) == skipped
    assert numbers[-1] == (20, None)
    assert numbers[0] == (0, None)
    events = "SELECT vessel_id, from_cycle, to_cycle FROM event ORDER BY vessel_id"
    assert database.rows(events) == [(B, 15, None), (A, 5, 9)]
    names = {row[0] for row in database.rows("SELECT mmsi FROM vessel_static")}
    assert names == {710_000_000 + number for number in range(21)}
    assert database.rows("SELECT count(*) FROM checkpoint WHERE cycle = 20") == [(1,)]
    picture = store.picture(database.store, database.run_id)
    assert sorted(picture.column("vessel_id")) == sorted(world.picture_of(20, 30).vessel_id.tolist())
    before = store.picture(database.store, database.run_id, world.instant_s(12))
    assert {*before.column("time_s")} <= {world.instant_s(0), world.instant_s(1)}, "of a skipped cycle nothing is invented"
    assert check(str(database.store.engine.url)) == []


DARK = store.Beginnings(("dark",), None, 0.0, 1e12)
BY = store.Acknowledgement(1.0, "Ana", "", "loopback")


def test_a_run_goes_on_from_a_checkpoint_before_skipped_cycles(database: Database) -> None:
    memory: dict[int, object] = {}
    for number in range(3):
        database.write(record(number, memory, flagged=A))
    skipped = tuple(record(number, memory).skipped() for number in (3, 4, 5))
    last = replace(record(6, memory), merged=skipped)
    database.write(last)
    database.store.run_states.clear()
    again = {n: memory[n] for n in (1, 2, 3)}
    for number in range(3, 8):
        database.write(record(number, again, flagged=A))
    assert database.rows("SELECT number, skipped FROM cycle ORDER BY number") == [(n, None) for n in range(8)]
    assert database.rows("SELECT vessel_id, from_cycle, to_cycle FROM event") == [(A, 0, None)]
    assert check(str(database.store.engine.url)) == []


def test_merged_cycles_have_rows_and_change_nothing_else(database: Database) -> None:
    memory: dict[int, object] = {}
    database.write(record(0, memory, flagged=A))
    counts = {"vessels": 1, "tracks": 2, "pairs": 3, "bearing_pairs": 4, "reports": 5}
    merged = tuple(store.SkippedCycle(n, world.instant_s(n), "merged", counts) for n in (1, 2))
    memory[3] = memory[1]
    database.write(replace(record(3, memory), merged=merged))
    rows = database.rows("SELECT number, skipped, vessels, reports FROM cycle ORDER BY number")
    assert rows[1:3] == [(1, "merged", 1, 5), (2, "merged", 1, 5)]
    assert database.rows("SELECT to_cycle FROM event") == [(0,)], "the last cycle in which it held"
    with pytest.raises(StoreError, match="got cycle 6, needed 4"):
        database.write(record(6, memory))


def test_a_run_that_was_deleted_is_not_written_for_ever(database: Database) -> None:
    """The thread of the cycles is told, so that a new run begins; what waits is left and counted."""
    memory: dict[int, object] = {}
    with writer_of(database) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        store.finish_run(database.store, database.run_id, "finished")
        store.delete_run(database.store, database.run_id)
        writer.put(record(1, memory, flagged=A))
        wait_for(lambda: writer.lost is not None)
        assert writer.later(lambda: 7).result(10.0) == 7, "other changes are written"
        assert writer.state.forgotten == 1
        with pytest.raises(store.NoSuchRunError, match="there is no run 1"):
            writer.put(record(2, memory))


def test_a_change_that_nobody_waits_for_any_more_ends_no_thread(database: Database) -> None:
    memory: dict[int, object] = {}
    go = threading.Event()
    with writer_of(database) as writer:
        writer.later(lambda: go.wait(20.0))
        second, third = writer.later(lambda: 1), writer.later(lambda: 1 // 0)
        assert second.cancel()
        assert third.cancel()
        go.set()
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
    assert database.rows("SELECT count(*) FROM cycle") == [(1,)]


def test_a_defect_in_the_writing_of_a_cycle_costs_its_picture_alone(database: Database) -> None:
    memory: dict[int, object] = {}
    with writer_of(database) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        database.away = ValueError("need at least one array to concatenate")
        writer.put(record(1, memory, flagged=A))
        wait_for(lambda: writer.is_idle)
        assert writer.state.error == "ValueError: need at least one array to concatenate"
        database.away = None
        writer.put(record(2, memory, flagged=A))
        wait_for(lambda: writer.is_idle and writer.state.error is None)
    assert database.rows("SELECT number, skipped FROM cycle") == [(0, None), (1, "not_stored"), (2, None)]
    assert database.rows("SELECT vessel_id, from_cycle FROM event") == [(A, 1)]


def test_events_that_cannot_be_written_are_left_in_the_end(database: Database) -> None:
    """Otherwise one of them would keep the database from all that follows."""
    memory: dict[int, object] = {}

    def write(one: CycleRecord) -> Written:
        if any(len(part.events) for part in (*one.merged, one.cycle)):
            raise ValueError("a text that no database takes")
        return database.write(one)

    with LiveWriter(Stopwatch(), write, lambda _: None, RETRY) as writer:
        for number in range(4):
            writer.put(record(number, memory, flagged=A if number == 1 else None))
            wait_for(lambda: writer.is_idle)
        writer.put(record(4, memory))
        wait_for(lambda: writer.is_idle and writer.state.error is None)
        assert writer.state.forgotten > 0
    assert [row[0] for row in database.rows("SELECT number FROM cycle ORDER BY number")] == list(range(5))


def test_a_change_that_the_database_refuses_is_given_up_and_does_not_hold_up_the_cycles(database: Database) -> None:
    memory: dict[int, object] = {}

    def refused() -> None:
        raise StoreError("there is no run 7")

    with writer_of(database) as writer:
        said = writer.later(refused)
        writer.put(record(0, memory))
        writer.put(record(1, memory))
        with pytest.raises(StoreError, match="there is no run 7"):
            said.result(20.0)
        wait_for(lambda: writer.is_idle)
    assert database.rows("SELECT count(*) FROM cycle") == [(2,)]


def test_the_end_waits_for_what_can_be_written_and_says_what_cannot(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory: dict[int, object] = {}
    with writer_of(database) as writer:
        database.away = StoreError("database is locked")
        writer.put(record(0, memory))
        threading.Timer(0.1, lambda: setattr(database, "away", None)).start()
    assert database.rows("SELECT count(*) FROM cycle") == [(1,)]
    monkeypatch.setattr(live_writer, "CLOSE_S", 0.05)
    database.away, last = StoreError("disk full"), record(1, memory)
    with pytest.raises(StoreError, match="1 cycles could not be stored at the end: disk full"), writer_of(database) as writer:
        writer.put(last)


def test_what_is_acknowledged_before_its_cycle_is_handed_over_is_written_after_it(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cycle shows its alarms before its record is put: an operator may be faster."""
    monkeypatch.setattr(api_service, "WAIT_FOR_STORE_S", 0.05)
    memory: dict[int, object] = {}
    service, book = Service(database.store), AlarmBook()
    monkeypatch.setattr(service, "run_id", lambda: database.run_id)
    book.begin(database.run_id)
    with writer_of(database) as writer:
        service.source = type("Source", (), {"alarms": book, "later": staticmethod(writer.later)})()
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        for number, vessel in ((1, A), (2, B)):
            one = record(number, memory, flagged=vessel)
            book.apply(one.cycle.events)
            (alarm,) = [alarm for alarm in book.alarms() if alarm.vessel_id == vessel]
            if vessel == A:
                assert service.acknowledge(alarm.alarm_id, "Ana", "", "loopback") is not None
            else:
                assert service.acknowledge_all(DARK, "Bia", "", "loopback") == 1
            writer.put(one)
            wait_for(lambda: writer.is_idle)
        other = writer.later(lambda: 7)
        assert other.result(10.0) == 7
        assert writer.state.forgotten == 0
    found = database.rows("SELECT vessel_id, acknowledged_by FROM acknowledgement ORDER BY vessel_id")
    assert found == [(B, "Bia"), (A, "Ana")]


def test_a_change_whose_subject_is_never_stored_is_given_up_and_holds_up_no_other(database: Database) -> None:
    memory: dict[int, object] = {}
    tries: list[int] = []

    def never() -> None:
        tries.append(1)
        raise NotYetStored("no such alarm")

    with writer_of(database) as writer:
        said = writer.later(never)
        assert writer.later(lambda: 7).result(10.0) == 7
        for number in range(2 * live_writer.MOST_ATTEMPTS):
            writer.put(record(number, memory))
            wait_for(lambda: writer.is_idle)
        with pytest.raises(NotYetStored):
            said.result(10.0)
        assert (len(tries), writer.state.forgotten) == (live_writer.MOST_ATTEMPTS, 1)


def test_a_write_that_fails_once_is_said_for_a_minute(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    run = LiveRun(load_scenario("guanabara"), Paced(), lambda _: None, database="")
    with run.writer(1, Stopwatch(), database.write, lambda: None) as writer:
        assert run.troubles() == []
        database.away = StoreError("database is locked")
        writer.put(record(0, {}))
        wait_for(lambda: writer.state.failures == 1)
        (said,) = run.troubles()
        assert said.text == "the database cannot be written: database is locked; 1 cycles wait, 0 were left out"
        database.away = None
        wait_for(lambda: writer.is_idle and writer.state.error is None)
        (said,) = run.troubles()
        again = "the database could not be written within the last minute, and can be again: database is locked"
        assert (said.kind, said.text, said.is_serious) == ("store", again, False)
    with run.writer(1, Stopwatch(), database.write, lambda: None):
        assert [one.text for one in run.troubles()] == [again], "the run was begun again"
    monkeypatch.setattr("coastwatch.server.live.FAILED_SHOWN_S", 0.0)
    assert run.troubles() == []


def test_a_change_waits_for_a_database_that_is_away_however_often_it_refuses_at_once(database: Database) -> None:
    tries: list[int] = []

    def locked() -> int:
        tries.append(1)
        if len(tries) <= 3 * live_writer.MOST_ATTEMPTS:
            raise StoreError("database is locked") from sqlite3.OperationalError("database is locked")
        return 7

    with writer_of(database) as writer:
        assert writer.later(locked).result(20.0) == 7
        assert writer.state.forgotten == 0


def test_a_change_that_the_driver_refuses_while_cycles_are_written_is_given_up(database: Database) -> None:
    memory: dict[int, object] = {}

    def wrong() -> None:
        with store.schema.database.writing(database.store) as connection:
            connection.exec_driver_sql("SELECT * FROM nothing")

    with writer_of(database) as writer:
        said, number = writer.later(wrong), 0
        while not said.done() and number < 100:
            writer.put(record(number, memory))
            wait_for(lambda: writer.is_idle)
            time.sleep(0.05)
            number += 1
        with pytest.raises(StoreError, match="nothing"):
            said.result(0.0)
        assert writer.later(lambda: 7).result(10.0) == 7


def test_a_change_between_two_attempts_of_a_run_is_written_by_the_next_and_what_is_lost_is_counted(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_writer, "CLOSE_S", 0.05)
    monkeypatch.setattr(LiveRun, "ended", False)
    run = LiveRun(load_scenario("guanabara"), Paced(), lambda _: None, database="")
    memory: dict[int, object] = {}
    with pytest.raises(NotRunning):
        run.later(lambda: 7)
    with run.writer(1, Stopwatch(), database.write, lambda: None) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
    said = run.later(lambda: 7)
    database.away, lost = StoreError("disk full"), record(1, dict(memory), flagged=A)
    with pytest.raises(StoreError, match="1 cycles"), run.writer(1, Stopwatch(), database.write, lambda: None) as writer:
        writer.put(lost)
    assert run.counts()["store_forgotten"] == 1, "an event of a cycle that was not written"
    assert not said.done()
    database.away = None
    with run.writer(1, Stopwatch(), database.write, lambda: None) as writer:
        assert run.counts()["store_forgotten"] == 1
        assert not said.done(), "of a run that goes on from a checkpoint, cycles are replaced first"
        writer.put(record(1, memory))
        assert said.result(10.0) == 7


def test_changes_that_wait_when_a_run_ends_for_good_are_tried_once_more(database: Database) -> None:
    with writer_of(database) as writer:
        pass

    def refused() -> None:
        raise StoreError("database is locked") from sqlite3.OperationalError("database is locked")

    done, locked, last = writer.later(lambda: 7), writer.later(refused), writer.later(lambda: 8)
    writer.end_changes(NotRunning("the run has ended"))
    assert done.result(0.0) == 7
    with pytest.raises(StoreError, match="locked"):
        locked.result(0.0)
    with pytest.raises(NotRunning):
        last.result(0.0)
    assert writer.state.forgotten == 2


def test_what_waits_of_skipped_cycles_is_bounded_and_no_cycle_is_without_its_row(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_writer, "MOST_WAITING", 5)
    for name, value in (("MOST_COUNTED", 4), ("MOST_NAMED", 10)):
        monkeypatch.setattr(skipped_cycles, name, value)
    memory: dict[int, object] = {}
    with writer_of(database) as writer:
        writer.put(record(0, memory))
        wait_for(lambda: writer.is_idle)
        database.away = StoreError("disk full")
        for number in range(1, 61):
            one = record(number, memory, flagged=A if number in (3, 4) else None)
            used = store.Intake("north", "n1", number, number, 1)
            writer.put(replace(one, for_centres=store.ForCentres(None, (used,))))
        merged = [part for one in vars(writer)["_waiting"] for part in one.record.merged]
        assert 5 <= len(merged) <= 4 + 5, "four, the cycles of the events, and those around them"
        assert sum(len(one.statics) for one in merged) <= 10
        database.away = None
        wait_for(lambda: writer.is_idle, 30.0)
        skipped = writer.state.not_stored
    rows = database.rows("SELECT number, skipped, reports, time_s FROM cycle ORDER BY number")
    assert [row[0] for row in rows] == list(range(61))
    assert [row[3] for row in rows] == pytest.approx([world.instant_s(number) for number in range(61)], abs=1e-6, rel=0.0)
    assert sum(row[1] == "not_stored" for row in rows) == skipped
    assert database.rows("SELECT vessel_id, from_cycle, to_cycle FROM event") == [(A, 3, 4)]
    used = "SELECT min(first_seq), max(last_seq), sum(late) FROM region_intake"
    assert database.rows(used) == [(1, 60, 60)]
    assert check(str(database.store.engine.url)) == []


def test_of_names_the_newest_of_each_field_are_kept() -> None:
    def heard(at_s: float, mmsi: int, name: str, length_m: float) -> AisStatics:
        texts = np.array([name], "U20"), np.array([""], "U7")
        return AisStatics(np.array([at_s]), np.array([mmsi]), *texts, np.array([-1]), np.array([length_m]), np.array([np.nan]))

    parts = [heard(1.0, 7, "OLD", 9.0), heard(2.0, 7, "NEW", 10.0), heard(3.0, 8, "B", np.nan), heard(4.0, 7, "", 11.0)]
    skipped = [store.SkippedCycle(k, float(k), "not_stored", {}, statics=part) for k, part in enumerate(parts)]
    kept = AisStatics.join([one.statics for one in skipped_cycles.bounded(skipped)[0]])
    assert kept.received_s.tolist() == [2.0, 3.0, 4.0]
