"""What a method of a stage must offer, and `Method`, the base of all settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict

from coastwatch.batches import Array, Ints


class Settings(BaseModel):
    """A frozen struct of settings. A wrong key, type or range is refused with its path when it is read."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Method(Settings):
    """A method is its settings: a frozen struct with `init()` and a pure `step(memory, ...)`.

    `init()` returns the memory before the first cycle. `step` returns the memory after this cycle and what the stage
    yields; it never writes to what it was given. Memory is plain data (dataclasses, tuples, dicts, arrays, numbers):
    pickled in mid-run it resumes bit for bit.
    """


@dataclass(frozen=True)
class NoMemory:
    """The memory of a method that needs nothing of the past."""


Work = Callable[[Any, Mapping[str, Array], Ints], tuple[Array, ...]]
"""A module-level pure function (settings, arrays, rows) -> arrays: what is done for the rows of one spot."""


class Spread(Protocol):
    """How per-spot work is spread over processors: `coastwatch.workers` has the kinds. The result is the same for all."""

    def __call__(
        self, work: Work, settings: Any, arrays: Mapping[str, Array], spots: Sequence[Ints]
    ) -> list[tuple[Array, ...]]:
        """work(settings, arrays, rows) for the rows of every spot, in the order of the spots."""
        ...


def in_turn(work: Work, settings: Any, arrays: Mapping[str, Array], spots: Sequence[Ints]) -> list[tuple[Array, ...]]:
    """The plain Spread: one spot after the other, here."""
    return [work(settings, arrays, rows) for rows in spots]


class Plan(Settings):
    """The instants of a run: cycle c ends at start_s + period_s * (c + 1)."""

    start_s: float
    period_s: float
    cycles: int

    def instant_s(self, cycle: int) -> float:
        """The time at which this cycle ends, the same to the bit wherever it is asked."""
        return self.start_s + self.period_s * (cycle + 1)
