"""A run that is killed or interrupted: what is stored is whole, and resumed it ends with the rows of one that never stopped."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from run_world import SEED, Start, column, rows, run, stored, url

from coastwatch import store
from coastwatch.scenario import load_scenario
from coastwatch.server.run import RunResult
from coastwatch.store import open_store
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.whole

PATIENCE_S = 600.0  # a busy machine that compiles the kernels for the first time
KILLS = 2
LONG = {
    "input.count": "30",
    "cycles": "27",
    "warmup_s": "9.0",
    "store.checkpoint_every": "4",
    "tracks.plot_origin": "estimated",  # by the default tracker
    "input.radar.clutter_per_m2": "3e-7",
}
"""Some seconds: long enough to be killed twice. A checkpoint now and then, so that what is resumed lies before what is stored."""

WHOLE = 30
"""Cycles of the whole run: 3 to warm up, and 27, so that each checkpoint has scores."""


def command(path: Path, *words: str) -> list[str]:
    """`run` of the long scenario."""
    settings = [word for key, value in LONG.items() for word in ("--set", f"{key}={value}")]
    return ["run", "context-driven-100", "--seed", str(SEED), "--db", url(path), *settings, *words]


def wait_for(path: Path, cycles: int, started: subprocess.Popen[str]) -> None:
    until = time.monotonic() + PATIENCE_S
    while stored(path) < cycles:
        assert started.poll() is None, started.communicate()
        assert time.monotonic() < until, "no cycle was stored"
        time.sleep(0.02)  # a cycle takes longer


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunResult]:
    path = tmp_path_factory.mktemp("uninterrupted") / "x.db"
    return path, run(path, load_scenario("context-driven-100", LONG))


def test_killed_at_random_moments_it_resumes_to_the_rows_of_an_uninterrupted_run(
    uninterrupted: tuple[Path, RunResult], start: Start, tmp_path: Path
) -> None:
    path, rng = tmp_path / "x.db", np.random.default_rng([SEED, 1])
    for kill in range(KILLS):
        started = start(*command(path, "--resume"))
        wait_for(path, 6 + 5 * kill, started)
        time.sleep(0.1 * rng.random())
        started.send_signal(signal.SIGKILL)
        started.communicate()
        assert started.returncode == -signal.SIGKILL
        assert check(url(path)) == []
        assert column(path, "SELECT status FROM run") == ["running"]  # as it was left, but it is known to be dead
        with open_store(url(path)) as opened:
            assert store.runs(opened).column("status") == ["died"]
            assert store.run_status(opened, 1) == "died"
        assert stored(path) < WHOLE
    made = run(path, load_scenario("context-driven-100", LONG), resume=True)
    assert (made.run_id, made.interrupted) == (1, False)
    assert column(path, "SELECT status FROM run") == ["finished"]
    assert check(url(path)) == []
    whole, result = uninterrupted
    assert rows(path) == rows(whole)
    assert stored(path) == stored(whole) == result.cycles
    assert column(path, "SELECT scores FROM run") == column(whole, "SELECT scores FROM run")


@pytest.mark.slow
def test_an_interrupt_ends_after_a_whole_cycle_and_resume_goes_on(
    uninterrupted: tuple[Path, RunResult], start: Start, tmp_path: Path
) -> None:
    path = tmp_path / "x.db"
    started = start(*command(path))
    wait_for(path, 8, started)
    started.send_signal(signal.SIGINT)
    _, err = started.communicate(timeout=PATIENCE_S)
    assert started.returncode == 130, err
    assert column(path, "SELECT status FROM run") == ["interrupted"]
    cycles = stored(path)
    assert 8 <= cycles < WHOLE
    assert column(path, "SELECT max(number) + 1 FROM cycle") == [cycles]
    assert column(path, "SELECT max(cycle) + 1 FROM spot") == [cycles]
    assert check(url(path)) == []
    made = run(path, load_scenario("context-driven-100", LONG), resume=True)
    assert (made.run_id, made.interrupted) == (1, False)
    assert rows(path) == rows(uninterrupted[0])
