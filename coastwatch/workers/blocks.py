"""Arrays in shared memory: laid there once, found there by other processes."""

from __future__ import annotations

import os
import shutil
import weakref
from collections.abc import Iterable, Mapping
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Array
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Shared

ROOM = 1.25  # of a new block, so that it also holds what comes when there are a few tracks more
LEAST_BYTES = 4096
ALIGNMENT = 64


class Place(NamedTuple):
    """Where an array lies."""

    block: str
    offset: int
    dtype: str
    shape: tuple[int, ...]


Places = Mapping[str, Any]
"""The places of arrays by name; of a tuple of arrays a tuple of places."""


class Ground:
    """Blocks to lay arrays in; those that fall free are used again."""

    def __init__(self) -> None:
        self._names: set[str] = set()
        self._free: list[SharedMemory] = []
        self._made: dict[int, SharedMemory] = {}  # by the address where their memory begins
        self._closed = False

    def room(self, shape: int | tuple[int, ...], dtype: Any = np.float64) -> Array:
        """An array to be filled by who asks for it, as of np.empty, that need not be copied to be published.

        Its block falls free with the last array that shows it, whoever has it.
        """
        block = self.block(int(np.prod(shape)) * np.dtype(dtype).itemsize)
        made: Array = np.ndarray(shape, dtype, block.buf)
        self._made[made.ctypes.data] = block
        weakref.finalize(made, self._left, made.ctypes.data)
        return made

    def place(self, array: Array) -> Place | None:
        """Where an array lies that shows a room, whole or in part; none where it does not."""
        at = array.ctypes.data
        for address, block in self._made.items():
            if address <= at < address + block.size and array.flags.c_contiguous:
                return Place(block.name, at - address, array.dtype.str, array.shape)
        return None

    def block(self, size: int) -> SharedMemory:
        """The smallest free block that is large enough, else a new one instead of the smallest."""
        self._free.sort(key=lambda block: block.size)
        for at, block in enumerate(self._free):
            if block.size >= size:
                return self._free.pop(at)
        if self._free:
            self._names.discard(self._free[0].name)
            give_back(self._free.pop(0))
        made = new_block(size)
        self._names.add(made.name)
        return made

    @property
    def names(self) -> tuple[str, ...]:
        """Of all blocks that there are, whether anything lies in them now or not."""
        return tuple(self._names)

    def free(self, blocks: Iterable[SharedMemory]) -> None:
        """Nobody looks at these blocks any more."""
        self._free.extend(blocks)

    def close(self) -> None:
        """Gives all blocks back; those that arrays still show when the last of these is gone."""
        self._closed = True
        for block in self._free:
            give_back(block)
        for block in self._made.values():
            block.unlink()

    def _left(self, address: int) -> None:
        block = self._made.pop(address)
        if self._closed:
            block.close()
        else:
            self._free.append(block)


class Blocks:
    """The arrays of one kind of work. What is the very object of the last time stays where it is."""

    def __init__(self, ground: Ground) -> None:
        self._ground = ground
        self._held: dict[int, tuple[Array, SharedMemory]] = {}

    def publish(self, arrays: Shared) -> dict[str, Any]:
        """Lays the arrays into blocks, where they do not lie in one, and says where. They must not be written to any more."""
        each = [array for value in arrays.values() for array in (value if isinstance(value, tuple) else (value,))]
        before, self._held = self._held, {}
        self._held = {id(array): before.pop(id(array)) for array in each if id(array) in before}
        self._ground.free(block for _, block in before.values())
        return {
            name: tuple(map(self._place, value)) if isinstance(value, tuple) else self._place(value)
            for name, value in arrays.items()
        }

    def close(self) -> None:
        """Lets go of what is published."""
        self._ground.free(block for _, block in self._held.values())
        self._held = {}

    def _place(self, array: Array) -> Place:
        placed = self._ground.place(array)
        if placed is not None:
            return placed
        if id(array) not in self._held:
            block = self._ground.block(array.nbytes)
            _copy(array, np.ndarray(array.shape, array.dtype, block.buf))
            self._held[id(array)] = array, block
        return Place(self._held[id(array)][1].name, 0, array.dtype.str, array.shape)


def _copy(array: Array, out: Array) -> None:
    def rows(low: int, high: int) -> None:
        out[low:high] = array[low:high]

    if array.ndim:
        in_blocks(rows, len(array), least=1 << 16)
    else:
        out[...] = array


def new_block(size: int) -> SharedMemory:
    """A block with room for so many bytes and some more.

    Raises: OSError where the machine has not so much: without asking for it now, whoever writes there later would be killed.
    """
    room = max(int(ROOM * size), LEAST_BYTES)
    block = SharedMemory(create=True, size=room)
    file = Path("/dev/shm", block.name)
    try:
        if file.exists():
            with file.open("r+b") as opened:
                os.posix_fallocate(opened.fileno(), 0, room)
    except OSError as error:
        give_back(block)
        free = shutil.disk_usage(file.parent).free
        told = f"shared memory: got {free} bytes in {file.parent}, needed {room}; a larger one, or workers.method = threads"
        raise OSError(error.errno, told) from error
    return block


def give_back(block: SharedMemory) -> None:
    """Lets go of a block and of its memory."""
    block.close()
    block.unlink()


class Attached:
    """Blocks of another process that are open here."""

    def __init__(self, related: bool) -> None:
        """Args: related: that process started this one, and both have one tracker of resources; else this one's must not see the
        blocks, or it would take them away when this process ends."""
        self._related = related
        self._open: dict[str, SharedMemory] = {}

    def keep(self, names: Iterable[str]) -> None:
        """Lets go of all other blocks; nobody may look at them any more."""
        for name in self._open.keys() - set(names):
            self._open.pop(name).close()

    def arrays(self, places: Places) -> dict[str, Any]:
        """The arrays at these places, read-only."""
        return {
            name: self._seen(value) if isinstance(value, Place) else tuple(map(self._seen, value))
            for name, value in places.items()
        }

    def _seen(self, place: Place) -> Array:
        out: Array = np.ndarray(place.shape, place.dtype, self.block(place.block).buf, place.offset)
        out.flags.writeable = False
        return out

    def block(self, name: str) -> SharedMemory:
        """The block of this name."""
        if name not in self._open:
            self._open[name] = SharedMemory(name)
            if not self._related:
                resource_tracker.unregister(f"/{name}", "shared_memory")
        return self._open[name]


def lay(arrays: tuple[Array, ...], block: SharedMemory) -> list[Place] | None:
    """Copies the arrays into a block, one after the other, and says where; none where it is too small."""
    places, at = [], 0
    for array in arrays:
        places.append(Place(block.name, at, array.dtype.str, array.shape))
        at += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
    if at > block.size:
        return None
    for place, array in zip(places, arrays, strict=True):
        np.ndarray(place.shape, place.dtype, block.buf, place.offset)[...] = array
    return places


def taken(places: list[Place], block: SharedMemory) -> tuple[Array, ...]:
    """Copies of the arrays in a block."""
    return tuple(np.ndarray(p.shape, p.dtype, block.buf, p.offset).copy() for p in places)
