"""What handles the signals of this process while it works, and independent work over several processes."""

from __future__ import annotations

import itertools
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing import get_context
from types import FrameType
from typing import TypeVar

One = TypeVar("One")
Made = TypeVar("Made")


@contextmanager
def handled_by(
    handler: Callable[[int, FrameType | None], object], signals: Sequence[int] = (signal.SIGINT, signal.SIGTERM)
) -> Iterator[None]:
    """Have a function handle signals until the block ends. In another thread than the main one nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, before in usual.items():
            signal.signal(number, before)


def over_processes(work: Callable[[One], Made], pieces: Sequence[One], count: int) -> Iterator[tuple[One, Made]]:
    """Each piece with its result, in order of completion.

    Args: work: a module-level function; count: number of processes, 1: this one. Ctrl-C and SIGTERM stop it.
    Raises: KeyboardInterrupt; the errors of the work, after which no further piece is started.
    """
    with handled_by(signal.default_int_handler, [signal.SIGTERM]):  # as Ctrl-C, so that no process remains
        if count == 1 or len(pieces) < 2:
            for piece in pieces:
                yield piece, work(piece)
            return
        # forked from a clean server: a fork after OpenMP has run here is unsafe
        # Ctrl-C reaches every process of a terminal; only the parent process must react
        ignored = (signal.SIGINT, signal.SIG_IGN)
        pool = ProcessPoolExecutor(min(count, len(pieces)), get_context("forkserver"), signal.signal, ignored)
        waiting = iter(pieces)
        running = {pool.submit(work, piece): piece for piece in itertools.islice(waiting, count)}
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    piece = running.pop(future)
                    yield piece, future.result()
                    following = next(waiting, None)
                    if following is not None:
                        running[pool.submit(work, following)] = following
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
