"""Arrays by name, and plain data with its arrays, from one process of this machine to others, in shared memory."""

from __future__ import annotations

import os
import shutil
from functools import cache
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from coastwatch import batches
from coastwatch.batches import Array
from coastwatch.batches.plain_data import Classes, classes_in, from_tree, to_tree
from coastwatch.stage import Arrays

MARGIN = 1.25  # size of a new block over the needed size, for tracks to come
ALIGNMENT = 64


@cache
def sent_classes() -> Classes:
    """The classes that are sent. A process that has spots alone is sent none, and does not load what regions are made of."""
    from coastwatch.regional import RegionCycle, RegionReports

    return classes_in(*(kind for kind in vars(batches).values() if isinstance(kind, type)), RegionReports, RegionCycle)


class Location(NamedTuple):
    """Where an array lies in a block."""

    offset: int
    dtype: Any
    shape: tuple[int, ...]

    def view(self, block: SharedMemory) -> Array:
        """The array, in the block's memory."""
        array: Array = np.ndarray(self.shape, self.dtype, block.buf, self.offset)
        return array


class Published(NamedTuple):
    """Arrays in a block."""

    block: str  # name of the shared memory
    locations: dict[str, Location | tuple[Location, ...]]  # of an array, or of each of a tuple of arrays


class Publisher:
    """A block of shared memory. Each call overwrites the arrays of the last, and enlarges the block if needed."""

    def __init__(self) -> None:
        self._block: SharedMemory | None = None

    def publish(self, arrays: Arrays) -> Published:
        """Copy arrays, and tuples of arrays, to shared memory. Raises: OSError: the system has not enough of it."""
        locations: dict[str, Location | tuple[Location, ...]] = {}
        to_copy: list[tuple[Location, Array]] = []
        size = 0
        for name, value in arrays.items():
            placed = []
            for array in value if isinstance(value, tuple) else (value,):
                placed.append(Location(size, array.dtype, array.shape))
                to_copy.append((placed[-1], array))
                size += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
            locations[name] = tuple(placed) if isinstance(value, tuple) else placed[0]
        block = self._block_of(size)
        for location, array in to_copy:
            in_bytes = np.ascontiguousarray(array).reshape(-1).view(np.uint8)  # records would be copied a field at a time
            Location(location.offset, np.uint8, in_bytes.shape).view(block)[...] = in_bytes
        return Published(block.name, locations)

    def close(self) -> None:
        """Release the shared memory."""
        if self._block is not None:
            self._block.close()
            self._block.unlink()
            self._block = None

    def _block_of(self, size: int) -> SharedMemory:
        if self._block is None or self._block.size < size:
            self.close()
            wanted = int(MARGIN * size) + ALIGNMENT
            free = shutil.disk_usage("/dev/shm").free if os.path.isdir("/dev/shm") else wanted
            if free < wanted:
                raise OSError(
                    f"shared memory: got {free} bytes in /dev/shm, needed {wanted}; or choose workers.method = threads"
                )
            self._block = SharedMemory(create=True, size=wanted)
        return self._block


class Reader:
    """Reads the arrays of one publisher, in another process."""

    def __init__(self) -> None:
        self._block: SharedMemory | None = None

    def views(self, published: Published) -> dict[str, Array | tuple[Array, ...]]:
        """The arrays by name, read-only. They hold until the publisher is called again."""
        block = self._block
        if block is None or block.name != published.block:
            if block is not None:
                block.close()
            block = self._block = SharedMemory(published.block)
        arrays: dict[str, Array | tuple[Array, ...]] = {}
        for name, location in published.locations.items():
            several = (location,) if isinstance(location, Location) else location
            views = tuple(each.view(block) for each in several)
            for view in views:
                view.flags.writeable = False
            arrays[name] = views[0] if isinstance(location, Location) else views
        return arrays

    def release(self) -> None:
        """Release the shared memory for all, when the publisher's process has ended."""
        if self._block is not None:
            self._block.close()
            self._block.unlink()
            self._block = None


T = TypeVar("T")


class Sent(NamedTuple, Generic[T]):
    """Plain data in shared memory: its tree, see `coastwatch.batches.plain_data`, and its arrays."""

    tree: object
    arrays: Published


def send(value: T, publisher: Publisher) -> Sent[T]:
    """Copy plain data of batches to shared memory. Raises: TypeError: other data; OSError: the system has not enough of it."""
    tree, arrays = to_tree(value, sent_classes())
    return Sent(tree, publisher.publish({"arrays": tuple(arrays)}))


def receive(sent: Sent[T], reader: Reader) -> T:
    """The value that was sent, with arrays of its own. Args: reader: of the publisher."""
    value: T = from_tree(sent.tree, [view.copy() for view in reader.views(sent.arrays)["arrays"]], sent_classes())
    return value
