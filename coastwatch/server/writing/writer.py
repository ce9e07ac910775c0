"""A thread that writes cycles while the next ones are computed. The database releases Python's lock for most of that time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, Protocol, Self, TypeVar

from coastwatch.server.timing import Stopwatch
from coastwatch.store import CycleRecord, Written

T = TypeVar("T")
STAGE, WAIT = "store", "store_wait"
BEHIND = 2
"""Cycles that may be unwritten while the next one is computed: the large pictures come every few cycles and take longer than one."""


class CycleWriter(Protocol):
    """Takes cycles to be stored, in order."""

    @property
    def is_idle(self) -> bool:
        """Whether all cycles are stored."""
        ...

    def wait_for_room(self) -> str | None:
        """Wait until a cycle can be put. Returns: a warning of the store for the operator."""
        ...

    def put(self, record: CycleRecord) -> None:
        """Have a cycle stored."""
        ...

    def later(self, job: Callable[[], object]) -> object:
        """Have a job run once all cycles until now are stored."""
        ...


class Writer(Generic[T]):
    """Runs jobs in order, one at a time. Use it in a `with` block, which ends after the last job.

    Stage `store` of the stopwatch is the time of a job; `store_wait` is how long a cycle waited for jobs of earlier cycles.
    """

    def __init__(self, watch: Stopwatch, overlap: bool, behind: int = 0) -> None:
        """Args: overlap: run jobs in a thread; else a job is complete when `start` returns; behind: see `wait`."""
        self._watch, self._thread = watch, ThreadPoolExecutor(1, "store") if overlap else None
        self._behind, self._failed = behind, False
        self._jobs: deque[Future[tuple[T, float]]] = deque()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failed: Any) -> None:
        """Waits for all jobs, so that no cycle is written in part. Their errors are dropped if the block raised another."""
        try:
            self._behind = 0
            while failed[0] is None and self._jobs:
                self.wait()
        finally:
            if self._thread is not None:
                self._thread.shutdown()

    @property
    def is_idle(self) -> bool:
        """Whether all jobs are done."""
        return all(job.done() for job in self._jobs)

    def wait(self) -> T | None:
        """Wait while more than `behind` jobs are unfinished. Returns the result of the oldest job that has not been returned, None if
        it is unfinished. Raises: its error.
        """
        if not self._jobs:
            return None
        unfinished = [job for job in self._jobs if not job.done()]
        with self._watch(WAIT):
            if len(unfinished) > self._behind:
                unfinished[-1 - self._behind].exception()  # jobs finish in order
        if not self._jobs[0].done():
            return None
        result, seconds = self._jobs.popleft().result()
        self._watch.late(STAGE, seconds)
        return result

    def start(self, job: Callable[[], T]) -> None:
        """Start a job after those before it; none is run after one that failed. Raises: its error, if it does not run in a thread."""
        if self._thread is not None:
            self._jobs.append(self._thread.submit(self._timed, job))
            return
        done: Future[tuple[T, float]] = Future()
        done.set_result(self._timed(job))
        self._jobs.append(done)

    def _timed(self, job: Callable[[], T]) -> tuple[T, float]:
        if self._failed:
            raise RuntimeError("not run, because a job before it failed")
        self._failed, started = True, time.perf_counter()
        result = job()
        self._failed = False
        return result, time.perf_counter() - started


class BatchWriter(Writer[Written]):
    """The writer of a run that is not live: the run waits for the database, and ends with its error."""

    def __init__(self, watch: Stopwatch, overlap: bool, write: Callable[[CycleRecord], Written]) -> None:
        """Args: overlap: write in a thread, while the next cycles are computed."""
        super().__init__(watch, overlap, BEHIND)
        self._write = write

    def wait_for_room(self) -> str | None:
        """As of `CycleWriter`. Raises: StoreError: of an earlier cycle."""
        before = self.wait()
        return None if before is None else before.warning

    def put(self, record: CycleRecord) -> None:
        """As of `CycleWriter`."""
        self.start(lambda: self._write(record))

    def later(self, job: Callable[[], Any]) -> None:
        """As of `CycleWriter`. Raises: StoreError: of an earlier cycle."""
        self.wait()
        self.start(job)
