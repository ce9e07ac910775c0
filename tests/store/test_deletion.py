"""Deleted runs: a few rows a transaction, in no answer meanwhile, and finished later where the deletion was interrupted."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.operators.cli import main
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store
from coastwatch.store.schema import database
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.migrate import check
from coastwatch.store.schema.tables import METADATA, OF_NO_RUN
from coastwatch.store.write import retention

pytestmark = pytest.mark.contract

FEW = 100
"""Rows a transaction in these tests."""


@pytest.fixture(autouse=True)
def few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    from coastwatch.store import deletion

    monkeypatch.setattr(deletion, "ROWS", FEW)
    monkeypatch.setattr(deletion, "PAUSE_S", 0.0)


def two_runs(store: Store) -> tuple[int, int]:
    """A run that has ended, with a recording and a checkpoint, and one that goes on."""
    ended, going_on = world.begin(store), world.begin(store)
    for number in range(12):
        world.write(store, ended, number, keep=StoreSettings(recording=True, history_max_s=0.0))
    kept.finish_run(store, ended, "interrupted")
    world.write(store, going_on, 0)
    return ended, going_on


def rows_of(store: Store, run_id: int) -> int:
    tables = [name for name, table in METADATA.tables.items() if table not in (*OF_NO_RUN, METADATA.tables["run"])]
    with reading(store) as connection:
        counts = (f"SELECT count(*) FROM {name} WHERE run_id = {run_id}" for name in tables)
        return sum(int(connection.execute(text(count)).scalar_one()) for count in counts)


@pytest.mark.parametrize("command", ["delete", "keep", "prune", "discard"])
def test_a_run_is_deleted_a_few_rows_at_a_time_while_another_one_is_written(url: str, command: str) -> None:
    with kept.open_store(url) as store, kept.open_store(url, wait_s=0.2) as server:
        ended, going_on = two_runs(store)
        left, said = [rows_of(store, ended)], []

        def cycle_of_the_server(done: int, total: int, what: str) -> None:
            world.write(server, going_on, len(said) + 1)
            left.append(rows_of(server, ended))
            said.append((done, total, what))
            if left[-1]:
                assert kept.runs(server).column("status") == ["running", "deleting"]

        if command == "delete":
            kept.delete_run(store, ended, cycle_of_the_server)
        elif command == "keep":
            assert kept.keep_runs(store, 1, on_part=cycle_of_the_server) == [ended]
        elif command == "discard":
            with writing(store) as connection:
                connection.execute(text(f"UPDATE run SET scenario = 'lake' WHERE id = {ended}"))
            assert kept.discard_runs(store, "lake", on_part=cycle_of_the_server) == [ended]
        else:
            with writing(store) as connection:
                connection.execute(text(f"UPDATE run SET finished_utc = '2020-01-01T00:00:00Z' WHERE id = {ended}"))
            assert kept.prune(store, 86_400.0, on_part=cycle_of_the_server).runs == [ended]
        assert max(before - after for before, after in pairwise(left)) <= FEW
        assert left[-1] == 0
        assert said[0][:2] == (0, 1)
        assert said[-1] == (1, 1, f"run {ended}: {left[0]:,} rows deleted")
        assert kept.runs(store).column("id") == [going_on]
    assert check(url) == []


def interrupt(store: Store, run_id: int) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept.delete_run(store, run_id, stop)


def test_nobody_reads_resumes_or_writes_what_is_left_of_a_run(url: str) -> None:
    with kept.open_store(url) as store:
        ended, going_on = world.begin(store), world.begin(store, "lake")
        ended, going_on = going_on, ended  # the newest one goes
        for run in (ended, going_on):
            world.write(store, run, 0)
        kept.finish_run(store, ended, "interrupted")
        assert [one.run_id for one in kept.unfinished_runs(store, "lake", 1)] == [ended]
        interrupt(store, ended)
        assert rows_of(store, ended) > 0
        assert check(url) == []
        assert kept.latest_run(store) == going_on
        assert (kept.newest_picture(store) or [None])[0] == going_on
        assert kept.newest_picture(store, ended) is None
        assert kept.unfinished_runs(store, "lake", 1) == []
        for asked in (kept.run, kept.picture, partial(kept.resume_run, title="", version="0.1.0", settings={})):
            with pytest.raises(StoreError, match=f"there is no run {ended}, needed one of {going_on};"):
                asked(store, ended)
        with pytest.raises(kept.NoSuchRunError):
            world.write(store, ended, 1)
        kept.finish_run(store, ended, "finished")
        assert kept.runs(store).column("status") == ["deleting", "running"]


@pytest.mark.parametrize("later", ["command", "server"])
def test_an_interrupted_deletion_is_finished_later(url: str, later: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a server also where it keeps all for ever."""
    monkeypatch.setattr(retention, "ENDED_EVERY", 1)
    with kept.open_store(url) as store:
        ended, going_on = two_runs(store)
        interrupt(store, ended)
        with writing(store) as connection:
            connection.execute(text(f"UPDATE run SET machine = 'gone' WHERE id = {ended}"))
        if later == "command":
            assert kept.keep_runs(store, 9) == []
        for number in range(1, 100 if later == "server" else 1):
            world.write(store, going_on, number, 1, keep=StoreSettings(event_hours=0.0, audit_hours=0.0))
            if rows_of(store, ended) == 0 and number > 20:
                break
        assert kept.runs(store).column("id") == [going_on]
        assert rows_of(store, ended) == 0
    assert check(url) == []


def test_the_command_says_how_far_it_is(url: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from coastwatch.operators.cli import progress

    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.0)
    with kept.open_store(url) as store:
        ended, _ = two_runs(store)
    assert main(["runs", "delete", str(ended), "--db", url]) == 0
    assert f"run 0 of 1: run {ended}: {FEW} rows deleted" in capsys.readouterr().err


def test_a_long_log_after_a_large_write_is_no_readers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process writes: the log cannot be cut now, and nobody holds it."""
    monkeypatch.setattr(database, "LOG_BYTES", 30 * database.PAGE_BYTES)
    path = tmp_path / "x.db"
    with kept.open_store(str(path)) as store, closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA wal_autocheckpoint = 0")
        run = world.begin(store)
        world.write(store, run, 0, 600)
        other.execute("CREATE TABLE large (bytes BLOB)")
        other.execute("INSERT INTO large VALUES (randomblob(5000000))")
        assert Path(f"{path}-wal").stat().st_size > database.TOO_LONG * database.log_bytes(600)
        other.execute("BEGIN IMMEDIATE")
        assert database.long_log_warning(store, 600) is None
        other.execute("COMMIT")
        other.execute("DROP TABLE large")
        assert database.long_log_warning(store, 600) is None
        assert Path(f"{path}-wal").stat().st_size == 0
