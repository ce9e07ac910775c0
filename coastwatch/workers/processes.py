"""Per-spot work in a pool of processes: arrays in shared memory, spots in chunks of about equal cost."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections import defaultdict
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.shared_memory import SharedMemory
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Array
from coastwatch.stage import Arrays, Groups, Work, serial
from coastwatch.workers.costs import Costs, deal
from coastwatch.workers.malloc import keep_freed_memory

CHUNKS_A_WORKER = 2
MARGIN = 1.25  # size of a new block over the needed size, for tracks to come
ALIGNMENT = 64


class Location(NamedTuple):
    """Where an array lies in a block."""

    offset: int
    dtype: Any
    shape: tuple[int, ...]

    def view(self, block: SharedMemory) -> Array:
        made: Array = np.ndarray(self.shape, self.dtype, block.buf, self.offset)
        return made


class Published(NamedTuple):
    """Arrays of one call of the work of one kind."""

    kind: str
    block: str  # name of the shared memory
    locations: dict[str, Any]  # of an array, or of each of a tuple of arrays


class SharedMemoryPool:
    """One block of shared memory for each kind of work. Every call overwrites it, and enlarges it if needed."""

    def __init__(self) -> None:
        self._blocks: dict[str, SharedMemory] = {}

    def publish(self, kind: str, arrays: Arrays) -> Published:
        """Copy arrays, and tuples of arrays, to shared memory. They replace the arrays of the last call of this kind.

        Raises: OSError: the system has not enough shared memory.
        """
        locations: dict[str, Any] = {}
        to_copy: list[tuple[Location, Array]] = []
        size = 0
        for name, given in arrays.items():
            placed = []
            for array in given if isinstance(given, tuple) else (given,):
                placed.append(Location(size, array.dtype, array.shape))
                to_copy.append((placed[-1], array))
                size += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
            locations[name] = tuple(placed) if isinstance(given, tuple) else placed[0]
        block = self._block(kind, size)
        for location, array in to_copy:
            in_bytes = np.ascontiguousarray(array).reshape(-1).view(np.uint8)  # records would be copied a field at a time
            Location(location.offset, np.uint8, in_bytes.shape).view(block)[...] = in_bytes
        return Published(kind, block.name, locations)

    def close(self) -> None:
        """Release all shared memory."""
        for block in self._blocks.values():
            block.close()
            block.unlink()
        self._blocks.clear()

    def _block(self, kind: str, size: int) -> SharedMemory:
        old = self._blocks.get(kind)
        if old and old.size >= size:
            return old
        if old:
            old.close()
            old.unlink()
        wanted = int(MARGIN * size) + ALIGNMENT
        free = shutil.disk_usage("/dev/shm").free if os.path.isdir("/dev/shm") else wanted
        if free < wanted:
            raise OSError(f"shared memory: got {free} bytes in /dev/shm, needed {wanted}; or choose workers.method = threads")
        self._blocks[kind] = SharedMemory(create=True, size=wanted)
        return self._blocks[kind]


class Processes:
    """A Map over a pool of processes; use it in a `with` block.

    Each call copies its arrays to shared memory once; the executor returns the results. Spots are distributed by their cost in earlier
    cycles. If a process is lost, chunks without a result are computed in this process, and the next call begins with a new pool.
    """

    def __init__(self, count: int) -> None:
        if count < 2:
            raise ValueError(f"workers.count: got {count}, needed at least 2 processes")
        self.count = count
        self._memory = SharedMemoryPool()
        self._costs: dict[str, Costs] = defaultdict(Costs)
        self._pool = self._new_pool()

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)
        self._memory.close()

    def __call__(self, work: Work, settings: Any, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        """The result of work(settings, arrays, chunk) for each chunk. Chunks hold every spot once."""
        if len(spots) < 2:
            return serial(work, settings, arrays, spots)
        kind = f"{work.__module__}.{work.__qualname__}"
        costs = self._costs[kind]
        expected = costs.expected(spots)
        dealt = deal(expected, min(self.count * CHUNKS_A_WORKER, len(spots)))
        chunks = [spots.take(chunk) for chunk in dealt]
        published = self._memory.publish(kind, arrays)
        done = self._over_pool(work, settings, published, chunks)
        if all(done):
            costs.learn(expected, dealt, np.array([each[0] for each in done if each]))
        return [each[1] if each else work(settings, arrays, chunk) for each, chunk in zip(done, chunks, strict=True)]

    def _over_pool(
        self, work: Work, settings: Any, published: Published, chunks: list[Groups]
    ) -> list[tuple[float, tuple[Array, ...]] | None]:
        """Seconds and result of each chunk; None if its process was lost. Raises: the error of the work."""
        done: list[tuple[float, tuple[Array, ...]] | None] = []
        try:
            futures: list[Future[Any]] = [self._pool.submit(_carry_out, work, settings, published, chunk) for chunk in chunks]
        except BrokenProcessPool:
            futures = []
        for future in futures:
            try:
                done.append(future.result())
            except BrokenProcessPool:
                done.append(None)
        if None in done or not futures:
            self._pool.shutdown(cancel_futures=True)
            self._pool = self._new_pool()
        return done or [None] * len(chunks)

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.count, get_context("spawn"), _start_worker)


_attached: dict[str, SharedMemory] = {}  # in a process of the pool: the block of each kind of work


def _start_worker() -> None:
    """Ctrl-C is for the parent, which ends its processes after a whole cycle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()


def _carry_out(work: Work, settings: Any, published: Published, chunk: Groups) -> tuple[float, tuple[Array, ...]]:
    """Processor seconds and result of the work for a chunk."""
    begun = time.process_time()
    block = _attached.get(published.kind)
    if block is None or block.name != published.block:
        if block:
            block.close()
        block = _attached[published.kind] = SharedMemory(published.block)
    arrays: dict[str, Any] = {}
    for name, location in published.locations.items():
        several = location if not isinstance(location, Location) else (location,)
        views = tuple(_read_only(each.view(block)) for each in several)
        arrays[name] = views[0] if isinstance(location, Location) else views
    found = work(settings, arrays, chunk)
    return time.process_time() - begun, found


def _read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array
