"""Row ranges of a kernel over threads. Kernels are compiled with nogil; what they write must not depend on the ranges."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Lock, Thread, get_native_id
from typing import Any

NICE, WORST = 10, 19  # what is added to the niceness of helpers, and the most there is
BLOCKS_A_THREAD = 4  # so that a thread that meets a dense port does not hold up the others


class _Helpers:
    """Threads that wait for work. What concurrent.futures does for a piece of work, and to wait for it, takes 30 us more."""

    def __init__(self, count: int) -> None:
        self._asked: SimpleQueue[_Share | None] = SimpleQueue()
        self._threads = [Thread(target=self._helped, name=f"kernels-{k}", daemon=True) for k in range(count)]
        for thread in self._threads:
            thread.start()

    def __len__(self) -> int:
        return len(self._threads)

    def ask(self, share: _Share, helpers: int) -> None:
        """So many of them to take part."""
        for _ in range(helpers):
            self._asked.put(share)

    def end(self) -> None:
        """Returns when all have ended what they are at."""
        for _ in self._threads:
            self._asked.put(None)
        for thread in self._threads:
            thread.join()

    def _helped(self) -> None:
        _give_way()
        while (share := self._asked.get()) is not None:
            share.help()
            del share  # and what it holds, while this thread waits for the next


def _give_way() -> None:
    """Puts this thread behind those that do other work, where threads have a rank of their own.

    Beside a thread that writes a cycle into the store a helper otherwise takes a third of two processors, the writer has as much, and ends
    long after the cycle that is computed meanwhile. What a helper leaves its caller does, and waits for him with its processor free.
    """
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, get_native_id(), min(os.getpriority(os.PRIO_PROCESS, 0) + NICE, WORST))


class _Share:
    """Work that several threads take parts of until none is left."""

    def __init__(self, work: Callable[[], None], helpers: int) -> None:
        self._work, self._failed = work, deque[BaseException]()
        self._ends = [Lock() for _ in range(helpers)]
        for end in self._ends:
            end.acquire()
        self._free = deque(self._ends)  # of helpers that have not begun

    def help(self) -> None:
        """Takes part, unless the work is done."""
        try:
            end = self._free.popleft()
        except IndexError:
            return
        try:
            self._work()
        except BaseException as failure:
            self._failed.append(failure)
        finally:
            end.release()

    def close(self) -> None:
        """Waits for the helpers that have begun; who has not by now is not needed."""
        idle: list[Lock] = []
        while self._free:
            try:
                idle.append(self._free.pop())
            except IndexError:  # it was the last one's, who has just begun
                break
        for end in self._ends:
            if end not in idle:
                end.acquire()

    def check(self) -> None:
        """Raises: what a helper raised."""
        if self._failed:
            raise self._failed[0]


_pools: list[_Helpers] = []  # the innermost `threads` last; none: the caller's thread alone


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Inside the block `in_blocks` runs over so many threads, of which the caller's is one; results are the same for any number."""
    if count < 2:
        yield
        return
    helpers = _Helpers(count - 1)
    _pools.append(helpers)
    try:
        yield
    finally:
        _pools.remove(helpers)
        helpers.end()


def blocks(count: int, least: int) -> list[tuple[int, int]]:
    """0..count cut into ranges for the threads at hand, none under `least` rows unless it is the only one."""
    wanted = (len(_pools[-1]) + 1) * BLOCKS_A_THREAD if _pools else 1
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
    out: list[Any] = [None] * len(ranges)
    todo = iter(enumerate(ranges))  # its next one is taken whole by one thread

    def work() -> None:
        for k, part in todo:
            out[k] = kernel(*part, *arguments)

    helpers = min(len(_pools[-1]), len(ranges) - 1)
    share = _Share(work, helpers)
    _pools[-1].ask(share, helpers)
    try:
        work()
    finally:
        share.close()
    share.check()
    return out
