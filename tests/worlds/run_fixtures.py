"""One finished run for all tests of the command line that only read, and commands in processes of their own."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from filelock import FileLock
from run_world import FinishedRun

from coastwatch.operators.cli import main

# A shell that runs the tests in the background has its children ignore Ctrl-C; a user's does not.
COMMAND = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from coastwatch.operators.cli import main; sys.exit(main())"
)


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts `coastwatch` with some arguments in a process of its own, which does not outlive the test."""
    begun: list[subprocess.Popen[str]] = []

    def started(*arguments: str, **given: Any) -> subprocess.Popen[str]:
        line = [sys.executable, "-c", COMMAND, *arguments]
        begun.append(subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **given))
        return begun[-1]

    yield started
    for process in begun:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> FinishedRun:
    """30 cycles of guanabara, recorded, made by the first process that asks. Tests only read it."""
    folder = tmp_path_factory.getbasetemp() if worker_id == "master" else tmp_path_factory.getbasetemp().parent
    printed, url, tracks = folder / "guanabara.json", f"sqlite:///{folder / 'guanabara.db'}", folder / "guanabara.csv"
    with FileLock(str(folder / "guanabara.lock")):
        if not printed.exists():
            out = io.StringIO()
            shorter = ["--set", "cycles=20", "--set", "warmup_s=30", "--set", "store.recording=true"]
            with contextlib.redirect_stdout(out):
                assert (
                    main(["run", "guanabara", "--seed", "3", "--db", url, "--json", *shorter, "--tracks-csv", str(tracks)]) == 0
                )
            assert out.getvalue().count("\n") == 1
            printed.write_text(out.getvalue(), "utf-8")
    return FinishedRun(url, json.loads(printed.read_text("utf-8")), tracks)
