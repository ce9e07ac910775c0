"""Processor time and memory of each stage of the chain from plots: `python -m scaling.load.chain.stages [VESSELS [CYCLES]]`.

One thread; medians after a warm-up. Memory is the most that a stage adds to the resident memory of the process while it runs. Even cycles
are timed, in odd ones memory is measured. Linux with glibc only.
"""

from __future__ import annotations

import argparse
import ctypes
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import process_time

from coastwatch.cycle import run_cycle, start_run
from coastwatch.operators.cli.arguments import count
from coastwatch.server.timing import date_utc, machine
from coastwatch.stage import serial
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.world import Size, build_world, conditions

WARMUP = 8  # cycles: the memory of the stages has its size by then
PROCESS = Path("/proc/self")


def _resident_kib(key: str) -> int:
    """A line of the status of this process."""
    lines = (PROCESS / "status").read_text("utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))


def main() -> None:
    return_freed_memory = ctypes.CDLL(None).malloc_trim
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vessels", nargs="?", type=count, default=16_000, help="default: 16,000")
    parser.add_argument("cycles", nargs="?", type=count, default=8, help=f"after {WARMUP} that do not count (default: 8)")
    asked = parser.parse_args()
    if asked.cycles < 2:
        parser.error("got 1 cycle, needed 2: time and memory are measured in turns")
    vessels, size = asked.vessels, Size(asked.vessels, WARMUP + asked.cycles)
    world = build_world(size, {}, 1)
    scenario, sensors, plan = world.scenario, world.sensors, world.plan
    ms, mib, number = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list), 0

    @contextmanager
    def measured(stage: str) -> Iterator[None]:
        timed = number % 2 == 0
        if not timed:
            return_freed_memory(0)
            (PROCESS / "clear_refs").write_text("5", "utf-8")  # the peak is as much as is used now
            before = _resident_kib("VmRSS")
        begun = process_time()
        yield
        used = process_time() - begun
        if number >= WARMUP:
            if timed:
                ms[stage].append(1e3 * used)
            else:
                mib[stage].append((_resident_kib("VmHWM") - before) / 1024)

    state, memory = initial_state(world), start_run(scenario, sensors)
    for number in range(plan.cycles):
        state, reports = next_cycle(world, state)
        memory, _ = run_cycle(scenario, sensors, memory, reports, plan.instant_s(number), serial, measured)
    m = machine()
    print(f"# {m['processor']}, {m['processors']} processors, load {m['load']}, {date_utc()}; {conditions(size, {})}")
    print(f"# {vessels} vessels, {size.regions} regions, {len(reports.radar)} plots in the last cycle; one thread")
    print(f"{'stage':22s}{'ms':>9s}{'MiB':>9s}")
    for stage, times in ms.items():
        print(f"{stage:22s}{median(times):9.1f}{median(mib[stage]):9.1f}")


if __name__ == "__main__":
    main()
