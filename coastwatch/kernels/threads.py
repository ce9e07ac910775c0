"""Row ranges of a kernel, or whole calls, over threads. Kernels are compiled with nogil; what they write must not depend on the ranges."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from threading import get_native_id, local
from typing import TypeVar

T = TypeVar("T")
NICE, MOST_NICE = 10, 19  # what is added to the niceness of pool threads, and the most there is
BLOCKS_A_THREAD = 4  # so that a thread with a dense port does not delay the others

_pools: list[
    tuple[ThreadPoolExecutor, int]
] = []  # the innermost `threads` last, with its size; none: the caller's thread alone


class _Here(local):
    """Of this thread: whether it carries out one of several calls, which use no other thread."""

    busy = False


_here = _Here()


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
    wanted = (_pools[-1][1] + 1) * BLOCKS_A_THREAD if _pools and not _here.busy else 1
    parts = max(min(wanted, count // max(least, 1)), 1)
    return [(count * k // parts, count * (k + 1) // parts) for k in range(parts)]


def in_blocks(kernel: Callable[..., T], count: int, *arguments: object, least: int = 4096) -> list[T]:
    """kernel(low, high, *arguments) for ranges that cover 0..count, over the available threads, the caller's included.

    Args: kernel: compiled with nogil; it writes rows low to high of its output alone. least: rows under which a thread costs more
    than it gains.
    Returns: what each call returned, in the order of the ranges. Raises: what a call raised.
    """
    return over_threads([partial(kernel, *part, *arguments) for part in blocks(count, least)])


def over_threads(calls: Sequence[Callable[[], T]]) -> list[T]:
    """What each call returns, over the available threads, the caller's included. Several calls use one thread each.

    Returns: in the order of the calls. Raises: what a call raised.
    """
    if len(calls) < 2 or not _pools or _here.busy:
        return [call() for call in calls]
    out: dict[int, T] = {}
    todo = iter(enumerate(calls))  # shared by the threads: each takes the next call

    def work() -> None:
        _here.busy = True
        try:
            for k, call in todo:
                out[k] = call()
        finally:
            _here.busy = False

    pool, size = _pools[-1]
    others = [pool.submit(work) for _ in range(min(size, len(calls) - 1))]
    try:
        work()
    finally:
        running = [other for other in others if not other.cancel()]  # a thread that has not begun is not needed
        failures = [other.exception() for other in running]
    for failure in failures:
        if failure:
            raise failure
    return [out[k] for k in range(len(calls))]
