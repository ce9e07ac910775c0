"""Wall-clock time of each stage of each cycle; date and machine of a computation, for reports."""

from __future__ import annotations

import os
import platform
import statistics
import time
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from coastwatch.spelling import utc_text

KEPT = 20_000
"""Cycles of which times are kept, 8 bytes a stage each: a run of a server lasts for months. Totals are of all cycles."""


@dataclass
class Stopwatch:
    """Seconds of each stage in the newest cycles, one entry per cycle. `lap()` ends a cycle and returns its seconds."""

    seconds: dict[str, array[float]] = field(default_factory=dict)
    totals_s: dict[str, float] = field(default_factory=dict)  # of all cycles
    _late: dict[str, float] = field(default_factory=dict)
    _cycle: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        started = time.perf_counter()
        try:
            yield
        finally:
            self._cycle[stage] = self._cycle.get(stage, 0.0) + time.perf_counter() - started

    def late(self, stage: str, seconds: float) -> None:
        """Record a stage of the cycle before, such as the store's: its seconds are stored in the row of this cycle."""
        self._late[stage] = seconds
        self._add(stage, seconds)

    def so_far(self) -> dict[str, float]:
        """The seconds of each stage of this cycle; of a late stage, those of the last."""
        return {**self._late, **self._cycle}

    def lap(self) -> dict[str, float]:
        """The seconds of each stage since the last lap."""
        done, self._cycle = self._cycle, {}
        for stage, seconds in done.items():
            self._add(stage, seconds)
        return done

    def _add(self, stage: str, seconds: float) -> None:
        every = self.seconds.setdefault(stage, array("d"))
        every.append(seconds)
        if len(every) > KEPT:
            del every[: KEPT // 2]
        self.totals_s[stage] = self.totals_s.get(stage, 0.0) + seconds

    def summary(self) -> dict[str, dict[str, float]]:
        """For each stage median and p99 of the newest cycles, total seconds, and its share of the total of all stages."""
        everything = sum(self.totals_s.values())
        figures = {}
        for stage, values in self.seconds.items():
            ordered = sorted(values)
            figures[stage] = {
                "median": statistics.median(ordered),
                "p99": ordered[min(int(0.99 * len(ordered)), len(ordered) - 1)],
                "total": self.totals_s[stage],
                "share": self.totals_s[stage] / everything if everything > 0.0 else 0.0,
            }
        return figures


def date_utc() -> str:
    """The date and time now, ISO 8601, whole minutes."""
    return utc_text(time.time(), "minutes")


def machine() -> dict[str, str | int | float]:
    """Processor, number of processors, operating system, Python, and the load of the last minute."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return {
        "processor": next(names, platform.machine()),
        "processors": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0,
    }
