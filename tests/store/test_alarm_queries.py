"""Alarms out of the database: chosen before any limit, the most urgent first. A look at what is new reads no old ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import store_world as world
from alarm_world import NUMBER, begun
from sqlalchemy import text, update

from coastwatch import store as kept
from coastwatch.batches.kinds import IS_ALARM
from coastwatch.store import Acknowledgement, AlarmKey, Asked, Beginnings, Store
from coastwatch.store.read import alarms as queries
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.tables import EVENT
from coastwatch.store.write.events import Timeline, write_events

pytestmark = pytest.mark.contract

TIMELINE = Timeline(world.START_S, world.PERIOD_S)
BY = Acknowledgement(1.0, "Ana", "", "watch")


def raise_alarms(store: Store, run: int, number: int, kinds: Sequence[str], first: int = 1) -> None:
    """Write events that begin in a cycle, of vessels from a number on."""
    rows = ((vessel, kind, world.instant_s(number)) for vessel, kind in enumerate(kinds, first))
    with writing(store) as connection:
        write_events(connection, run, number, begun(*rows, text="why"), TIMELINE)


def vessels(found: tuple[Any, int]) -> list[int]:
    rows, _ = found
    return [row[0] for row in rows.rows]


def test_the_most_urgent_come_first_and_the_state_is_chosen_before_the_limit(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(6):
            world.write(store, run, number)
        raise_alarms(store, run, 1, ["man_overboard"], first=5000)
        for number in (2, 3):
            raise_alarms(store, run, number, ["dark"] * 50 + ["coasting"] * 5, first=1000 * number)
        done = Beginnings(("dark",), None, 0.0, world.instant_s(3))
        assert kept.acknowledge_all(store, run, done, BY) == 100
        raise_alarms(store, run, 4, ["odd_mmsi", "dark", "lost"], first=1)
        assert vessels(kept.alarms(store, run, Asked("unacknowledged", limit=2))) == [5000, 3]
        assert vessels(kept.alarms(store, run, Asked("unacknowledged"))) == [5000, 3, 2, 1]
        assert kept.alarms(store, run, Asked("unacknowledged", limit=1))[1] == 4
        assert kept.alarms(store, run, Asked(limit=0))[1] == 104, "coasting is no alarm"
        assert vessels(kept.alarms(store, run, Asked("lasting", limit=3, offset=1))) == [3, 2, 3000]
        assert vessels(kept.alarms(store, run, Asked(kinds=("odd_mmsi",)))) == [1]
        assert vessels(kept.alarms(store, run, Asked(to_s=world.instant_s(1)))) == [5000]
        assert kept.acknowledge(store, run, AlarmKey(1, "odd_mmsi", 0, world.instant_s(4) + 0.0004), BY)
        assert not kept.acknowledge(store, run, AlarmKey(1, "odd_mmsi", 0, world.instant_s(4) + 0.002), BY)
        assert vessels(kept.alarms(store, run, Asked("unacknowledged"))) == [5000, 3, 2]


def test_acknowledgements_are_read_once_also_where_the_clock_of_a_server_is_behind(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(4):
            world.write(store, run, number)
            raise_alarms(store, run, number, ["dark"] * 3, first=1000 * number)
        keys = [AlarmKey(vessel, "dark", 0, world.instant_s(vessel // 1000)) for vessel in (1, 1000, 2000, 3000, 3001)]
        found, seen = kept.acknowledged_since(store, run, kept.Seen())
        assert (found, seen) == ([], kept.Seen())
        at_s = [5000.0, 5100.0, 4900.0, 6000.0, 6000.0]  # the third is by a server whose clock is behind
        for key, time_s in zip(keys, at_s, strict=True):
            by = BY._replace(at_s=time_s)
            assert kept.acknowledge(store, run, key, by)
            found, seen = kept.acknowledged_since(store, run, seen)
            assert (key, by) in found
            assert kept.acknowledged_since(store, run, seen) == ([], seen)
        assert seen == kept.Seen(6000.0 - 300.0, 2)
        assert kept.acknowledged_since(store, run + 1, kept.Seen()) == ([], kept.Seen())


def test_alarms_that_last_are_whole_and_only_ended_ones_are_limited(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        raise_alarms(store, run, 0, ["dark"] * 7)
        world.write(store, run, 1)
        with writing(store) as connection:  # of 1 to 4 until now
            ended = update(EVENT).where(EVENT.c.run_id == run, EVENT.c.vessel_id <= 4)
            connection.execute(ended.values(to_cycle=0, end_s=world.instant_s(0)))
        rows, _ = kept.changed_alarms(store, run, None, 2)
        assert sorted(row[0] for row in rows.rows) == [1, 2, 5, 6, 7]
        later = kept.alarms_before(store, run, world.instant_s(1), 2)
        assert sorted(row[0] for row in later.rows) == [1, 2, 5, 6, 7]
        then = kept.alarms_before(store, run, world.instant_s(0), 2)  # a run that goes on from there: they lasted
        assert sorted(row[0] for row in then.rows) == [1, 2, 3, 4, 5, 6, 7]


def test_a_cursor_finds_what_has_begun_ended_returned_and_been_acknowledged(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        raise_alarms(store, run, 0, ["dark", "lost", "dark"])
        first, cursor = kept.changed_alarms(store, run, None, 10)
        assert sorted(row[0] for row in first.rows) == [1, 2, 3]
        rows, cursor = kept.changed_alarms(store, run, cursor, 10)
        assert rows.rows == []
        assert sorted(row[0] for row in kept.alarms_before(store, run, world.instant_s(0), 10).rows) == [1, 2, 3]
        assert kept.alarms_before(store, run, world.instant_s(0) - 1.0, 10).rows == []
        world.write(store, run, 1)
        raise_alarms(store, run, 1, ["dark"], first=9)
        with writing(store) as connection:
            ended = {"run": run, "end": world.instant_s(0)}
            connection.execute(text("UPDATE event SET to_cycle = 0, end_s = :end WHERE run_id = :run AND vessel_id = 2"), ended)
        kept.acknowledge(store, run, AlarmKey(3, "dark", 0, world.instant_s(0)), BY)
        rows, cursor = kept.changed_alarms(store, run, cursor, 10)
        assert sorted(row[0] for row in rows.rows) == [2, 3, 9]
        rows, cursor = kept.changed_alarms(store, run, cursor, 10)
        assert rows.rows == [], "200,000 may be acknowledged at one instant: they come once"
        kept.acknowledge(store, run, AlarmKey(9, "dark", 0, world.instant_s(1)), BY)
        rows, _ = kept.changed_alarms(store, run, cursor, 10)
        assert sorted(row[0] for row in rows.rows) == [3, 9], "one of the same instant was written after the last look"


@pytest.mark.parametrize("done", [0, 3000])
def test_a_look_reads_no_acknowledged_alarm(tmp_path: Any, done: int) -> None:
    """Steps of SQLite's machine, in thousands: they do not depend on how many alarms were acknowledged before."""
    with kept.open_store(str(tmp_path / "sea.db")) as store:
        run = world.begin(store)
        for number in range(4):
            world.write(store, run, number)
        raise_alarms(store, run, 0, ["dark"] * done, first=10)
        kept.acknowledge_all(store, run, Beginnings(("dark",), None, 0.0, 1e12), BY)
        with writing(store) as connection:
            connection.execute(text("UPDATE event SET to_cycle = 0, end_s = start_s"))
            connection.execute(text("UPDATE acknowledgement SET acknowledged_s = 0.5"))
        raise_alarms(store, run, 3, ["man_overboard"], first=1)
        kept.acknowledge(store, run, AlarmKey(1, "man_overboard", 0, world.instant_s(3)), BY)
        steps = [0]

        def count() -> None:
            steps[0] += 1

        with reading(store) as connection:
            raw: Any = connection.connection.driver_connection
            raw.set_progress_handler(count, 1000)
            cursor = queries._cursor(connection, run)._replace(cycle=2, time_s=world.instant_s(2))
            for parts in (queries._waiting(run), queries._changed(run, cursor._replace(acknowledged=0), cursor)):
                assert len(connection.execute(queries._select(parts)).all()) == 1
            raw.set_progress_handler(None, 0)
        assert steps[0] <= 2


def test_every_kind_of_alarm_has_a_row_in_its_tables() -> None:
    assert IS_ALARM[NUMBER["dark"]]
    assert not IS_ALARM[NUMBER["coasting"]]
