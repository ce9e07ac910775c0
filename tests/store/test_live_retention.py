"""A run that never ends has bounded tables: each is grown with new vessels, alarms, names, changes and runs, and stays as it is."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import AisStatics, Flag, Picture, Reports
from coastwatch.errors import StoreError
from coastwatch.scenario import StoreSettings
from coastwatch.scenario.model import LIVE_HOURS
from coastwatch.store import AlarmKey, Store
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.migrate import check
from coastwatch.store.schema.tables import METADATA
from coastwatch.store.write import retention, static_names

pytestmark = pytest.mark.contract

HOURS = 10 * world.PERIOD_S / 3600.0  # ten cycles
KEEP = StoreSettings(
    history_hours=HOURS,
    details_hours=HOURS / 2.0,
    event_hours=2.0 * HOURS,
    picture_hours=HOURS,
    recording_hours=HOURS,
    audit_hours=HOURS,
    event_gap_s=0.0,
    history_max_s=9.0,
    recording=True,
)
HALF = 24
"""Cycles after which no table grows: longer than the longest time that something is kept, 20 cycles."""

BY = kept.Acknowledgement(1.0, "Ana", "", "loopback")
SETTINGS = {"period_s": world.PERIOD_S, "store": {"history_hours": HOURS}}


def scalar(store: Store, query: str) -> Any:
    with reading(store) as connection:
        return connection.execute(text(query)).scalar()


def counts(store: Store, run_id: int) -> dict[str, int]:
    """How many rows of a run each table has."""
    tables = [table.name for table in METADATA.sorted_tables if "run_id" in table.c]
    return {name: scalar(store, f"SELECT count(*) FROM {name} WHERE run_id = {run_id}") for name in tables}


def named(number: int, mmsi: Sequence[int]) -> Reports:
    """The names of some vessels, received at the end of a cycle."""
    n = len(mmsi)
    when, texts = np.full(n, world.instant_s(number)), np.array([f"SHIP {one}" for one in mmsi])
    sizes = np.full(n, 70), np.full(n, 120.0), np.full(n, np.nan)
    return Reports(statics=AisStatics(when, np.array(mmsi, np.int64), texts, np.full(n, ""), *sizes))


def passing(number: int, vessels: int = 30) -> Picture:
    """The vessels of a cycle: each stays for three cycles and never returns. The newest third is dark; vessel 1 stays and is."""
    picture = world.picture_of(0, vessels)
    n = len(picture)
    row = np.arange(n)
    ids = 2 + vessels * ((number + row % 3) // 3) + row
    ids[0] = 1
    flags = np.where((row == 0) | (row % 3 == number % 3), int(Flag.DARK), 0)
    times = {name: np.full(n, world.instant_s(number)) for name in ("time_s", "updated_s")}
    order = np.argsort(ids)
    return replace(picture, vessel_id=ids, mmsi=700_000_000 + ids, flags=flags, **times).take(order)


def pass_by(store: Store, run_id: int, cycles: range, keep: StoreSettings = KEEP) -> None:
    """Write cycles in which vessels come and go, each with an MMSI and a name. All alarms but the lasting one are acknowledged."""
    for number in cycles:
        picture = passing(number)
        cycle = world.cycle_of(number, 30, picture)
        world.write(store, run_id, number, cycle=cycle, keep=keep, reports=named(number, picture.mmsi.tolist()))
        kept.acknowledge_all(
            store,
            run_id,
            kept.Beginnings(("dark",), None, world.START_S + 4.0, 1e12),
            BY._replace(at_s=world.instant_s(number)),
        )


def test_every_table_of_a_run_with_a_retention_stops_growing(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        pass_by(store, run, range(HALF))
        before = counts(store, run)
        assert all(before[name] for name in ("acknowledgement", "event", "identity", "recording", "association", "cycle")), (
            before
        )
        pass_by(store, run, range(HALF, 2 * HALF))
        after = counts(store, run)
        assert {name: count for name, count in after.items() if count > 1.2 * before[name] + 3} == {}
        assert scalar(store, "SELECT min(number) FROM cycle") >= 2 * HALF - 1 - 20 - 3
        lasting = scalar(store, "SELECT from_cycle FROM event WHERE vessel_id = 1 AND to_cycle IS NULL")
        assert lasting == 0, "an alarm that lasts stays"
        assert scalar(store, "SELECT count(*) FROM event WHERE unacknowledged") == 1
        assert scalar(store, "SELECT count(*) FROM vessel_static WHERE mmsi = 700000001") == 1
        then = 2 * HALF - 7
        seen = kept.picture(store, run, world.instant_s(then))
        assert sorted(seen.column("vessel_id")) == passing(then).vessel_id.tolist()
        assert len(kept.track(store, run, 1).members.rows) > 0, "its stay began in a cycle that is gone"
        assert len(kept.traffic(store, run, (-25.0, -45.0, -20.0, -40.0), world.START_S, world.instant_s(200)).rows) > 0
    assert check(url) == []


def test_a_cycle_is_there_although_old_rows_cannot_be_deleted(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        pass_by(store, run, range(3))

        def locked(*_: object) -> None:
            raise StoreError("database is locked")

        with monkeypatch.context() as patched:
            patched.setattr(retention, "delete_old", locked)
            pass_by(store, run, range(3, 20))
        assert scalar(store, "SELECT count(*) FROM cycle") == 20
        pass_by(store, run, range(20, 23))
        assert scalar(store, "SELECT min(cycle) FROM stage_timing") == 23 - 5
    assert check(url) == []


def test_without_a_retention_everything_stays(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        pass_by(store, run, range(20), StoreSettings(event_gap_s=0.0))
        found = counts(store, run)
        assert (found["cycle"], found["stage_timing"]) == (20, 20 * len(world.SECONDS))
        assert scalar(store, "SELECT min(cycle) FROM history") == 0
        assert scalar(store, "SELECT min(from_cycle) FROM event") == 0


def test_the_acknowledgement_of_an_alarm_that_lasts_stays_with_it(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(retention, "LOOK_EVERY", 10)
    with kept.open_store(url) as store:
        run = world.begin(store)
        pass_by(store, run, range(1))
        assert kept.acknowledge(store, run, AlarmKey(1, "dark", 0, world.instant_s(0)), BY)
        pass_by(store, run, range(1, 42))
        assert scalar(store, "SELECT count(*) FROM acknowledgement WHERE vessel_id = 1") == 1


def test_names_are_bounded_however_many_mmsi_there_are(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(static_names, "MOST_NAMES", 500)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(8):
            flood = range(200_000_000 + 200 * number, 200_000_200 + 200 * number)
            world.write(store, run, number, keep=KEEP, reports=named(number, [710_000_001, *flood] if not number else flood))
            assert scalar(store, "SELECT count(*) FROM vessel_static") <= 500 + 1
            assert len(store.run_states[run].names) == scalar(store, "SELECT count(*) FROM vessel_static")
        newest = scalar(store, "SELECT min(updated_s) FROM vessel_static WHERE mmsi < 700000000")
        assert newest >= world.instant_s(5)
        assert scalar(store, "SELECT count(*) FROM vessel_static WHERE mmsi = 710000001") == 1, "it is in the picture"
        store.run_states.clear()
        world.write(store, run, 8, keep=KEEP, reports=named(8, [200_000_001]))
        assert scalar(store, "SELECT count(*) FROM vessel_static") <= 501


def test_changes_and_old_versions_of_zones_go_and_the_newest_version_stays(url: str) -> None:
    zone = {"name": "roads", "kind": "circle", "centre_deg": (-22.9, -43.1), "radius_nm": 1.0}
    with kept.open_store(url) as store:
        run = world.begin(store)
        for k in range(4):
            change = kept.Change(1e9 if k < 3 else 4e9, "Ana", "operator", "::1", "POST", "/api/v1/zones", 200, str(k))
            kept.note_change(store, change)
        made = kept.add_zone(store, "sea", zone, at_s=1e9, who="Ana")
        assert made is not None
        for k in range(5):
            kept.change_zone(store, "sea", made.number, {**zone, "radius_nm": 2.0 + k}, at_s=1e9 + k, who="Ana")
        assert kept.zone_version(store, "sea") == 6
        world.write(store, run, 0, keep=KEEP)
        assert scalar(store, "SELECT count(*) FROM audit") == 1
        assert scalar(store, "SELECT count(*) FROM zone") == 1
        assert kept.zones(store, "sea")[0].definition["radius_nm"] == 6.0
        assert kept.zone_version(store, "sea") == 6, "a run that watches it sees no change"
        kept.change_zone(store, "sea", made.number, None, at_s=4e9, who="Ana")
        assert kept.zone_version(store, "sea") == 7


def aged(store: Store, run_id: int, when: str) -> None:
    with writing(store) as connection:
        connection.execute(text(f"UPDATE run SET finished_utc = '{when}', written_utc = '{when}' WHERE id = {run_id}"))


def test_runs_of_a_server_that_ended_long_ago_go_in_parts_and_those_of_others_stay(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One was ended and one was killed; of one an alarm waits for its acknowledgement, and one is no server's."""
    monkeypatch.setattr(retention, "ROWS", 100)
    monkeypatch.setattr(retention, "CYCLES", 7)
    with kept.open_store(url) as store:
        finite, *of_servers = world.begin(store), *(world.begin(store, settings=SETTINGS) for _ in range(3))
        ended, died, waits = of_servers
        for run in (finite, *of_servers):
            pass_by(store, run, range(16), StoreSettings(event_gap_s=0.0))
            if run in (ended, died):
                kept.acknowledge(store, run, AlarmKey(1, "dark", 0, world.instant_s(0)), BY)
        whole = counts(store, finite)
        for run in (finite, *of_servers):
            kept.finish_run(store, run, "finished")
            aged(store, run, "2020-01-01T00:00:00Z")
        with writing(store) as connection:
            connection.execute(text(f"UPDATE run SET status = 'running', machine = 'another' WHERE id = {died}"))
        now = world.begin(store, settings=SETTINGS)
        left = []
        for _ in range(0, 2000, retention.ENDED_EVERY):
            with writing(store) as connection:
                retention.delete_ended(connection, now, KEEP)
            left.append([sum(counts(store, run).values()) for run in (ended, died)])
            if left[-1] == [0, 0] and not counts(store, waits)["cycle"]:
                break
        assert left[-1] == [0, 0]
        assert check(url) == []
        assert max(-np.diff(left, axis=0).min(axis=0)) <= 15 * 100 < sum(whole.values()), (
            "at most so many rows of each table at a time"
        )
        assert kept.runs(store).column("id") == [now, waits, finite]
        assert counts(store, finite) == whole
        after = counts(store, waits)
        assert (after["history"], after["association"], after["cycle"]) == (0, 0, 0)
        assert scalar(store, f"SELECT count(*) FROM event WHERE run_id = {waits} AND unacknowledged AND to_cycle IS NULL") == 1


def test_the_run_of_a_process_that_is_there_is_never_deleted(url: str) -> None:
    with kept.open_store(url) as store:
        waiting = world.begin(store, settings=SETTINGS)
        world.write(store, waiting, 0)
        with writing(store) as connection:
            old = "UPDATE run SET written_utc = '2020-01-01T00:00:00Z', started_utc = '2020-01-01T00:00:00Z'"
            connection.execute(text(old))
            assert retention.delete_ended(connection, waiting + 1, KEEP) == 0
        assert kept.run_status(store, waiting) == "running"
        with pytest.raises(StoreError, match="is being written"):
            kept.delete_run(store, waiting)
        assert kept.keep_runs(store, 0) == []
        with writing(store) as connection:  # a number that was given to another process since
            connection.execute(text("UPDATE run SET machine = replace(machine, 'start=', 'start=9')"))
        assert kept.run_status(store, waiting) == "died"
        with writing(store) as connection:
            connection.execute(text("UPDATE run SET machine = 'another'"))
        assert kept.run_status(store, waiting) == "died"
        assert kept.keep_runs(store, 0) == [waiting]


def test_a_run_that_another_process_writes_is_not_discarded(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        machine, own = scalar(store, "SELECT machine FROM run"), os.getpid()
        from coastwatch.store.processes import _began

        other = os.getppid()
        text_of = str(machine).replace(f"start={_began(own)}", f"start={_began(other)}")
        with writing(store) as connection:
            connection.execute(
                text("UPDATE run SET machine = :machine, process = :process"), {"machine": text_of, "process": other}
            )
        assert kept.discard_runs(store, "sea") == []
        with writing(store) as connection:
            connection.execute(text("UPDATE run SET process = 0, machine = 'gone'"))
        assert kept.discard_runs(store, "sea") == [run]


def test_a_time_that_is_not_set_has_a_limit_in_a_live_run_and_one_that_is_set_to_0_has_none() -> None:
    live = StoreSettings(history_hours=0.0, details_hours=3.0).of_live_run()
    assert (live.history_hours, live.details_hours) == (0.0, 3.0)
    assert (live.event_hours, live.audit_hours) == (LIVE_HOURS["event_hours"], LIVE_HOURS["audit_hours"])
    assert retention.longest_kept_s(live) is None
    assert retention.longest_kept_s(StoreSettings().of_live_run()) == 2160 * 3600.0
    assert not retention.is_limited(StoreSettings())
