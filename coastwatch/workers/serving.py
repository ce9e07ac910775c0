"""What a process of the pool does: chunk after chunk, with the arrays in shared memory."""

from __future__ import annotations

import pickle
import signal
import time
from collections import defaultdict
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from coastwatch.batches import Array, Ints
from coastwatch.stage import Groups
from coastwatch.workers.blocks import Attached, Place, Places, lay
from coastwatch.workers.freed import keep_freed_memory

ROW, START = "groups row", "groups start"  # beside the names of arrays


class Task(NamedTuple):
    """A chunk of groups: little to send, whatever the size of the cycle."""

    what: bytes  # pickled work and settings
    kind: str  # of the work
    places: Places
    chunk: Ints  # numbers of groups
    room: str  # the block for the results


class Done(NamedTuple):
    """What came of a task: places in the room where the results fit in, else themselves; or what the work raised."""

    seconds: float  # of a processor
    found: list[Place] | tuple[Array, ...] | BaseException


def serve(pipe: Connection) -> None:
    """Answers tasks until the pipe is closed. Ctrl-C is for the parent, which ends its processes after a whole cycle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    attached: dict[str, Attached] = defaultdict(lambda: Attached(related=True))
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        attached[""].keep([task.room])
        try:
            done = _done(task, attached[task.kind], attached[""])
        except BaseException as error:
            done = Done(0.0, error.with_traceback(None))
        pipe.send(done)


def _done(task: Task, attached: Attached, rooms: Attached) -> Done:
    seconds, found = carried_out(task, attached)
    return Done(seconds, lay(found, rooms.block(task.room)) or found)


def carried_out(task: Task, attached: Attached) -> tuple[float, tuple[Array, ...]]:
    """Processor seconds, and what the work gives for the chunk."""
    arrays: dict[str, Any] = attached.arrays(task.places)
    spots = Groups(arrays.pop(ROW), arrays.pop(START))
    work, settings = pickle.loads(task.what)
    begun = time.process_time()
    found = work(settings, arrays, spots.take(task.chunk))
    return time.process_time() - begun, found
