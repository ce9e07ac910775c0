"""Per-spot work in a pool of processes: arrays in shared memory, spots in chunks of equal cost."""

from __future__ import annotations

import pickle
from collections import defaultdict
from dataclasses import dataclass
from multiprocessing import connection, get_context, resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from coastwatch.batches import Array
from coastwatch.stage import Groups, Shared, Work, in_turn
from coastwatch.workers.blocks import Blocks, give_back, new_block, taken
from coastwatch.workers.costs import Costs, chunks
from coastwatch.workers.serving import ROW, START, Done, Task, serve

CHUNKS_A_WORKER = 4
PRELOADED = ["coastwatch.associations", "coastwatch.kernels.windows"]


@dataclass
class _Hand:
    """One process of the pool."""

    process: Any
    pipe: connection.Connection
    room: SharedMemory  # for its results
    chunk: int = -1  # in hand

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()
        give_back(self.room)


class Processes:
    """A Spread over processes that are started once and kept; use it in a `with` block.

    What the work reads lies in shared memory, where an array that is the object of the last cycle is left; a task names the blocks and
    the numbers of its spots, and results come back through shared memory. Spots are dealt by what they cost in earlier cycles, costliest
    first, and a process that is through with its chunk takes the next. One that is lost costs the time of its chunk and is replaced.
    """

    def __init__(self, count: int) -> None:
        if count < 2:
            raise ValueError(f"workers: got {count}, needed at least 2; `in_turn` is for one")
        self.count = count
        self._context = get_context("forkserver")  # a clean one: a fork after OpenMP has run here is unsafe
        self._context.set_forkserver_preload(PRELOADED)
        self._hands: list[_Hand] = []
        self._blocks: dict[str, Blocks] = defaultdict(Blocks)
        self._costs: dict[str, Costs] = defaultdict(Costs)

    def __enter__(self) -> Processes:
        resource_tracker.ensure_running()
        self._hands = [self._started() for _ in range(self.count)]
        return self

    def __exit__(self, *_: object) -> None:
        for hand in self._hands:
            hand.close()
        for blocks in self._blocks.values():
            blocks.close()

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        if len(spots) < 2:
            return in_turn(work, settings, arrays, spots)
        kind = f"{work.__module__}.{work.__qualname__}"
        places = self._blocks[kind].publish({**arrays, ROW: spots.row, START: spots.start})
        expected = self._costs[kind].expected(spots)
        part, chunk = chunks(expected, self.count * CHUNKS_A_WORKER)
        what = pickle.dumps((work, settings))
        done = self._over_hands([Task(what, kind, places, groups, "") for groups in chunk])
        found = [d.found if d else work(settings, arrays, spots.take(c)) for d, c in zip(done, chunk, strict=True)]
        for result in found:
            if isinstance(result, BaseException):
                raise result
        if all(done):
            self._costs[kind].learn(expected, part, np.array([d.seconds for d in done if d]))
        return found  # type: ignore[return-value]

    def _over_hands(self, tasks: list[Task]) -> list[Done | None]:
        """What came of each task; none of one whose process was lost."""
        done: list[Done | None] = [None] * len(tasks)
        waiting = iter(range(len(tasks)))
        for hand in self._hands:
            _give(hand, tasks, next(waiting, -1))
        while busy := {hand.pipe: hand for hand in self._hands if hand.chunk >= 0}:
            for pipe in connection.wait(list(busy)):
                hand = busy[pipe]  # type: ignore[index]
                try:
                    done[hand.chunk] = _taken(hand)
                except (EOFError, OSError):
                    hand.close()
                    new = self._started()
                    self._hands[self._hands.index(hand)] = hand = new
                _give(hand, tasks, next(waiting, -1))
        return done

    def _started(self) -> _Hand:
        here, there = self._context.Pipe()
        process = self._context.Process(target=serve, args=(there,), daemon=True)
        process.start()
        there.close()
        return _Hand(process, here, new_block(0))


def _give(hand: _Hand, tasks: list[Task], chunk: int) -> None:
    hand.chunk = chunk
    if chunk >= 0:
        try:
            hand.pipe.send(tasks[chunk]._replace(room=hand.room.name))
        except BrokenPipeError:
            return  # as is seen when its answer is read


def _taken(hand: _Hand) -> Done:
    """The answer of a process; where its room was too small for it, a larger one is made."""
    done: Done = hand.pipe.recv()
    if isinstance(done.found, list):
        return done._replace(found=taken(done.found, hand.room))
    if isinstance(done.found, tuple):
        give_back(hand.room)
        hand.room = new_block(sum(array.nbytes + 64 for array in done.found))
    return done
