"""What is too old goes, a little in every cycle; what is kept is whole; the write-ahead log stays short, or it is said why it does not."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.geodesy import difference_m
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store
from coastwatch.store.schema import database
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.migrate import check
from coastwatch.store.write import retention

pytestmark = pytest.mark.contract

CYCLES = 40
HOURS = 20 * world.PERIOD_S / 3600.0  # twenty cycles
KEEP = StoreSettings(history_hours=HOURS, details_hours=HOURS / 2.0, history_max_s=21.0)


def scalars(store: Store, query: str) -> list[Any]:
    with reading(store) as connection:
        return list(connection.execute(text(query)).scalars())


def filled(url: str, keep: StoreSettings, cycles: int = CYCLES) -> Store:
    store = kept.open_store(url)
    run = world.begin(store)
    for number in range(cycles):
        world.write(store, run, number, keep=keep)
    return store


def test_what_is_too_old_is_gone_and_the_rest_is_whole(url: str) -> None:
    with filled(url, KEEP) as store:
        first = CYCLES - 20
        assert scalars(store, "SELECT min(number) FROM cycle WHERE history_from IS NOT NULL") == [first]
        oldest = scalars(store, f"SELECT history_from FROM cycle WHERE number = {first}")
        assert first - 8 < oldest[0] <= first
        assert scalars(store, "SELECT min(cycle) FROM history") == oldest
        for table in ("presence", "member_history"):
            assert scalars(store, f"SELECT min(to_cycle) FROM {table}") == [first]
        for table in retention.DETAILS:
            assert scalars(store, f"SELECT min(cycle) FROM {table}") == [CYCLES - 10]
        assert scalars(store, "SELECT count(*) FROM cycle") == [CYCLES]
        for number in (first, first + 7, CYCLES - 1):
            then, truth = kept.picture(store, 1, world.instant_s(number)), world.picture_of(number, 30)
            assert then.column("vessel_id") == truth.vessel_id.tolist()
            place = np.array([then.column("latitude_deg"), then.column("longitude_deg")]).T
            assert (np.hypot(*difference_m(place, truth.position_deg).T) <= KEEP.history_error_m).all()
        with pytest.raises(StoreError, match="its first kept cycle is at"):
            kept.picture(store, 1, world.instant_s(first - 1))
        assert len(kept.track(store, 1, 5).history.rows) > 0
    assert check(url) == []


def test_what_is_kept_for_ever_stays(url: str) -> None:
    with filled(url, StoreSettings(), 30) as store:
        assert scalars(store, "SELECT min(number) FROM cycle WHERE history_from IS NOT NULL") == [0]
        assert scalars(store, "SELECT min(cycle) FROM history") == [0]
        assert scalars(store, "SELECT min(cycle) FROM stage_timing") == [0]


def test_a_backlog_is_worked_off_in_steps(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run kept all of forty cycles; then less is to be kept, by another process, and ten rows of a table may go in a cycle."""
    monkeypatch.setattr(retention, "ROWS", 10)
    monkeypatch.setattr(retention, "CYCLES", 25)
    every = {"history_max_s": 0.0, "history_error_m": 10.0}
    count = "SELECT count(*) FROM history"
    with filled(url, StoreSettings(**every), 40) as store:
        store.run_states.clear()
        rows = scalars(store, count)[0]
        deleted = []
        for number in range(40, 60):
            cycle = world.cycle_of(number, 30)
            world.write(store, 1, number, cycle=cycle, keep=StoreSettings(**every, history_hours=HOURS / 2.0))
            added = scalars(store, f"SELECT history_points FROM cycle WHERE number = {number}")[0]
            deleted.append(rows + added - scalars(store, count)[0])
            rows += added - deleted[-1]
            assert number % 5 or check(url) == []
        assert 0 < max(deleted) <= 10 + 2 * 200
        assert scalars(store, "SELECT min(cycle) FROM history") == [50]


def test_a_first_cycle_of_many_vessels_goes_in_parts(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(retention, "ROWS", 50)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(3):
            world.write(store, run, number, 300)
        with writing(store) as connection:
            for left in (223, 173, 123):  # 273 vessels came in the first cycle
                retention.delete_old(connection, run, 2, 3.0, StoreSettings(history_hours=1e-9), (2, 0), 0)
                rows = connection.execute(text("SELECT count(*) FROM history WHERE cycle = 0")).scalar_one()
                assert rows == left
            connection.rollback()


def test_the_picture_of_a_run_that_ended_long_ago_goes(url: str) -> None:
    with filled(url, StoreSettings(), 3) as store:
        kept.finish_run(store, 1, "finished")
        run = world.begin(store)
        world.write(store, run, 0, keep=StoreSettings(picture_hours=1.0))
        assert len(kept.picture(store, 1).rows) > 0
        with writing(store) as connection:
            connection.execute(text("UPDATE run SET finished_utc = '2020-01-01T00:00:00Z' WHERE id = 1"))
        world.write(store, run, 0, keep=StoreSettings(picture_hours=1.0))
        assert kept.picture(store, 1).rows == []
        assert len(kept.picture(store, run).rows) > 0
        assert len(kept.picture(store, 1, world.instant_s(2)).rows) > 0  # the past is another matter
    assert check(url) == []


def test_the_log_is_moved_into_the_database_again_and_again(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        sizes = []
        for number in range(30):
            written = world.write_and_say(store, run, number, 600)
            assert written.warning is None
            sizes.append(Path(f"{path}-wal").stat().st_size)
        assert max(sizes) < 1.5 * database.LOG_BYTES
        assert sizes[-1] == max(sizes)  # it is used again from its beginning, not made anew


def test_a_reader_that_holds_a_transaction_open_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "LOG_BYTES", 60 * database.PAGE_BYTES)
    path = tmp_path / "x.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        world.write(store, run, 0, 600)
        reader = sqlite3.connect(path, isolation_level=None)
        reader.execute("BEGIN")
        seen = reader.execute("SELECT count(*), max(time_s) FROM vessel").fetchone()
        said = [world.write_and_say(store, run, number, 600).warning for number in range(1, 12)]
        assert said[0] is None
        assert said[-1] is not None
        assert "x.db-wal has grown to" in said[-1]
        assert "another process reads in one transaction and does not end it" in said[-1]
        assert reader.execute("SELECT count(*), max(time_s) FROM vessel").fetchone() == seen  # and it is not disturbed
        reader.execute("COMMIT")
        assert world.write_and_say(store, run, 12, 600).warning is None
        assert Path(f"{path}-wal").stat().st_size < 3 * 60 * database.PAGE_BYTES
        reader.close()
    assert check(str(path)) == []


def _write_all(store: Store, run: int, numbers: Iterator[int]) -> None:
    for number in numbers:
        world.write(store, run, number, 600)


def test_a_log_that_a_reader_holds_never_takes_the_room_that_it_needs_to_be_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "LOG_BYTES", 60 * database.PAGE_BYTES)
    path, free = tmp_path / "x.db", 300 * database.PAGE_BYTES
    monkeypatch.setattr(database.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        world.write(store, run, 0, 600)
        with closing(sqlite3.connect(path, isolation_level=None)) as reader:
            reader.execute("BEGIN")
            reader.execute("SELECT count(*) FROM vessel").fetchone()
            numbers = iter(range(1, 60))
            with pytest.raises(StoreError, match="nothing is written until it ends"):
                _write_all(store, run, numbers)
            number = 60 - len(list(numbers)) - 1
            size = Path(f"{path}-wal").stat().st_size
            assert free < size < 2 * free
            with pytest.raises(StoreError, match="another process reads in one transaction"):
                world.write(store, run, number, 600)
            assert Path(f"{path}-wal").stat().st_size == size
        world.write(store, run, number, 600)  # the reader has ended
        assert Path(f"{path}-wal").stat().st_size < size
    assert check(str(path)) == []


def test_the_length_of_the_log_grows_with_the_picture() -> None:
    lengths = [database.log_bytes(vessels) for vessels in (100, 10_000, 200_000, 262_144, 4_000_000)]
    assert lengths == sorted(lengths)
    assert lengths[0] == database.LOG_BYTES
    assert lengths[2] == 8 * 200_000 * 256
    assert lengths[-1] == database.MOST_LOG_BYTES


def test_a_cycle_fits_into_the_memory_of_its_connection(tmp_path: Path) -> None:
    """Pages that do not are written before the transaction ends, some of them twice."""
    with kept.open_store(str(tmp_path / "x.db")) as store, writing(store) as connection:
        for vessels, kib in ((100, 16_384), (100_000, 37_500), (4_000_000, 524_288)):
            database.size_for(connection, vessels)
            assert connection.exec_driver_sql("PRAGMA cache_size").scalar_one() == -kib
