"""What a method of a stage must offer, and `Method`, the base of all settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict

from coastwatch import kernels
from coastwatch.batches import Array, Ints, Struct
from coastwatch.batches.struct import column


class Settings(BaseModel):
    """A frozen struct of settings. A wrong key, type or range is refused with its path when it is read."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Method(Settings):
    """A method is its settings: a frozen struct with `init()` and a pure `step(memory, ...)`.

    `init()` returns the memory before the first cycle. `step` returns the memory after this cycle and what the stage
    yields; it never writes to what it was given. Memory is plain data (dataclasses, tuples, dicts, arrays, numbers, texts):
    saved in mid-run as arrays with a schema (`coastwatch.server.checkpoint`) and read back, it resumes bit for bit.
    """


@dataclass(frozen=True)
class NoMemory:
    """The memory of a method that needs nothing of the past."""


@dataclass(frozen=True, eq=False)
class Groups(Struct):
    """Rows in groups, one after the other: those of group k are row[start[k]:start[k + 1]]."""

    row: Ints = column(np.int64, "L")
    start: Ints = column(np.int64, "K1")  # K + 1, from 0 to L

    def __len__(self) -> int:
        return len(self.start) - 1

    def of(self, group: int) -> Ints:
        """The rows of one group."""
        return self.row[self.start[group] : self.start[group + 1]]

    def take(self, groups: Sequence[int] | Ints) -> Groups:
        """These groups, in this order."""

        return Groups(*kernels.tables.sorting.chosen(self.row, self.start, np.asarray(groups, np.int64)))


Shared = Mapping[str, Any]
"""Arrays by name, or tuples of arrays of which most are the very objects of the last cycle: those travel once.

Arrays among which are those of CUT can be cut down to some of their rows, for work on another machine. Rows of groups are then
members, and halo as -1 - row; `rank[row]` is where a row stands in every other array that is as long, and `row[rank]` the row there.
`ring`: the entries of the last W cycles, newest last, that of a cycle in the ranks of that cycle; `chain`: (N, W - 1), where a rank stands
in the entry of the last cycle, of that before it, ...; `length`: (N,), how many entries it has. `point`, if
any: (N, 3 or more), where it is.
"""

RING = ("rank", "ring", "chain")
CUT = (*RING, "row", "length")

Work = Callable[[Any, Shared, Groups], tuple[Array, ...]]
"""A module-level pure function (settings, arrays, groups) -> arrays: what is done for a chunk of spots at once.

What it says of a spot does not depend on what else is in the chunk; the caller brings the rows of all chunks into an order of its own.
"""


def by_group(
    of_one: Callable[[Any, Shared, Ints], tuple[Array, ...]], settings: Any, arrays: Shared, groups: Groups
) -> tuple[Array, ...]:
    """What of_one(settings, arrays, rows) gives for the rows of each group, one after the other."""
    parts = [of_one(settings, arrays, groups.of(k)) for k in range(len(groups))]
    if not parts:
        parts = [of_one(settings, arrays, np.zeros(0, np.int64))]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


class Spread(Protocol):
    """How per-spot work is spread over processors: `coastwatch.workers` has the kinds. The result is the same for all."""

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        ...


def room_of(spread: Spread) -> Callable[..., Array]:
    """Who makes empty arrays, as np.empty, that the work of a Spread will read: what is made there it need not copy."""
    made: Callable[..., Array] = getattr(spread, "room", np.empty)
    return made


def in_turn(work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
    """The plain Spread: all spots as one chunk, here."""
    return [work(settings, arrays, spots)]


class Plan(Settings):
    """The instants of a run: cycle c ends at start_s + period_s * (c + 1)."""

    start_s: float
    period_s: float
    cycles: int

    def instant_s(self, cycle: int) -> float:
        """The time at which this cycle ends, the same to the bit wherever it is asked."""
        return self.start_s + self.period_s * (cycle + 1)
