"""Cycles are written by a thread of their own while the next one is computed. Most of that time passes outside of Python's lock."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, Self, TypeVar

from coastwatch.server.timing import Stopwatch

T = TypeVar("T")
STAGE, WAIT = "store", "store_wait"


class Writer(Generic[T]):
    """Jobs in order, one in hand at a time; use it in a `with` block, which ends when the last one has.

    The stage `store` of the stopwatch is what a job took; `store_wait` what the cycle waited for the job of the one before.
    """

    def __init__(self, watch: Stopwatch, overlap: bool) -> None:
        """Args: overlap: in a thread; else a job is done before `start` returns."""
        self._watch, self._hand = watch, ThreadPoolExecutor(1, "store") if overlap else None
        self._begun: Future[tuple[T, float]] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failed: Any) -> None:
        """The job in hand is finished whatever happened: no cycle is cut in two. What it raises is lost if something else has failed."""
        try:
            if failed[0] is None:
                self.wait()
        finally:
            if self._hand is not None:
                self._hand.shutdown()

    def wait(self) -> T | None:
        """Wait for the job in hand; gives what it gave, None where there is none. Raises: what the job raised."""
        if self._begun is None:
            return None
        begun, self._begun = self._begun, None
        with self._watch(WAIT):
            made, seconds = begun.result()
        self._watch.late(STAGE, seconds)
        return made

    def start(self, job: Callable[[], T]) -> None:
        """Begin a job; the one before must have been waited for. Raises: what the job raises, if it is not done in a thread."""
        if self._hand is not None:
            self._begun = self._hand.submit(_timed, job)
            return
        done: Future[tuple[T, float]] = Future()
        done.set_result(_timed(job))
        self._begun = done


def _timed(job: Callable[[], T]) -> tuple[T, float]:
    begun = time.perf_counter()
    made = job()
    return made, time.perf_counter() - begun
