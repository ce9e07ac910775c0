"""Time of each stage per cycle, for whole scenarios: `python -m scaling.load.stages SCENARIO ... [--workers N]`."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

from coastwatch.scenario import load_scenario
from coastwatch.server.run import RunResult, run_scenario
from scaling.load.seeds import conditions

NOT_COMPUTE = ("store", "scores", "checkpoint")  # stages
DEFAULT = ("context-driven-100", "context-driven-1000")


def measure(name: str, seed: int, workers: int) -> RunResult:
    """One run of a shipped scenario into a temporary database."""
    with tempfile.TemporaryDirectory() as folder:
        database = f"sqlite:///{Path(folder) / 'run.db'}"
        return run_scenario(load_scenario(name), seed=seed, workers=workers, database=database)


def table(name: str, result: RunResult, period_s: float) -> str:
    """The times of a run as text, milliseconds per cycle."""
    rows = [
        f"# {conditions(name, {})}",
        f"{name}: {result.cycles} cycles, {result.vessels} vessels at the end, {result.elapsed_s:.1f} s in all",
    ]
    compute = sum(t["median"] for stage, t in result.timings_s.items() if stage not in NOT_COMPUTE)
    for stage, t in result.timings_s.items():
        rows.append(
            f"  {stage:<22} median {1e3 * t['median']:8.2f} ms   p99 {1e3 * t['p99']:8.2f} ms   {100 * t['share']:5.1f} %"
        )
    without, share = ", ".join(NOT_COMPUTE), 100 * compute / period_s
    rows.append(
        f"  compute (sum of medians, without {without}) {1e3 * compute:.1f} ms = {share:.2f} % of the period of {period_s:g} s"
    )
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="*", default=list(DEFAULT))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.json:
        print(f"# {os.cpu_count()} processors, load {os.getloadavg()[0]:.2f}; seed {options.seed}, {options.workers} workers")
    for name in options.scenario:
        result = measure(name, options.seed, options.workers)
        print(json.dumps({name: result.timings_s}) if options.json else table(name, result, load_scenario(name).period_s))


if __name__ == "__main__":
    main()
