"""How per-spot work is spread: over the threads of this process, over a pool of processes, or over machines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from coastwatch.kernels.threads import threads
from coastwatch.stage import Spread, in_turn
from coastwatch.workers.freed import keep_freed_memory
from coastwatch.workers.processors import processors

__all__ = ["processors", "spread_over"]


@contextmanager
def spread_over(method: str, count: int) -> Iterator[Spread]:
    """A Spread by this method over so many processors (0: all). Kernels in this process run over as many threads as it may use.

    Args: method: auto, threads, processes, ray. What comes out is the same to the bit for all.
    """
    keep_freed_memory()
    if method == "ray":
        from coastwatch.workers.ray import Actors

        with threads(processors(0)), Actors(count) as actors:
            yield actors
        return
    count = processors(count)
    with threads(count):
        if method != "processes" or count == 1:
            yield in_turn
            return
        from coastwatch.workers.processes import Processes

        with Processes(count) as pool:
            yield pool
