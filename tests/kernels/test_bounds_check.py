"""The kernels with checked indices, over reports that are odd but accepted: without the check a wrong index ends the process."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.contract

FUZZ = ("scaling.load.fuzz", "--messages", "6000", "--seed", "12", "--chain", "1200")


def exceptions(*command: str, **environment: str) -> list[str]:
    """What left the chain or a decoder, each as the line that the command prints."""
    run = subprocess.run(
        [sys.executable, *command, *FUZZ],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert "exceptions: " in run.stdout, run.stdout + run.stderr[-2000:]
    assert int(re.findall(r"accepted reports: ais (\d+)", run.stdout)[0]) > 100
    return re.findall(r"^  \d+ x (.*)$", run.stdout, re.MULTILINE)


def test_no_kernel_reads_beyond_an_array_over_odd_but_accepted_reports() -> None:
    """In plain Python, where numpy checks every index. A division by zero is no fault: compiled, it gives infinity."""
    wrong = exceptions(str(Path(__file__).with_name("without_numba.py")), NUMBA_DISABLE_JIT="1")
    assert [line for line in wrong if "ZeroDivisionError" not in line] == []


@pytest.mark.slow
def test_no_compiled_kernel_reads_beyond_an_array(tmp_path: Path) -> None:
    """numba checks indices only where it is asked to, when it compiles: a process and a cache of its own."""
    assert exceptions("-m", NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path)) == []
