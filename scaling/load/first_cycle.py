"""What does the first cycle cost where nothing is compiled, and where all is? And how much memory does the process keep?

python -m scaling.load.first_cycle [--tracks N] [--root PATH]

Each run is a process of its own with a scratch folder for compiled kernels: the first finds nothing there, the second everything.
--root names another checkout, so that two versions can be compared in turns.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

RUN = """
import sys, time, tempfile
from scaling.load.run import Load, run_cycles
from scaling.load.processes import memory_bytes
with tempfile.TemporaryDirectory() as folder:
    begun, cpu = time.perf_counter(), time.process_time()
    load = Load(int(sys.argv[1]), 6, 0, 2, f"sqlite:///{folder}/run.db", settings={"store.recording": "true"}, score=False)
    for k, cycle in enumerate(run_cycles(load)):
        if k in (0, 5):
            print(f"  to the end of cycle {k}: {time.perf_counter() - begun:6.1f} s, {time.process_time() - cpu:6.1f} s of the processor")
print(f"  memory {memory_bytes()[0] / 2**20:.0f} MiB (PSS)")
"""


def said(root: Path, cache: str, code: str, *words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": cache}
    return subprocess.run(
        [sys.executable, "-c", code, *words], env=environment, cwd=root, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tracks", type=int, default=2_000)
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[2])
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        for what in ("first run", "second run"):
            print(what, said(asked.root, cache, RUN, str(asked.tracks)), sep="\n", end="", flush=True)


if __name__ == "__main__":
    main()
