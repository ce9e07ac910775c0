"""How per-spot work is spread: in this process, or over a pool of processes with shared memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from coastwatch.stage import Spread, in_turn

__all__ = ["spread_over"]


@contextmanager
def spread_over(count: int) -> Iterator[Spread]:
    """A Spread over so many workers; one is this process."""
    if count == 1:
        yield in_turn
        return
    from coastwatch.workers.processes import Processes

    with Processes(count) as pool:
        yield pool
