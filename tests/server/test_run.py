"""A run into a database: the same rows whatever the workers and the interruptions, and something sensible when there is nothing to see."""

from __future__ import annotations

import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import event

from coastwatch import store
from coastwatch.operators.cli import main
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.run import RunResult, run_scenario
from coastwatch.store import Store, StoreError
from coastwatch.store.migrate import check

SEED = 2001
PATIENCE_S = 120.0  # compiling the kernels for the first time takes most of it
STATE = (
    "vessel",
    "history",
    "member",
    "member_history",
    "presence",
    "association",
    "bearing_association",
    "bearing_track",
    "spot",
    "sensor_registration",
)
KILLS = 3
PAGES = 80  # of 16 kB: room for a few cycles and the checkpoint
LONG = {"input.count": "40", "cycles": "150", "warmup_s": "30.0", "store.checkpoint_every": "4"}
"""Some seconds: long enough to be killed three times. A checkpoint now and then, so that what is resumed lies before what is stored."""


def rows(path: Path, run_id: int | None = None, tables: tuple[str, ...] = STATE) -> dict[str, list[tuple[Any, ...]]]:
    """What a run (the newest) says of the sea, to the bit, with the number of the run left out."""
    with closing(sqlite3.connect(path)) as raw:
        (newest,) = raw.execute("SELECT max(id) FROM run").fetchone()
        asked = ((t, raw.execute(f"SELECT * FROM {t} WHERE run_id = ?", (run_id or newest,)).fetchall()) for t in tables)
        return {table: sorted((row[1:] for row in found), key=repr) for table, found in asked}


def column(path: Path, query: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as raw:
        return [row[0] for row in raw.execute(query)]


def url(path: Path) -> str:
    return f"sqlite:///{path}"


def small(**settings: str) -> Scenario:
    """context-driven-100 for 15 cycles, in three spots so that there is something to spread."""
    given = {"cycles": "15", "warmup_s": "0.0", "spots.count": "3"}
    return load_scenario("context-driven-100", given | {k.replace("__", "."): v for k, v in settings.items()})


def run(path: Path, scenario: Scenario, **given: Any) -> RunResult:
    return run_scenario(scenario, seed=SEED, database=url(path), **given)


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


@pytest.mark.parametrize("method", ["processes", "threads"])
def test_two_workers_give_the_rows_of_one(alone: Path, tmp_path: Path, method: str) -> None:
    made = run(tmp_path / "two.db", small(workers__method=method), workers=2)
    assert column(tmp_path / "two.db", "SELECT workers FROM run") == [2]
    assert rows(tmp_path / "two.db") == rows(alone)
    assert made.scores == run(tmp_path / "one.db", small(), workers=1).scores


def test_a_cycle_written_beside_the_next_leaves_the_rows_of_one_written_in_turn(alone: Path, tmp_path: Path) -> None:
    made = run(tmp_path / "in turn.db", small(store__overlap="false"))
    assert rows(tmp_path / "in turn.db") == rows(alone)
    assert made.timings_s["store"]["total"] > 0.0
    stages = column(tmp_path / "in turn.db", "SELECT stage FROM stage_timing WHERE cycle = 14 ORDER BY number")
    assert stages == column(alone, "SELECT stage FROM stage_timing WHERE cycle = 14 ORDER BY number")
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


def test_a_resume_under_other_settings_begins(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with pytest.raises(RuntimeError):
        run(path, small(store__checkpoint_every="2"), on_cycle=after(5, RuntimeError("mast down")))
    assert run(path, small(store__checkpoint_every="2", spots__count="2"), resume=True).run_id == 2


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
        run(path, scenario, on_cycle=after(9, RuntimeError("mast down")))
    assert column(path, "SELECT status FROM run") == ["failed"]
    assert column(path, "SELECT max(number) FROM cycle") == [9]
    made = run(path, scenario, resume=True)
    assert made.run_id == 1
    assert column(path, "SELECT status FROM run") == ["finished"]
    assert rows(path) == rows(alone)


def command(path: Path, *words: str) -> subprocess.Popen[str]:
    """`coastwatch run` of the long scenario in a process of its own."""
    settings = [word for key, value in LONG.items() for word in ("--set", f"{key}={value}")]
    line = [
        sys.executable,
        "-m",
        "coastwatch.operators.cli",
        "run",
        "context-driven-100",
        "--seed",
        str(SEED),
        "--db",
        url(path),
    ]
    code = "import sys; from coastwatch.operators.cli import main; sys.exit(main(sys.argv[1:]))"
    return subprocess.Popen(
        [line[0], "-c", code, *line[3:], *settings, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def stored(path: Path) -> int:
    """Cycles stored; 0 while there is no database."""
    try:
        return int(column(path, "SELECT count(*) FROM cycle")[0])
    except sqlite3.OperationalError:
        return 0


def wait_for(path: Path, cycles: int, started: subprocess.Popen[str]) -> None:
    until = time.monotonic() + PATIENCE_S
    while stored(path) < cycles:
        assert started.poll() is None, started.communicate()
        assert time.monotonic() < until, "no cycle was stored"
        time.sleep(0.005)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunResult]:
    path = tmp_path_factory.mktemp("uninterrupted") / "x.db"
    return path, run(path, load_scenario("context-driven-100", LONG))


def test_killed_at_random_moments_it_resumes_to_the_rows_of_an_uninterrupted_run(
    uninterrupted: tuple[Path, RunResult], tmp_path: Path
) -> None:
    path, rng = tmp_path / "x.db", np.random.default_rng([SEED, 1])
    for kill in range(KILLS):
        started = command(path, "--resume")
        wait_for(path, 25 + 40 * kill, started)
        time.sleep(0.1 * rng.random())
        started.send_signal(signal.SIGKILL)
        started.communicate()
        assert started.returncode == -signal.SIGKILL
        assert check(url(path)) == []
        assert column(path, "SELECT status FROM run") == ["running"]
        assert stored(path) < 160
    started = command(path, "--resume")
    _, err = started.communicate(timeout=PATIENCE_S)
    assert started.returncode == 0, err
    assert column(path, "SELECT status FROM run") == ["finished"]
    assert check(url(path)) == []
    whole, result = uninterrupted
    assert rows(path) == rows(whole)
    assert stored(path) == stored(whole) == result.cycles
    assert column(path, "SELECT scores FROM run") == column(whole, "SELECT scores FROM run")


def test_an_interrupt_ends_after_a_whole_cycle_and_resume_goes_on(
    uninterrupted: tuple[Path, RunResult], tmp_path: Path
) -> None:
    path = tmp_path / "x.db"
    started = command(path)
    wait_for(path, 30, started)
    started.send_signal(signal.SIGINT)
    _, err = started.communicate(timeout=PATIENCE_S)
    assert started.returncode == 130, err
    assert column(path, "SELECT status FROM run") == ["interrupted"]
    cycles = stored(path)
    assert 30 <= cycles < 160
    assert column(path, "SELECT max(number) + 1 FROM cycle") == [cycles]
    assert column(path, "SELECT max(cycle) + 1 FROM spot") == [cycles]
    assert check(url(path)) == []
    made = run(path, load_scenario("context-driven-100", LONG), resume=True)
    assert (made.run_id, made.interrupted) == (1, False)
    assert rows(path) == rows(uninterrupted[0])


def test_no_truth_gives_no_scores(tmp_path: Path) -> None:
    nmea = tmp_path / "one.nmea"
    nmea.write_text(
        "".join(f"2025-06-01T12:00:{s:02d}Z !AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0*23\n" for s in range(0, 60, 10))
    )
    scenario = load_scenario("context-driven-100", {"cycles": "3", "warmup_s": "0.0"}).model_copy(
        update={"input": feed("nmea", files=[str(nmea)])}
    )
    made = run(tmp_path / "x.db", scenario)
    assert made.scores == {}
    assert column(tmp_path / "x.db", "SELECT scores FROM run") == [None]


def feed(method: str, **settings: Any) -> Any:
    """An input that a file could name."""
    scenario = load_scenario("context-driven-100").model_dump(mode="json")
    return Scenario.model_validate(scenario | {"input": {"method": method, **settings}}).input


def test_no_vessels_give_an_empty_picture(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    made = run(path, small(input__count="0"))
    assert (made.vessels, made.cycles, stored(path)) == (0, 15, 15)
    assert all(found == [] for table, found in rows(path).items() if table not in ("spot", "sensor_registration"))
    assert made.scores["fused_tracks"]["count"] == 0
    assert made.scores["fused_tracks"]["position_rmse_m"] is None
    assert check(url(path)) == []


def test_clutter_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    run(path, small(input__count="0", input__radar__clutter_per_m2="5e-7", tracks__plot_origin="estimated"))
    assert column(path, "SELECT sum(reports) FROM cycle")[0] > 100
    assert column(path, "SELECT status FROM run") == ["finished"]


@pytest.mark.parametrize("without", [{"input__ais__share": "0.0"}, {"radars": "[]"}], ids=["AIS", "radars"])
def test_where_nothing_can_be_fused_the_rest_is_scored(without: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    made = run(path, small(**without))
    assert made.vessels > 20
    assert made.scores["fused_tracks"]["count"] == 0
    assert made.scores["fused_tracks"]["bound_position_rmse_m"] is None
    assert column(path, "SELECT status FROM run") == ["finished"]


def test_one_vessel(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    settings = {"input__count": "1", "input__ais__share": "1.0", "input__area_width_nm": "1.0", "input__area_height_nm": "1.0"}
    made = run(path, small(workers__method="processes", **settings), workers=2)
    assert made.vessels == 1
    assert set(column(path, "SELECT vessel_id FROM history")) == {1}
    assert check(url(path)) == []


def test_a_sea_without_sensors(tmp_path: Path) -> None:
    made = run(tmp_path / "x.db", small(radars="[]", stations="[]", sonars="[]", input__ais__share="0.0"))
    assert made.vessels == 0


def settled(scenario: Scenario, path: Path, alone: Path) -> None:
    """What was broken off goes on from what is stored and ends as if nothing had been."""
    assert check(url(path)) == []
    made = run(path, scenario, resume=True)
    assert (made.run_id, stored(path)) == (1, 15)
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
    settings = {"cycles": "15", "warmup_s": "0.0", "spots.count": "3", "store.checkpoint_every": "1"}

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
    assert 0 < stored(path) < 15
    settled(load_scenario("context-driven-100", settings), path, alone)
