"""A run into a database: the same rows whatever the workers and the spots, and after a restart, failure, lock and full disk."""

from __future__ import annotations

import sqlite3
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import pytest
from run_world import SEED, column, rows, run, small, stored, url
from sqlalchemy import event

from coastwatch import store
from coastwatch.centre import Cycle
from coastwatch.errors import StoreError
from coastwatch.operators import presentation
from coastwatch.operators.cli import main
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.store import Rows, Store
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

PAGES = 66  # of 16 kB: room for a few cycles and the checkpoint


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of one small run by one worker."""
    path = tmp_path_factory.mktemp("alone") / "alone.db"
    made = run(path, small(), workers=1)
    assert made.vessels > 50
    assert len(rows(path)["history"]) > 200
    assert rows(path)["association"]
    return path


def test_the_same_again_is_the_same_to_the_bit(alone: Path, tmp_path: Path) -> None:
    run(tmp_path / "again.db", small())
    assert rows(tmp_path / "again.db") == rows(alone)


@pytest.mark.parametrize("method", [pytest.param("processes", marks=pytest.mark.slow), "threads"])
def test_two_workers_give_the_rows_of_one(alone: Path, tmp_path: Path, method: str) -> None:
    run(tmp_path / "two.db", small(workers__method=method), workers=2)
    assert column(tmp_path / "two.db", "SELECT workers FROM run") == [2]
    assert rows(tmp_path / "two.db") == rows(alone)
    assert column(tmp_path / "two.db", "SELECT scores FROM run") == column(alone, "SELECT scores FROM run")


def test_a_worker_that_is_killed_is_counted_and_changes_nothing(alone: Path, tmp_path: Path) -> None:
    fifth_s = small().plan().instant_s(4)

    def kill(cycle: Cycle) -> None:
        if cycle.time_s == fifth_s:
            for process in active_children():
                process.kill()

    made = run(tmp_path / "killed.db", small(workers__method="processes"), workers=2, on_cycle=kill)
    assert rows(tmp_path / "killed.db") == rows(alone)
    found = [(fault.kind, fault.count, fault.where) for fault in made.faults if "worker" in fault.kind]
    assert found == [("worker lost and replaced, its work computed again", 1, "workers.method = processes")]
    assert "worker lost and replaced" in column(tmp_path / "killed.db", "SELECT faults FROM run")[0]


def test_records_that_a_stage_drops_are_counted_and_listed(tmp_path: Path) -> None:
    late = {"input__ais__latency_s": "11", "input__ais__latency_spread_s": "20", "cycles": "12"}
    made = run(tmp_path / "late.db", small(**late))
    (fault,) = made.faults
    assert (fault.kind, fault.where) == ("AIS report dropped: too late", "ais_tracks")
    assert fault.count > 20
    runs = stored_runs(tmp_path / "late.db")
    assert runs.rows[0][runs.columns.index("faults")] == fault.count


def stored_runs(path: Path) -> Rows:
    """The table of `coastwatch runs`."""
    with store.open_store(url(path)) as opened:
        return presentation.runs_table(presentation.runs(opened))


def test_a_cycle_written_beside_the_next_leaves_the_rows_of_one_written_in_turn(alone: Path, tmp_path: Path) -> None:
    made = run(tmp_path / "in turn.db", small(store__overlap="false"))
    assert rows(tmp_path / "in turn.db") == rows(alone)
    assert made.timings_s["store"]["total"] > 0.0
    stages = column(tmp_path / "in turn.db", "SELECT stage FROM stage_timing WHERE cycle = 9 ORDER BY number")
    assert stages == column(alone, "SELECT stage FROM stage_timing WHERE cycle = 9 ORDER BY number")
    assert {"store", "store_wait"} <= set(stages)


def test_a_run_may_be_kept_in_memory_alone() -> None:
    assert run_scenario(small(cycles="3"), seed=SEED, database="sqlite://").cycles == 3


def test_the_number_of_spots_changes_no_picture(alone: Path, tmp_path: Path) -> None:
    run(tmp_path / "one.db", small(spots__count="1"))
    for table in ("vessel", "history", "member", "association"):
        assert rows(tmp_path / "one.db")[table] == rows(alone)[table], table


def test_another_seed_is_another_sea(alone: Path, tmp_path: Path) -> None:
    run_scenario(small(), seed=SEED + 1, database=url(tmp_path / "other.db"))
    assert rows(tmp_path / "other.db")["history"] != rows(alone)["history"]


def test_a_restart_leaves_one_run_and_the_same_rows(alone: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    run(path, small(cycles="6"))
    kept = run_scenario(small(cycles="6"), seed=SEED + 1, database=url(path)).run_id
    made = run(path, small(), restart=True)
    assert column(path, "SELECT id FROM run ORDER BY id") == [kept, made.run_id]
    assert rows(path) == rows(alone)
    assert len(rows(path, kept)["history"]) > 0
    assert check(url(path)) == []


def test_a_resume_with_nothing_unfinished_begins(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    first, second = run(path, small(cycles="5"), resume=True), run(path, small(cycles="5"), resume=True)
    assert (first.run_id, second.run_id) == (1, 2)
    assert rows(path, 1) == rows(path, 2)


def test_a_resume_under_other_settings_begins(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "x.db"
    with pytest.raises(RuntimeError):
        run(path, small(cycles="7", store__checkpoint_every="2"), on_cycle=after(5, RuntimeError("mast down")))
    assert run(path, small(cycles="7", store__checkpoint_every="2", spots__count="2"), resume=True).run_id == 2
    assert "a new run begins: run 1 had other settings: spots.count" in caplog.messages


def after(cycles: int, error: Exception) -> Any:
    """Something that goes wrong in the cycle after so many."""
    seen: list[int] = []

    def look(cycle: object) -> None:
        seen.append(1)
        if len(seen) > cycles:
            raise error

    return look


def test_a_failure_is_noted_and_a_resume_ends_as_if_there_had_been_none(alone: Path, tmp_path: Path) -> None:
    path, scenario = tmp_path / "x.db", small(store__checkpoint_every="4")
    with pytest.raises(RuntimeError, match="mast down"):
        run(path, scenario, on_cycle=after(6, RuntimeError("mast down")))
    assert column(path, "SELECT status FROM run") == ["failed"]
    assert column(path, "SELECT max(number) FROM cycle") == [6]
    made = run(path, scenario, resume=True)
    assert made.run_id == 1
    assert column(path, "SELECT status FROM run") == ["finished"]
    assert rows(path) == rows(alone)


def settled(scenario: Scenario, path: Path, alone: Path) -> None:
    """What was broken off goes on from what is stored and ends as if nothing had been."""
    assert check(url(path)) == []
    made = run(path, scenario, resume=True)
    assert (made.run_id, stored(path)) == (1, 10)
    assert rows(path) == rows(alone)
    assert check(url(path)) == []


def test_a_database_that_another_locks_in_mid_run(alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, scenario, plain = tmp_path / "x.db", small(store__checkpoint_every="1"), store.open_store
    held: list[sqlite3.Connection] = []
    seen: list[object] = []

    def hold(cycle: object) -> None:
        seen.append(cycle)
        if len(seen) == 2:
            held.append(sqlite3.connect(path, isolation_level=None))
            held[0].execute("BEGIN IMMEDIATE")

    with monkeypatch.context() as patch:
        patch.setattr(store, "open_store", lambda where: plain(where, wait_s=0.2))
        with pytest.raises(StoreError, match="database is locked by another process"):
            run(path, scenario, on_cycle=hold)
    held[0].rollback()
    held[0].close()
    assert stored(path) in (1, 2)  # the second is being written, or has just been, when the lock is taken
    settled(scenario, path, alone)


def test_a_disk_that_fills_in_mid_run(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, plain = tmp_path / "x.db", store.open_store
    settings = {"cycles": "10", "warmup_s": "0.0", "spots.count": "3", "store.checkpoint_every": "1"}

    def cramped(where: str) -> Store:
        opened = plain(where)
        event.listen(opened.engine, "begin", lambda raw: raw.exec_driver_sql(f"PRAGMA max_page_count = {PAGES}"))
        return opened

    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    with monkeypatch.context() as patch:
        patch.setattr(store, "open_store", cramped)
        assert main(["run", "context-driven-100", "--seed", str(SEED), "--db", url(path), *words]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("coastwatch: error: ")
    assert "disk full" in last
    assert "every whole cycle stored so far is kept" in last
    assert 0 < stored(path) < 10
    settled(load_scenario("context-driven-100", settings), path, alone)
