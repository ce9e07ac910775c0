"""Per-spot work in a pool of processes: arrays in shared memory, spots in chunks of equal cost."""

from __future__ import annotations

import pickle
from collections import defaultdict
from dataclasses import dataclass
from multiprocessing import connection, get_context, resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.stage import Groups, Shared, Work, in_turn
from coastwatch.workers.blocks import ALIGNMENT, Blocks, Ground, give_back, new_block, taken
from coastwatch.workers.costs import Costs, along, chunks
from coastwatch.workers.serving import ROW, START, Call, Chunk, Done, serve

CHUNKS_A_WORKER = 2
PRELOADED = ["coastwatch.associations", "coastwatch.kernels.association.pair_score"]


@dataclass
class _Hand:
    """One process of the pool."""

    process: Any
    pipe: connection.Connection
    rooms: list[SharedMemory]  # for its results, one after the other: that of a chunk is read while it is at the next
    chunk: int = -1  # in hand
    called: bool = False  # has what the chunks of this call have in common
    answered: bool = False

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()
        for room in self.rooms:
            give_back(room)


class Processes:
    """A Spread over processes that are started once and kept; use it in a `with` block.

    What the work reads lies in shared memory, where an array that is the object of the last cycle is left; a task names the blocks and
    the numbers of its spots, and results come back through shared memory. Spots are dealt by what they cost in earlier cycles, costliest
    first, and a process that is through with its chunk takes the next. One that is lost costs the time of its chunk and is replaced;
    where none is left the work is done here.
    """

    def __init__(self, count: int) -> None:
        if count < 2:
            raise ValueError(f"workers: got {count}, needed at least 2; `in_turn` is for one")
        self.count = count
        self._context = get_context("forkserver")  # a clean one: a fork after OpenMP has run here is unsafe
        self._context.set_forkserver_preload(PRELOADED)
        self._hands: list[_Hand] = []
        self._ground = Ground()
        self._blocks: dict[str, Blocks] = defaultdict(lambda: Blocks(self._ground))
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
        self._ground.close()

    def room(self, shape: int | tuple[int, ...], dtype: Any = np.float64) -> Array:
        """An array, as of np.empty, that processes can read where it lies."""
        return self._ground.room(shape, dtype)

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        if len(spots) < 2:
            return in_turn(work, settings, arrays, spots)
        kind = f"{work.__module__}.{work.__qualname__}"
        places = self._blocks[kind].publish({**arrays, ROW: spots.row, START: spots.start})
        expected = self._costs[kind].expected(spots)
        part, chunk = chunks(expected, self.count * CHUNKS_A_WORKER, along(arrays, spots))
        done = self._over_hands(Call(pickle.dumps((work, settings)), places, self._names()), chunk)
        found = [d.found if d else work(settings, arrays, spots.take(c)) for d, c in zip(done, chunk, strict=True)]
        for result in found:
            if isinstance(result, BaseException):
                raise result
        if all(done):
            self._costs[kind].learn(expected, part, np.array([d.seconds for d in done if d]))
        return found  # type: ignore[return-value]

    def _names(self) -> tuple[str, ...]:
        return self._ground.names + tuple(room.name for hand in self._hands for room in hand.rooms)

    def _over_hands(self, call: Call, chunks: list[Ints]) -> list[Done | None]:
        """What came of each chunk; none of one whose process was lost."""
        done: list[Done | None] = [None] * len(chunks)
        told, waiting = pickle.dumps(call), iter(range(len(chunks)))
        for hand in self._hands:
            hand.called = False
            _give(hand, told, chunks, next(waiting, -1))
        while busy := {hand.pipe: hand for hand in self._hands if hand.chunk >= 0}:
            for pipe in connection.wait(list(busy)):
                hand = busy[pipe]  # type: ignore[index]
                chunk, answer = hand.chunk, _answer(hand)
                free = hand if answer else self._replaced(hand)
                if free:
                    _give(free, told, chunks, next(waiting, -1))
                done[chunk] = answer and _taken(answer, hand)
        return done

    def _replaced(self, lost: _Hand) -> _Hand | None:
        """Another process for one that was lost; none for one that never answered, as the next would not either."""
        lost.close()
        self._hands.remove(lost)
        if not lost.answered:
            return None
        self._hands.append(self._started())
        return self._hands[-1]

    def _started(self) -> _Hand:
        here, there = self._context.Pipe()
        process = self._context.Process(target=serve, args=(there,), daemon=True)
        process.start()
        there.close()
        return _Hand(process, here, [new_block(0), new_block(0)])


def _give(hand: _Hand, told: bytes, chunks: list[Ints], chunk: int) -> None:
    """Lets a process do a chunk, -1: none, with its results in its first room. Args: told: the call, pickled."""
    hand.chunk = chunk
    if chunk >= 0:
        try:
            if not hand.called:
                hand.pipe.send_bytes(told)
            hand.called = True
            hand.pipe.send(Chunk(chunks[chunk], hand.rooms[0].name))
        except BrokenPipeError:
            return  # as is seen when its answer is read


def _answer(hand: _Hand) -> Done | None:
    """The answer of a process, none where it is lost. Its results stay where they are, in what is then its last room."""
    try:
        done: Done = hand.pipe.recv()
    except (EOFError, OSError):
        return None
    hand.answered = True
    hand.rooms.reverse()
    return done


def _taken(done: Done, hand: _Hand) -> Done:
    """An answer with what it found; where the room was too small for that, a larger one is made."""
    if isinstance(done.found, list):
        return done._replace(found=taken(done.found, hand.rooms[-1]))
    if isinstance(done.found, tuple):
        give_back(hand.rooms[-1])
        hand.rooms[-1] = new_block(sum(array.nbytes + ALIGNMENT for array in done.found))
    return done
