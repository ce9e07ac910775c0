"""Wall-clock time of each stage of each cycle."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

KEPT = 200_000
"""Cycles of which times are kept: a run of a server lasts for months."""


@dataclass
class Stopwatch:
    """Seconds of each stage: a list per stage with one entry per cycle. `lap()` ends a cycle and returns its seconds."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
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
        self.seconds.setdefault(stage, []).append(seconds)

    def so_far(self) -> dict[str, float]:
        """The seconds of each stage of this cycle; of a late stage, those of the last."""
        return {**self._late, **self._cycle}

    def lap(self) -> dict[str, float]:
        """The seconds of each stage since the last lap."""
        done, self._cycle = self._cycle, {}
        for stage, seconds in done.items():
            self.seconds.setdefault(stage, []).append(seconds)
        for every in self.seconds.values():
            del every[:-KEPT]
        return done

    def summary(self) -> dict[str, dict[str, float]]:
        """For each stage median, p99 and total seconds, and its share of the total of all stages."""
        everything = sum(sum(values) for values in self.seconds.values())
        out = {}
        for stage, values in self.seconds.items():
            ordered = sorted(values)
            out[stage] = {
                "median": statistics.median(ordered),
                "p99": ordered[min(int(0.99 * len(ordered)), len(ordered) - 1)],
                "total": sum(ordered),
                "share": sum(ordered) / everything if everything > 0.0 else 0.0,
            }
        return out
