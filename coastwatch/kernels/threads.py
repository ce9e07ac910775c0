"""Row ranges of a kernel over threads. Kernels are compiled with nogil; what they write must not depend on the ranges."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import get_native_id
from typing import Any

NICE, MOST_NICE = 10, 19  # what is added to the niceness of pool threads, and the most there is
BLOCKS_A_THREAD = 4  # so that a thread with a dense port does not delay the others

_pools: list[
    tuple[ThreadPoolExecutor, int]
] = []  # the innermost `threads` last, with its size; none: the caller's thread alone


def _lower_priority() -> None:
    """Lower the priority of a pool thread (Linux) below other threads, such as the one that writes a cycle to the store."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, get_native_id(), min(os.getpriority(os.PRIO_PROCESS, 0) + NICE, MOST_NICE))


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Inside the block, `in_blocks` uses so many threads, the caller's included. Results are the same for any number."""
    if count < 2:
        yield
        return
    with ThreadPoolExecutor(count - 1, "kernels", _lower_priority) as pool:
        _pools.append((pool, count - 1))
        try:
            yield
        finally:
            _pools.remove((pool, count - 1))


def blocks(count: int, least: int) -> list[tuple[int, int]]:
    """0..count in ranges for the available threads, each of `least` rows or more unless it is the only one."""
    wanted = (_pools[-1][1] + 1) * BLOCKS_A_THREAD if _pools else 1
    parts = max(min(wanted, count // max(least, 1)), 1)
    return [(count * k // parts, count * (k + 1) // parts) for k in range(parts)]


def in_blocks(kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096) -> list[Any]:
    """kernel(low, high, *arguments) for ranges that cover 0..count, over the available threads, the caller's included.

    Args: kernel: compiled with nogil; it writes rows low to high of its output alone. least: rows under which a thread costs more
    than it gains.
    Returns: what each call returned, in the order of the ranges. Raises: what a call raised.
    """
    ranges = blocks(count, least)
    if len(ranges) == 1:
        return [kernel(*ranges[0], *arguments)]
    out: list[Any] = [None] * len(ranges)
    todo = iter(enumerate(ranges))  # shared by the threads: each takes the next range

    def work() -> None:
        for k, part in todo:
            out[k] = kernel(*part, *arguments)

    pool, size = _pools[-1]
    others = [pool.submit(work) for _ in range(min(size, len(ranges) - 1))]
    try:
        work()
    finally:
        running = [other for other in others if not other.cancel()]  # a thread that has not begun is not needed
        failures = [other.exception() for other in running]
    for failure in failures:
        if failure:
            raise failure
    return out
