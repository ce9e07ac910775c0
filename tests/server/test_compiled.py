"""`coastwatch compile`: a run that comes after it compiles nothing, and processes share what they compile."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from coastwatch.operators.cli import _one_line
from coastwatch.server import compiled

AGAIN = "`python -m scaling.load.signatures` writes down what runs call now"
SHARED = ("coastwatch.kernels.groups.", "coastwatch.kernels.sorting.")  # kernels that are made of the same functions
COUNTED = """
import sys
from numba.core import event
from coastwatch.server.compiled import is_ours
from scaling.load import signatures
with event.install_recorder("numba:compile") as seen:
    getattr(signatures, sys.argv[1])(*(int(word) if word.isdigit() else word for word in sys.argv[2:]))
functions = [what.data["dispatcher"] for _, what in seen.buffer if what.is_start]
print("COMPILED", *sorted({f"{f.py_func.__module__}.{f.py_func.__qualname__}" for f in functions}))
"""
COUNT = """
import sys
from coastwatch.server import compiled
compiled.known = lambda: sys.argv[2:]
print(compiled.compile_known(int(sys.argv[1]), lambda *_: None).compiled)
"""


def said(code: str, *words: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def after_the_command() -> None:
    subprocess.run(
        [sys.executable, "-c", "from coastwatch.operators.cli import main; raise SystemExit(main(['compile']))"], check=True
    )


@pytest.mark.slow
@pytest.mark.usefixtures("after_the_command")
@pytest.mark.parametrize(
    "words", [("national", "2000", "2", "8"), ("scenario", "context-driven-100")], ids=lambda words: words[0]
)
def test_a_run_compiles_nothing_after_the_command(words: tuple[str, ...]) -> None:
    assert said(COUNTED, *words).rpartition("COMPILED")[2].split() == [], AGAIN


@pytest.mark.slow
@pytest.mark.usefixtures("after_the_command")
@pytest.mark.skipif(compiled.library() is None, reason="this SQLite can be asked for SQL alone")
def test_what_sqlite_calls_back_is_there_after_the_command() -> None:
    code = f"import {compiled.CALLED_BACK} as c; print(c.take_row.cache_hits, c.finish.cache_hits)"
    assert said(code).split() == ["1", "1"]


def test_every_line_names_a_kernel_and_its_types() -> None:
    lines = compiled.known()
    assert len(lines) > 80
    for line in lines:
        name, _, given = line.partition(" ")
        kernel = compiled.function(name)
        assert compiled.as_line(kernel, compiled.argument_types(given)) == line, AGAIN


def test_two_processes_compile_no_function_twice(tmp_path: Path) -> None:
    lines = [line for line in compiled.known() if line.startswith(SHARED)]
    assert len(lines) > 3
    made = {count: int(said(COUNT, str(count), *lines, NUMBA_CACHE_DIR=str(tmp_path / str(count)))) for count in (1, 2)}
    assert made[1] >= len(lines)
    assert made[2] == made[1]
    assert int(said(COUNT, "2", *lines, NUMBA_CACHE_DIR=str(tmp_path / "2"))) == 0


def test_where_nothing_can_be_kept_is_one_sentence() -> None:
    error = RuntimeError("cannot cache function '_seen': no locator available for file '/opt/coastwatch/seen.py'")
    assert "set NUMBA_CACHE_DIR to a folder" in _one_line(error)
