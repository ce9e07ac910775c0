"""Processor seconds of each stage where all vessels are in one small square, and the exponent of growth:

python -m scaling.load.dense --vessels 1000 2000 4000 8000 --width-nm 1 [--cycles 24] [--scenario guanabara] [--json]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from coastwatch.cycle import run_cycle, start_run
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import load_scenario
from coastwatch.server.timing import date_utc, machine
from coastwatch.stage import serial
from scaling.load.options import errors_as_one_line
from scaling.load.progress import report_progress
from scaling.load.ramp import exponent

LAST = 4  # cycles whose median counts
LEAST_S = 0.02  # in the largest run: of a stage that takes less no exponent is given


def measure(vessels: int, width_nm: float, cycles: int, scenario: str) -> dict[str, Any]:
    """Median seconds of each stage over the last cycles, and what the last cycle held.

    Args: vessels: simulated, in a square of this width around the middle of the scenario's traffic.
    """
    size = {"input.count": str(vessels), "input.area_width_nm": str(width_nm), "input.area_height_nm": str(width_nm)}
    s = load_scenario(scenario, size)
    sensors, plan = s.sensors(), s.plan()
    reports, memory, before_s = s.input.load(sensors, 1, plan).reports, start_run(s, sensors), -np.inf
    cycles_s: list[dict[str, float]] = []
    with report_progress() as progress:
        for k in range(cycles):
            took: dict[str, float] = {}

            @contextmanager
            def timer(name: str, took: dict[str, float] = took) -> Iterator[None]:
                begin_s = process_time()
                yield
                took[name] = took.get(name, 0.0) + process_time() - begin_s

            now_s = plan.instant_s(k)
            memory, cycle = run_cycle(s, sensors, memory, reports.between(before_s, now_s), now_s, serial, timer)
            before_s = now_s
            cycles_s.append(took)
            progress(k + 1, cycles, f"{vessels} vessels, {sum(took.values()):.2f} s")
    last = cycles_s[-LAST:]
    stages_s = {name: median(took[name] for took in last) for name in last[-1]}
    return {
        "vessels": vessels,
        "tracks": len(cycle.tracks),
        "bearing_tracks": len(cycle.bearing_tracks),
        "in_picture": len(cycle.picture),
        "pairs_tested": cycle.associations.tested,
        "left_out": sum(getattr(cycle, "left_out", {}).values()),
        "stages_s": stages_s | {"all": median(sum(took.values()) for took in last)},
    }


def growth_of(runs: Sequence[dict[str, Any]], stage: str) -> float | None:
    """The exponent of growth of a stage; None of one size, and for a quick stage."""
    seconds = [run["stages_s"][stage] for run in runs]
    if seconds[-1] < LEAST_S or min(seconds) <= 0.0:
        return None
    return exponent([(run["vessels"], s) for run, s in zip(runs, seconds, strict=True)])


def table(runs: Sequence[dict[str, Any]]) -> str:
    """Seconds of a cycle by stage and number of vessels, and the exponents, as text."""
    lines = [f"{'':<22}" + "".join(f"{run['vessels']:>10}" for run in runs) + "  exponent"]
    for name in runs[-1]["stages_s"]:
        row = "".join(f"{run['stages_s'][name]:10.3f}" for run in runs)
        growth = growth_of(runs, name)
        lines.append(f"{name:<22}{row}{'-' if growth is None else f'{growth:.2f}':>10}")
    for name in ("tracks", "bearing_tracks", "in_picture", "pairs_tested", "left_out"):
        lines.append(f"{name:<22}" + "".join(f"{run[name]:10d}" for run in runs))
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vessels", type=count, nargs="+", default=[1000, 2000, 4000], metavar="N", help="numbers of vessels")
    parser.add_argument("--width-nm", type=float, default=1.0, help="of the square")
    parser.add_argument("--cycles", type=count, default=24, help="close approaches count from cycle 20 on")
    parser.add_argument("--scenario", default="guanabara", help="whose sensors and settings are used")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    with errors_as_one_line():
        measure(50, options.width_nm, 2, options.scenario)  # compiles
        runs = [measure(number, options.width_nm, options.cycles, options.scenario) for number in options.vessels]
    if options.json:
        print(json.dumps({"date": date_utc(), "machine": machine(), "width_nm": options.width_nm, "runs": runs}))
        return
    m = machine()
    print(f"# {date_utc()}, {m['processors']} x {m['processor']}, load {m['load']}")
    print(
        f"# {options.scenario}, square of {options.width_nm:g} NM, {options.cycles} cycles, median s of the last {LAST}, 1 thread"
    )
    print(table(runs))


if __name__ == "__main__":
    main()
