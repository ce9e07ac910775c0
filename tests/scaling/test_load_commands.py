"""Errors of the load commands are one line, a run in the database has its status, and --json prints JSON alone."""

from __future__ import annotations

import json
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from coastwatch.store import open_store, runs
from coastwatch.store.schema import database
from scaling.load import cycle, dense, queries, ramp, scenario_cost, seeds, soak, stages
from scaling.load.run import Load, run_cycles

pytestmark = pytest.mark.contract


def exit_of(
    command: Callable[[], None], words: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> tuple[object, str]:
    """Exit code and last line on stderr of a command that fails, which prints nothing on standard output."""
    monkeypatch.setattr(sys, "argv", ["command", *words.split()])
    with pytest.raises(SystemExit) as end:
        command()
    out, err = capfd.readouterr()
    assert out == ""
    assert "Traceback" not in err
    return end.value.code, err.splitlines()[-1]


@pytest.mark.parametrize(
    ("command", "words", "message"),
    [
        (cycle.main, "--tracks 0", "--tracks: got '0', needed 1 or more"),
        (cycle.main, "--tracks -5", "--tracks: got '-5', needed a whole number"),
        (cycle.main, "--cycles 0", "--cycles: got '0', needed 1 or more"),
        (cycle.main, "--warmup -1", "--warmup: got '-1', needed a whole number"),
        (cycle.main, "--workers -1", "--workers: got '-1', needed a whole number"),
        (cycle.main, "--set period_s", "--set: got 'period_s', needed KEY=VALUE"),
        (soak.main, "--minutes 0", "--minutes: got '0', needed 1 or more"),
        (
            soak.main,
            "--store sqlite://",
            "--store: got 'sqlite://', needed a database that the console, another process, can read",
        ),
        (soak.main, "--store :memory:", "--store: got ':memory:', needed a database that"),
        (
            cycle.main,
            "--baseline /nowhere",
            "--baseline: got /nowhere, needed a checkout with .venv/bin/python, and no --store",
        ),
        (ramp.main, "--from 10 --to 10", "got 10 and 10, needed the first below the last"),
        (ramp.main, "--from 0", "--from: got '0', needed 1 or more"),
    ],
)
def test_an_invalid_option_is_refused(
    command: Callable[[], None], words: str, message: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    code, line = exit_of(command, words, monkeypatch, capfd)
    assert code == 2
    assert message in line


@pytest.mark.parametrize(
    ("command", "words", "message"),
    [
        (cycle.main, "--tracks 50 --store /nowhere/x.db", "error: /nowhere/x.db: there is no folder /nowhere"),
        (cycle.main, "--tracks 50 --set colour=red", "error: --set colour: got 'red' for an unknown setting"),
        (soak.main, "--tracks 50 --store /nowhere/x.db", "error: /nowhere/x.db: there is no folder /nowhere"),
        (ramp.main, "--from 50 --to 60 --store /nowhere/x.db", "error: /nowhere/x.db: there is no folder /nowhere"),
    ],
)
def test_an_invalid_database_or_setting_is_one_line(
    command: Callable[[], None], words: str, message: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    code, line = exit_of(command, words, monkeypatch, capfd)
    assert code == 1
    assert line.startswith(message)


def test_a_history_too_short_for_queries_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", f"queries --points 500 --vessels 100 --database {tmp_path / 'q.db'} --json".split())
    with pytest.raises(SystemExit, match="s of history, needed more than 720 s"):
        queries.main()


@pytest.mark.parametrize("command", [cycle, soak])
def test_an_interrupt_is_one_word(
    command: ModuleType, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(load: Load) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run_cycles", interrupted)
    assert exit_of(command.main, "--tracks 50", monkeypatch, capfd) == (130, "interrupted")


@pytest.mark.parametrize(
    ("error", "status"),
    [(KeyboardInterrupt(), "interrupted"), (None, "interrupted"), (ValueError("x"), "failed")],
    ids=["interrupted in a cycle", "interrupted between two", "failed"],
)
def test_a_run_in_the_database_has_its_status(error: BaseException | None, status: str, tmp_path: Path) -> None:
    path = tmp_path / "load.db"
    cycles = run_cycles(Load(100, 3, 0, store=f"sqlite:///{path}", score=False))
    next(cycles)
    if error is None:
        cycles.close()
    else:
        with pytest.raises(type(error)):
            cycles.throw(error)
    with open_store(str(path)) as database:
        assert runs(database).column("status") == [status]


def test_a_database_in_memory_is_written_by_the_thread_that_made_it() -> None:
    every = list(run_cycles(Load(50, 3, 0, store="sqlite://", score=False)))
    assert every[-1].rows_written > 0


def test_a_reader_that_holds_the_log_is_reported_in_the_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "LOG_BYTES", 1 << 17)
    monkeypatch.setattr(database, "PICTURE_BYTES", 1)
    path = tmp_path / "load.db"
    warnings = []
    for one in run_cycles(Load(300, 12, 0, store=f"sqlite:///{path}", score=False)):
        if one.number == 2:
            reader = sqlite3.connect(path, isolation_level=None)
            reader.execute("BEGIN")
            reader.execute("SELECT count(*) FROM cycle").fetchone()
        warnings.append(one.warning_text)
    reader.close()
    assert warnings[0] == ""
    assert "another process reads in one transaction and does not end it" in warnings[-1]


def test_standard_output_is_json_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stages, "measure", lambda *arguments: SimpleNamespace(timings_s={"spots": {"median": 0.001}}))
    monkeypatch.setattr(seeds, "scores_of", lambda *arguments: {"associations": {"f1": 1.0}})
    words_of_queries = f"--points 6000 --vessels 150 --database {tmp_path / 'q.db'} --ask 3 --only box --warm --json"
    for command, words in ((queries, words_of_queries), (stages, "guanabara --json"), (seeds, "guanabara --seeds 1-1 --json")):
        monkeypatch.setattr(sys, "argv", ["command", *words.split()])
        command.main()
        assert json.loads(capsys.readouterr().out)


def test_dense_traffic_is_a_table_by_stage_with_exponents(capsys: pytest.CaptureFixture[str]) -> None:
    dense.main(["--vessels", "60", "120", "--width-nm", "0.5", "--cycles", "3"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].split() == ["60", "120", "exponent"]
    row = {line.split()[0]: line.split()[1:] for line in lines[3:]}
    assert {"associations", "alarms", "bearing_associations", "all", "left_out"} <= row.keys()
    assert int(row["in_picture"][1]) > int(row["in_picture"][0]) > 20
    dense.main(["--vessels", "60", "--cycles", "2", "--json"])
    assert [run["vessels"] for run in json.loads(capsys.readouterr().out)["runs"]] == [60]


def test_the_exponent_of_growth_is_that_of_the_seconds() -> None:
    runs = [{"vessels": n, "stages_s": {"quick": 1e-6 * n, "square": 1e-6 * n**2}} for n in (100, 200, 400)]
    assert dense.exponents(runs)["square"] == pytest.approx(2.0)
    assert np.isnan(dense.exponents(runs)["quick"])


def test_the_cost_of_a_scenario_has_what_a_comparison_of_checkouts_takes(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["command", "guanabara", "--set", "cycles=3", "--set", "input.count=30", "--json"]
    monkeypatch.setattr(sys, "argv", words)
    scenario_cost.main()
    found = json.loads(capfd.readouterr().out)
    assert 0.0 < found["compute_cpu_s"] < 2.0
    assert found["compute_s"]["median"] > 0.0
    assert found["cycles"] > 3
    assert found["quality"]["associations"]
    asked = []
    compared = {"module": "m", "arguments": ["a"], "ratio": {"compute_cpu_s": 1.0}, "quality": {"this": 1, "baseline": 1}}
    compared["compute_cpu_s"] = {"this": [0.01], "baseline": [0.01]}
    monkeypatch.setattr(scenario_cost.baseline, "compare", lambda *given: asked.append(given) or compared)
    monkeypatch.setattr(sys, "argv", [*words[:-1], "--baseline", "/there"])
    scenario_cost.main()
    assert capfd.readouterr().out.endswith("scores: the same\n")
    assert asked[0][:2] == (Path("/there"), [*words[1:2], "--seed", "1", *words[2:-1]])
