"""Coastwatch's tracker with filterpy's IMM, one object a track: `python -m scaling.peers.filterpy.method tracking INPUT RESULT`.

It runs in the environment of the project: gates, assignment and upkeep are those of Coastwatch, the filters are filterpy's.
"""

from __future__ import annotations

from coastwatch.tracks import TableTracker
from scaling.peers.exchange import PlotHistory, Stopwatch, Task, TaskResult, run_adapter
from scaling.peers.ours import track


def tracking(history: PlotHistory, watch: Stopwatch) -> TaskResult:
    """Radar tracks by `filterpy_imm` with default settings."""
    return track(history, watch, TableTracker(method="filterpy_imm"))


TASKS: dict[str, Task] = {"tracking": tracking}

if __name__ == "__main__":
    run_adapter(TASKS)
