"""A memory that goes through a checkpoint now and then, as it does where a run is resumed."""

from __future__ import annotations

from typing import TypeVar

from coastwatch.server.checkpoint import load, save

M = TypeVar("M")

EVERY = 5  # cycles


def is_checked(cycle: int) -> bool:
    """Whether a test that plays many cycles goes through a checkpoint in this one: in cycles 3, 8, 13, ..."""
    return cycle % EVERY == EVERY - 2


def resumed_at_times(memory: M, cycle: int) -> M:
    """The memory, saved and loaded in every fifth cycle."""
    if not is_checked(cycle):
        return memory
    again: M = load(save(memory))
    return again
