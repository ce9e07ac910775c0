"""A thread that writes a cycle while the next one is computed. The database releases Python's lock for most of that time."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, Self, TypeVar

from coastwatch.server.timing import Stopwatch

T = TypeVar("T")
STAGE, WAIT = "store", "store_wait"


class Writer(Generic[T]):
    """Runs jobs in order, one at a time. Use it in a `with` block, which ends after the last job.

    Stage `store` of the stopwatch is the time of a job; `store_wait` is how long a cycle waited for the job of the cycle before.
    """

    def __init__(self, watch: Stopwatch, overlap: bool) -> None:
        """Args: overlap: run jobs in a thread; else a job is complete when `start` returns."""
        self._watch, self._thread = watch, ThreadPoolExecutor(1, "store") if overlap else None
        self._running: Future[tuple[T, float]] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failed: Any) -> None:
        """Waits for the job in progress, so that no cycle is written in part. Its error is dropped if the block raised another."""
        try:
            if failed[0] is None:
                self.wait()
        finally:
            if self._thread is not None:
                self._thread.shutdown()

    def wait(self) -> T | None:
        """Wait for the job in progress. Returns its result, None without a job. Raises: the error of the job."""
        if self._running is None:
            return None
        running, self._running = self._running, None
        with self._watch(WAIT):
            made, seconds = running.result()
        self._watch.late(STAGE, seconds)
        return made

    def start(self, job: Callable[[], T]) -> None:
        """Start a job; `wait` must have returned for the one before. Raises: the error of the job, if it does not run in a thread."""
        if self._thread is not None:
            self._running = self._thread.submit(_timed, job)
            return
        done: Future[tuple[T, float]] = Future()
        done.set_result(_timed(job))
        self._running = done


def _timed(job: Callable[[], T]) -> tuple[T, float]:
    started = time.perf_counter()
    made = job()
    return made, time.perf_counter() - started
