"""Per-spot work in a pool of processes: arrays in shared memory, spots in chunks of equal cost."""

from __future__ import annotations

import signal
from collections.abc import Mapping, Sequence
from multiprocessing import get_context, resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from coastwatch.batches import Array
from coastwatch.stage import Groups, Shared, Work, in_turn

ALIGNMENT = 64
CHUNKS_A_WORKER = 4


class Processes:
    """A Spread over `count` processes that are started once and kept; use it in a `with` block.

    Arrays are laid in one block of shared memory, which grows when needed; a task names the block and lists spots, so that nothing
    large is pickled. Spots are dealt largest first to the chunk with the least work (their number of rows is the cost). Processes are
    forked from a clean server (forkserver): a fork after OpenMP has run in the parent is unsafe.
    """

    def __init__(self, count: int) -> None:
        if count < 2:
            raise ValueError(f"workers: got {count}, needed at least 2; `in_turn` is for one")
        self.count = count
        self._context = get_context("forkserver")
        self._context.set_forkserver_preload(["coastwatch.associations", "coastwatch.kernels.windows"])
        self._pool: Any = None
        self._block: SharedMemory | None = None

    def __enter__(self) -> Processes:
        resource_tracker.ensure_running()
        self._pool = self._context.Pool(self.count, initializer=_ignore_interrupt)
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.terminate()
        self._pool.join()
        self._release()

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        if len(spots) < 2:
            return in_turn(work, settings, arrays, spots)
        layout = self._publish(arrays)
        assert self._block is not None
        chunks = deal(np.diff(spots.start).tolist(), self.count * CHUNKS_A_WORKER)
        tasks = [(self._block.name, layout, work, settings, spots.take(chunk)) for chunk in chunks]
        found: list[tuple[Array, ...]] = self._pool.map(_run, tasks, chunksize=1)
        return found

    def _publish(self, arrays: Mapping[str, Array]) -> dict[str, tuple[str, tuple[int, ...], int]]:
        """Copies the arrays into the block. Returns: name to dtype, shape and offset."""
        layout, at = {}, 0
        for name, array in arrays.items():
            layout[name] = (array.dtype.str, array.shape, at)
            at += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
        if self._block is None or self._block.size < at:
            self._release()
            self._block = SharedMemory(create=True, size=max(2 * at, 1 << 20))
        for (dtype, shape, offset), array in zip(layout.values(), arrays.values(), strict=True):
            np.ndarray(shape, dtype, self._block.buf, offset)[...] = array
        return layout

    def _release(self) -> None:
        if self._block is not None:
            self._block.close()
            self._block.unlink()
            self._block = None


def deal(costs: Sequence[int], parts: int) -> list[list[int]]:
    """Indices dealt into at most `parts` lists, the costliest first, each to the list with the least so far."""
    parts = min(parts, len(costs))
    lists: list[list[int]] = [[] for _ in range(parts)]
    load = [0] * parts
    for k in sorted(range(len(costs)), key=lambda i: (-costs[i], i)):
        least = load.index(min(load))
        lists[least].append(k)
        load[least] += costs[k]
    return [part for part in lists if part]


def _ignore_interrupt() -> None:
    """Ctrl-C is for the parent, which ends the pool after a whole cycle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


_attached: dict[str, SharedMemory] = {}


def _attach(name: str) -> SharedMemory:
    """The block of this name; a block that has been replaced is let go."""
    if name not in _attached:
        for old in _attached.values():
            old.close()
        _attached.clear()
        _attached[name] = SharedMemory(name)
    return _attached[name]


def _run(task: tuple[str, dict[str, tuple[str, tuple[int, ...], int]], Work, Any, Groups]) -> tuple[Array, ...]:
    name, layout, work, settings, spots = task
    block = _attach(name)
    arrays = {}
    for key, (dtype, shape, offset) in layout.items():
        view: Array = np.ndarray(shape, dtype, block.buf, offset)
        view.flags.writeable = False
        arrays[key] = view
    return work(settings, arrays, spots)
