"""What a process of the pool does: chunk after chunk, with the arrays in shared memory."""

from __future__ import annotations

import pickle
import signal
import time
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from coastwatch.batches import Array, Ints
from coastwatch.stage import Groups, Work
from coastwatch.workers.blocks import Attached, Place, Places, lay
from coastwatch.workers.freed import keep_freed_memory

ROW, START = "groups row", "groups start"  # beside the names of arrays


class Call(NamedTuple):
    """What all chunks of a call have in common: little to send, whatever the size of the cycle."""

    what: bytes  # pickled work and settings
    places: Places
    blocks: tuple[str, ...]  # all that there are; others are let go


class Chunk(NamedTuple):
    """A chunk of groups of the last call."""

    groups: Ints  # their numbers
    room: str  # the block for the results


class Done(NamedTuple):
    """What came of a chunk: places in the room where the results fit in, else themselves; or what the work raised."""

    seconds: float  # of a processor
    found: list[Place] | tuple[Array, ...] | BaseException


class Opened(NamedTuple):
    """A call as it is carried out."""

    work: Work
    settings: Any
    arrays: dict[str, Any]
    groups: Groups


def serve(pipe: Connection) -> None:
    """Answers chunks until the pipe is closed. Ctrl-C is for the parent, which ends its processes after a whole cycle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    attached = Attached(related=True)
    call, opened = Call(b"", {}, ()), None
    while True:
        try:
            asked = pipe.recv()
        except EOFError:
            return
        if isinstance(asked, Call):
            call, opened = asked, None
            continue
        try:
            opened = opened or open_call(call, attached)
            done = _done(opened, asked, attached)
        except BaseException as error:
            done = Done(0.0, error.with_traceback(None))
        pipe.send(done)
        del done  # it may show arrays of a block that the next call lets go


def _done(opened: Opened, chunk: Chunk, attached: Attached) -> Done:
    seconds, found = carried_out(opened, chunk.groups)
    return Done(seconds, lay(found, attached.block(chunk.room)) or found)


def open_call(call: Call, attached: Attached) -> Opened:
    """A call with its arrays where they lie. What was opened before must be gone."""
    attached.keep(call.blocks)
    arrays: dict[str, Any] = attached.arrays(call.places)
    groups = Groups(arrays.pop(ROW), arrays.pop(START))
    work, settings = pickle.loads(call.what)
    return Opened(work, settings, arrays, groups)


def carried_out(opened: Opened, groups: Ints) -> tuple[float, tuple[Array, ...]]:
    """Processor seconds, and what the work gives for these groups."""
    begun = time.process_time()
    found = opened.work(opened.settings, opened.arrays, opened.groups.take(groups))
    return time.process_time() - begun, found
