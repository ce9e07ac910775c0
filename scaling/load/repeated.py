"""Memory of a recording that goes on for a day: the same reports again and again, with later times, into a database:

    python -m scaling.load.repeated [--scenario solent] [--times 24] [--pause 600] [--database URL] [--set KEY=VALUE ...]

Each line has one repetition: cycles, vessels, memory now and its highest so far, bytes of the database, and seconds of processor.
The vessels of a repetition have the MMSI of the one before and are where they were at its start, after a pause in which nobody sends.
The last line has the slope of the memory over the second half, in MiB for each repetition.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from sqlalchemy import make_url

from coastwatch.batches import Fault, FileContent, Recording, Reports, Sensors
from coastwatch.centre import Cycle
from coastwatch.operators.cli.arguments import count, pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.stage import Plan
from scaling.load.processes import memory_bytes

MIB = 2**20


class RepeatedStream:
    """Reports of a span that come again after each `span_s` seconds."""

    def __init__(self, reports: Reports, start_s: float, span_s: float, times: int) -> None:
        self._reports, self._start_s, self._span_s, self._times = reports, start_s, span_s, times

    def between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportStream.between`."""
        first, last = (int(np.clip((t - self._start_s) // self._span_s, 0, self._times - 1)) for t in (after_s, until_s))
        parts = []
        for number in range(first, last + 1):
            shift_s = number * self._span_s
            parts.append(_later(self._reports.between(after_s - shift_s, until_s - shift_s), shift_s))
        return Reports.merged(parts)

    def faults(self) -> tuple[Fault, ...]:
        """As `ReportStream.faults`."""
        return ()

    def contents(self) -> tuple[FileContent, ...]:
        """As `ReportStream.contents`."""
        return ()

    def rest(self, after_s: float) -> int:
        """As `ReportStream.rest`."""
        return 0


def _later(reports: Reports, shift_s: float) -> Reports:
    """The reports with later times."""
    parts: dict[str, Any] = {}
    for part in fields(reports):
        rows = getattr(reports, part.name)
        moved = {name: getattr(rows, name) + shift_s for name in ("time_s", "received_s") if hasattr(rows, name)}
        parts[part.name] = replace(rows, **moved)
    return Reports(**parts)


def repeated(scenario: Scenario, times: int, pause_s: float) -> tuple[Scenario, int]:
    """The scenario with its input repeated, and the cycles of a repetition."""
    plan = scenario.plan()
    pause = int(np.ceil(pause_s / plan.period_s))
    cycles = plan.cycles + pause
    found = scenario.input.load(scenario.sensors(), scenario.seed, plan).whole()
    stream = RepeatedStream(found, plan.start_s, cycles * plan.period_s, times)
    whole = Plan(start_s=plan.start_s, period_s=plan.period_s, cycles=cycles * times)

    class Again(type(scenario)):  # type: ignore[misc]
        """The scenario with a longer plan."""

        def plan(self) -> Plan:
            return whole

    class Input(type(scenario.input)):  # type: ignore[misc]
        """The feed with the stream of its reports in place of its file."""

        def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
            return Recording(stream)

    given = {name: getattr(scenario, name) for name in type(scenario).model_fields}
    source = Input.model_construct(**{name: getattr(scenario.input, name) for name in type(scenario.input).model_fields})
    return Again.model_construct(**(given | {"input": source})), cycles


def lines(scenario: Scenario, cycles: int, database: str) -> Iterator[str]:
    """A line for each repetition."""
    made: list[str] = []
    memory: list[float] = []
    seen = 0

    def note(cycle: Cycle) -> None:
        nonlocal seen
        seen += 1
        if seen % cycles == 0:
            now, peak = (size / MIB for size in memory_bytes())
            memory.append(now)
            name = make_url(database).database
            size = Path(name).stat().st_size / MIB if name and Path(name).is_file() else 0.0
            line = f"{seen // cycles:>4} {cycle.time_s - started_s:>9.0f} s {seen:>7} cycles {len(cycle.picture):>5} vessels"
            made.append(f"{line} {now:>7.0f} MiB, {peak:>7.0f} most {size:>7.1f} MiB stored {time.process_time():>7.0f} s")
            print(made[-1], flush=True)

    started_s = scenario.plan().start_s
    run_scenario(scenario, database=database, on_cycle=note)
    half = memory[len(memory) // 2 :]
    if len(half) > 1:
        yield f"slope of the memory over the last {len(half)} repetitions: {np.polyfit(np.arange(len(half)), half, 1)[0]:+.2f} MiB each"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="solent")
    parser.add_argument("--times", type=count, default=24, help="how often the recording is run")
    parser.add_argument("--pause", type=float, default=600.0, help="seconds between two repetitions")
    parser.add_argument("--database", help="URL of a database that is kept; else a file that is deleted at the end")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    options = parser.parse_args()
    scenario, cycles = repeated(load_scenario(options.scenario, dict(options.set)), options.times, options.pause)
    with TemporaryDirectory() as folder:
        for line in lines(scenario, cycles, options.database or f"sqlite:///{folder}/repeated.db"):
            print(line)


if __name__ == "__main__":
    main()
