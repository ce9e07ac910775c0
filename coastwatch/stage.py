"""The interface of a method (`Method`, `Stage`), and of the maps that spread its work over processors (`Map`, `RegionMap`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Generic, Never, Protocol, TypeVar, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from coastwatch import kernels
from coastwatch.batches import Array, Floats, Ints, Struct
from coastwatch.batches.struct import column

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
PositiveShare = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]
CountOrZero = Annotated[int, Field(ge=0)]
Latitude = Annotated[float, Field(gt=-85.0, lt=85.0)]  # degrees
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]  # degrees


class Settings(BaseModel):
    """A frozen struct of settings. A wrong key, type or range is refused with its path when it is read."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Method(Settings):
    """A method is its settings: a frozen struct with `init()` and a pure `step(memory, given)`.

    `init()` returns the memory before the first cycle. `step` returns the memory after this cycle and what the stage yields. It
    consumes the memory it is given: it may write into it, so use only what it returns. All methods of a stage take one input
    struct, and each uses of it what it needs. Memory is plain data (dataclasses, tuples, dicts, arrays, numbers, texts), of the
    type that `init` declares. Saved as arrays with a schema (`coastwatch.server.checkpoint`) and read back, it resumes bit for bit.
    """


MemoryT = TypeVar("MemoryT", covariant=True)
InputT = TypeVar("InputT", contravariant=True)
OutputT = TypeVar("OutputT", covariant=True)


class Stage(Protocol[MemoryT, InputT, OutputT]):
    """Any method of a stage. Its memory is one of the types in MemoryT."""

    def init(self) -> MemoryT:
        """The memory before the first cycle."""
        ...

    def step(self, memory: Never, given: InputT, /) -> tuple[MemoryT, OutputT]:
        """The memory after a cycle, and what the stage yields.

        Args: memory: of this very method. No memory suits every method of a stage, so its type is Never: `Running` has the right one.
        """
        ...


@dataclass(frozen=True)
class Running(Generic[MemoryT, InputT, OutputT]):
    """A method with its memory."""

    method: Stage[MemoryT, InputT, OutputT]
    memory: MemoryT  # that the method made

    def next(self, given: InputT) -> tuple[MemoryT, OutputT]:
        """The memory after a cycle, and what the stage yields. It consumes the memory."""
        step = cast("Callable[[MemoryT, InputT], tuple[MemoryT, OutputT]]", self.method.step)
        return step(self.memory, given)


@dataclass(frozen=True)
class NoMemory:
    """The memory of a method that keeps nothing between cycles."""


@dataclass(frozen=True, eq=False)
class Groups(Struct):
    """Rows in groups. The rows of group k are row[start[k]:start[k + 1]]."""

    row: Ints = column(np.int64, "L")
    start: Ints = column(np.int64, "K1")  # K + 1, from 0 to L

    def __len__(self) -> int:
        return len(self.start) - 1

    def of(self, group: int) -> Ints:
        """The rows of one group."""
        return self.row[self.start[group] : self.start[group + 1]]

    def take(self, groups: Sequence[int] | Ints) -> Groups:
        """These groups, in this order."""
        rows = [self.of(k) for k in groups]
        start = np.cumsum([0, *(len(r) for r in rows)])
        return Groups(np.concatenate([np.zeros(0, np.int64), *rows]), start)

    @staticmethod
    def by_key(key: Ints, count: int) -> Groups:
        """The rows of each key, in order. Args: key: (L,) from 0 to count - 1."""
        start, row = kernels.tables.counting_sort.counting_sort(key, count)
        return Groups(row.astype(np.int64), start.astype(np.int64))


Arrays = Mapping[str, Any]
"""Arrays by name. A value may also be a tuple of arrays."""

S = TypeVar("S")  # settings of work

Work = Callable[[S, Arrays, Groups], tuple[Array, ...]]
"""A module-level pure function (settings, arrays, groups) -> arrays: what is done for a chunk of spots at once.

The result for a spot does not depend on the other spots of its chunk. The caller sorts the results of all chunks.
"""


def by_group(
    of_one: Callable[[S, Arrays, Ints], tuple[Array, ...]], settings: S, arrays: Arrays, groups: Groups
) -> tuple[Array, ...]:
    """The results of of_one(settings, arrays, rows) for the rows of each group, concatenated."""
    parts = [of_one(settings, arrays, groups.of(k)) for k in range(len(groups))]
    if not parts:
        parts = [of_one(settings, arrays, np.zeros(0, np.int64))]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


class Map(Protocol):
    """How per-spot work is mapped over processors: `coastwatch.workers` has the kinds. Pairs, ids and flags are the same for all."""

    def __call__(self, work: Work[S], settings: S, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        """The result of work(settings, arrays, chunk) for each chunk. Chunks hold every spot once; there is at least one."""
        ...


def serial(work: Work[S], settings: S, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
    """The Map without workers: all spots as one chunk, in this process."""
    return [work(settings, arrays, spots)]


Mem = TypeVar("Mem")  # memory of a regional centre
In = TypeVar("In")  # its input
Out = TypeVar("Out")  # its output

RegionStep = Callable[[Mem, In], tuple[Mem, Out]]
"""step(memory, given) -> (memory, output): a cycle of one regional centre. It consumes the memory."""


class RegionMap(Protocol):
    """How regional centres are mapped over processors and machines: `coastwatch.workers` has the kinds.

    The memory of a region may stay where the region is computed. Then what is returned in its place stands for it until the next
    call. Pairs, ids and flags are the same for all kinds.
    """

    def __call__(self, step: RegionStep[Mem, In, Out], memories: Sequence[Mem], given: Sequence[In]) -> list[tuple[Mem, Out]]:
        """What step(memory, given) returns for each region."""
        ...

    def gather(self, memories: Sequence[Mem]) -> list[Mem]:
        """The memory of each region after the last call, as plain data to be saved."""
        ...


class SerialRegions:
    """The RegionMap without workers: one region after the other, in this process."""

    def __call__(self, step: RegionStep[Mem, In, Out], memories: Sequence[Mem], given: Sequence[In]) -> list[tuple[Mem, Out]]:
        """What step(memory, given) returns for each region."""
        return [step(memory, region_input) for memory, region_input in zip(memories, given, strict=True)]

    def gather(self, memories: Sequence[Mem]) -> list[Mem]:
        """The memories as they are."""
        return list(memories)


serial_regions = SerialRegions()


class Plan(Settings):
    """The instants of a run: cycle c ends at start_s + period_s * (c + 1)."""

    start_s: float
    period_s: float
    cycles: int

    def instant_s(self, cycle: int) -> float:
        """The time at which this cycle ends. Every caller gets the same bits."""
        return self.start_s + self.period_s * (cycle + 1)

    @property
    def instants_s(self) -> Floats:
        """The start of the run and the end of each cycle. (cycles + 1,)"""
        return np.asarray(self.start_s + self.period_s * np.arange(self.cycles + 1, dtype=np.float64))
