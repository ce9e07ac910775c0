"""Row ranges of a kernel over threads. Kernels are compiled with nogil; what they write must not depend on the ranges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

BLOCKS_A_THREAD = 4  # so that a thread that meets a dense port does not hold up the others

_pools: list[tuple[int, ThreadPoolExecutor]] = []  # the innermost `threads` last; none: the caller's thread alone


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Inside the block `in_blocks` runs over so many threads; results are the same for any number."""
    if count < 2:
        yield
        return
    with ThreadPoolExecutor(count) as pool:
        _pools.append((count, pool))
        try:
            yield
        finally:
            _pools.remove((count, pool))


def blocks(count: int, least: int) -> list[tuple[int, int]]:
    """0..count cut into ranges for the threads at hand, none under `least` rows unless it is the only one."""
    wanted = _pools[-1][0] * BLOCKS_A_THREAD if _pools else 1
    parts = max(min(wanted, count // max(least, 1)), 1)
    return [(count * k // parts, count * (k + 1) // parts) for k in range(parts)]


def in_blocks(kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096) -> list[Any]:
    """kernel(low, high, *arguments) for ranges that cover 0..count, over the threads at hand, of which the caller's is one.

    A caller that only waited would leave its processor to be found by a thread that wakes: two of them began on one processor, and a
    cycle in two threads took as long as in one.

    Args: kernel: compiled with nogil; it writes rows low to high of its output alone. least: rows under which a thread costs more
    than it gains.
    Returns: what each call returned, in the order of the ranges.
    """
    ranges = blocks(count, least)
    if len(ranges) == 1:
        return [kernel(*ranges[0], *arguments)]
    threads_here, pool = _pools[-1]
    out: list[Any] = [None] * len(ranges)
    todo = iter(enumerate(ranges))  # its next one is taken whole by one thread

    def work() -> None:
        for k, part in todo:
            out[k] = kernel(*part, *arguments)

    others = [pool.submit(work) for _ in range(min(threads_here, len(ranges)) - 1)]
    try:
        work()
    finally:
        begun = [other for other in others if not other.cancel()]  # who has not begun by now is not needed
        wait(begun)
    for other in begun:
        other.result()
    return out
