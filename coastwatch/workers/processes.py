"""Per-spot work in a pool of processes: arrays in shared memory, spots in chunks of about equal cost.

joblib takes 4.1 times as long for a cycle (`scaling.decisions.process_pool`).
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait

import numpy as np

from coastwatch.batches import Array
from coastwatch.stage import Arrays, Groups, S, Work, serial
from coastwatch.workers.costs import Costs, deal
from coastwatch.workers.malloc import keep_freed_memory
from coastwatch.workers.shared_memory import Published, Publisher, Reader

CHUNKS_A_WORKER = 2


def new_pool(count: int) -> ProcessPoolExecutor:
    """A pool of so many processes of this program. They begin when the first work is submitted, and end with this process."""
    return ProcessPoolExecutor(count, get_context("spawn"), _start_worker)


class Processes:
    """A Map over a pool of processes; use it in a `with` block.

    Each call copies its arrays to shared memory once; the executor returns the results. Spots are distributed by their cost in earlier
    cycles. If a process is lost, chunks without a result are computed in this process, and the next call begins with a new pool.
    """

    def __init__(self, count: int) -> None:
        if count < 2:
            raise ValueError(f"workers.count: got {count}, needed at least 2 processes")
        self.count = count
        self._publishers: dict[str, Publisher] = defaultdict(Publisher)  # of each kind of work
        self._costs: dict[str, Costs] = defaultdict(Costs)
        self._pool = new_pool(count)
        self.lost = 0  # pools so far, of which a process was lost

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)
        for publisher in self._publishers.values():
            publisher.close()

    def __call__(self, work: Work[S], settings: S, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        """The result of work(settings, arrays, chunk) for each chunk. Chunks hold every spot once."""
        if len(spots) < 2:
            return serial(work, settings, arrays, spots)
        kind = f"{work.__module__}.{work.__qualname__}"
        costs = self._costs[kind]
        expected = costs.expected(spots)
        dealt = deal(expected, min(self.count * CHUNKS_A_WORKER, len(spots)))
        chunks = [spots.take(chunk) for chunk in dealt]
        done = self._over_pool(work, settings, kind, self._publishers[kind].publish(arrays), chunks)
        if all(done):
            costs.learn(expected, dealt, np.array([each[0] for each in done if each]))
        return [each[1] if each else work(settings, arrays, chunk) for each, chunk in zip(done, chunks, strict=True)]

    def _over_pool(
        self, work: Work[S], settings: S, kind: str, published: Published, chunks: list[Groups]
    ) -> list[tuple[float, tuple[Array, ...]] | None]:
        """Seconds and result of each chunk; None if its process was lost. Raises: the error of the work."""
        done: list[tuple[float, tuple[Array, ...]] | None] = []
        try:
            futures = [self._pool.submit(_carry_out, work, settings, kind, published, chunk) for chunk in chunks]
        except BrokenProcessPool:
            futures = []
        for future in futures:
            try:
                done.append(future.result())
            except BrokenProcessPool:
                done.append(None)
        if None in done or not futures:
            self.lost += 1
            self._pool.shutdown(cancel_futures=True)
            self._pool = new_pool(self.count)
        return done or [None] * len(chunks)


_readers: dict[str, Reader] = defaultdict(Reader)  # in a process of the pool: of each kind of work


def _carry_out(work: Work[S], settings: S, kind: str, published: Published, chunk: Groups) -> tuple[float, tuple[Array, ...]]:
    """Processor seconds and result of the work for a chunk."""
    begun = time.process_time()
    result = work(settings, _readers[kind].views(published), chunk)
    return time.process_time() - begun, result


def _start_worker() -> None:
    """Prepare a process. Ctrl-C and SIGHUP are for the parent, which ends its processes after a whole cycle."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    keep_freed_memory()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent was killed; else it would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
