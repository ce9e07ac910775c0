"""Wall-clock time of each stage of each cycle."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Stopwatch:
    """Seconds of each stage, a list a stage with one entry a cycle; `lap()` ends a cycle and returns what it took."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
    _late: dict[str, float] = field(default_factory=dict)
    _cycle: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begun = time.perf_counter()
        try:
            yield
        finally:
            self._cycle[stage] = self._cycle.get(stage, 0.0) + time.perf_counter() - begun

    def late(self, stage: str, seconds: float) -> None:
        """Note a stage of a cycle before that has only now ended, such as the store's own: its seconds stand in the row of this one."""
        self._late[stage] = seconds
        self.seconds.setdefault(stage, []).append(seconds)

    def so_far(self) -> dict[str, float]:
        """The seconds of each stage of the cycle in hand; of one that ends after its row is written, those of the last."""
        return {**self._late, **self._cycle}

    def lap(self) -> dict[str, float]:
        """The seconds of each stage since the last lap."""
        done, self._cycle = self._cycle, {}
        for stage, seconds in done.items():
            self.seconds.setdefault(stage, []).append(seconds)
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
