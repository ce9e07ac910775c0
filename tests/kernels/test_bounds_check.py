"""The kernels with checked indices, over reports that are odd but accepted: without the check a wrong index ends the process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.contract


def test_no_kernel_reads_beyond_an_array_over_odd_but_accepted_reports(tmp_path: Path) -> None:
    """numba checks indices only where it is asked to, when it compiles: a process and a cache of its own."""
    run = subprocess.run(
        [sys.executable, "-m", "scaling.load.fuzz", "--messages", "6000", "--seed", "12", "--chain", "1200"],
        env={**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}, capture_output=True, text=True, check=False,
        timeout=900,
    )  # fmt: skip
    assert "exceptions: 0" in run.stdout, run.stdout + run.stderr[-2000:]
