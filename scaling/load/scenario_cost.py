"""Processor time of a cycle of a shipped scenario, in the thread of the run, and its scores:

python -m scaling.load.scenario_cost [SCENARIO] [--seed N] [--set KEY=VALUE ...] [--json]
python -m scaling.load.scenario_cost [SCENARIO] --baseline CHECKOUT [--turns T]     over that of another checkout
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.server.run import run_scenario
from scaling.load import baseline
from scaling.load.options import errors_as_one_line
from scaling.load.stages import NOT_COMPUTE

MODULE = "scaling.load.scenario_cost"
UNCOUNTED = 10  # cycles at the start


def measure(name: str, seed: int, settings: dict[str, str]) -> dict[str, Any]:
    """The figures of one run into a temporary database, as `baseline.compare` takes them; seconds, medians over the cycles.

    `compute_cpu_s` is from one cycle to the next, in the thread of the run: with scores, without the thread that stores.
    """
    at_s: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        run = run_scenario(
            load_scenario(name, settings),
            seed=seed,
            workers=1,
            database=f"sqlite:///{Path(folder) / 'run.db'}",
            on_cycle=lambda cycle: at_s.append(time.thread_time()),
        )
    if len(at_s) < UNCOUNTED + 2:
        raise ScenarioError(f"{name}: got {len(at_s)} cycles, needed {UNCOUNTED + 2} or more: --set cycles=N")
    taken_s = [after - before for before, after in zip(at_s[UNCOUNTED:], at_s[UNCOUNTED + 1 :], strict=False)]
    stages = {stage: {"median": times["median"]} for stage, times in run.timings_s.items()}
    compute_s = sum(times["median"] for stage, times in stages.items() if stage not in NOT_COMPUTE)
    figures = {"compute_s": {"median": compute_s}, "compute_cpu_s": median(taken_s), "stages_s": stages}
    return {**figures, "cycles": len(taken_s), "quality": run.scores}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="guanabara")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--baseline", metavar="CHECKOUT", type=Path)
    parser.add_argument("--turns", type=int, default=5)
    options = parser.parse_args()
    if options.baseline is not None:
        words = [options.scenario, "--seed", str(options.seed), *(word for text in options.set for word in ("--set", text))]
        compared = baseline.compare(options.baseline, words, options.turns, MODULE)
        same = compared["quality"].get("this") == compared["quality"].get("baseline")
        print("\n".join([*baseline.table(compared)[:3], f"scores: {'the same' if same else 'others'}"]))
        return
    found = measure(options.scenario, options.seed, dict(text.split("=", 1) for text in options.set))
    if options.json:
        print(json.dumps(found))
    else:
        print(f"{options.scenario}: {1e3 * found['compute_cpu_s']:.1f} ms of processor a cycle, median of {found['cycles']}")


if __name__ == "__main__":
    with errors_as_one_line():
        main()
