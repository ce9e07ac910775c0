"""How per-spot work is spread: in this process alone or over its threads, over a pool of processes, or over machines."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from coastwatch.kernels.threads import threads
from coastwatch.stage import Spread, in_turn

__all__ = ["processors", "spread_over"]


def processors(count: int) -> int:
    """How many processors are used where so many are asked for: 0 means all that this process may use."""
    if count:
        return count
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def spread_over(method: str, count: int) -> Iterator[Spread]:
    """A Spread by this method over so many processors (0: all). Kernels in this process run over as many threads.

    Args: method: auto, threads, processes. What comes out is the same to the bit for all.
    """
    count = processors(count)
    with threads(count):
        if method != "processes" or count == 1:
            yield in_turn
            return
        from coastwatch.workers.processes import Processes

        with Processes(count) as pool:
            yield pool
