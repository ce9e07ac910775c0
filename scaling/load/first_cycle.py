"""Time and memory of the first cycles, first with nothing compiled, then with everything compiled:

    python -m scaling.load.first_cycle [--tracks N] [--root CHECKOUT]

Each of the two runs is a process of its own, with one temporary folder for compiled kernels. --root names another checkout.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from scaling.load import national

SETTINGS = {"store.recording": "true"}
PROGRAM = """
import json, sys, time, tempfile
from scaling.load.run import Load, run_cycles
from scaling.load.processes import memory_bytes
with tempfile.TemporaryDirectory() as folder:
    begun, cpu = time.perf_counter(), time.process_time()
    load = Load(int(sys.argv[1]), 6, 0, 2, f"sqlite:///{folder}/run.db", settings=json.loads(sys.argv[2]), score=False)
    for k, cycle in enumerate(run_cycles(load)):
        if k in (0, 5):
            print(f"  to the end of cycle {k}: {time.perf_counter() - begun:6.1f} s, processor {time.process_time() - cpu:6.1f} s")
print(f"  memory {memory_bytes()[0] / 2**20:.0f} MiB (PSS)")
"""


def output_of(root: Path, cache: str, *arguments: str) -> str:
    """What the program prints, run in a checkout with a folder for compiled kernels."""
    environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-c", PROGRAM, *arguments]
    return subprocess.run(command, env=environment, cwd=root, stdout=subprocess.PIPE, text=True, check=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", type=int, default=2_000)
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[2])
    options = parser.parse_args()
    print(f"# {options.tracks} tracks, 2 workers, store sqlite; {national.conditions(SETTINGS)}")
    with tempfile.TemporaryDirectory() as cache:
        for title in ("nothing compiled", "everything compiled"):
            print(
                title, output_of(options.root, cache, str(options.tracks), json.dumps(SETTINGS)), sep="\n", end="", flush=True
            )


if __name__ == "__main__":
    main()
