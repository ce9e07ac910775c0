"""A run's memory as bytes: an npz file of its arrays, and a JSON tree with the rest. It holds data only, never code."""

from __future__ import annotations

import io
import json
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from coastwatch.batches.plain_data import Classes, TreeError, classes_in, from_tree, to_tree
from coastwatch.cycle import Memory
from coastwatch.errors import ExplainedError
from coastwatch.scenario.model import StoreSettings
from coastwatch.scores import Tally

MOST_OF_PERIOD = 0.1
"""Share of the time of a live run for which cycles wait, that checkpoints may take."""

TREE = "tree"  # the member of the npz file that holds the JSON text


class CheckpointError(ExplainedError, ValueError):
    """A checkpoint that cannot be read, with the reason."""


@dataclass(frozen=True)
class Point:
    """The state of a run between two cycles: all that is needed to resume it."""

    cycle: int  # the next one
    memory: Memory
    tally: Tally


@cache
def classes() -> Classes:
    """The classes that a checkpoint may hold: those that the types of `Point` declare. No other class is made."""
    return classes_in(Point)


class CheckpointSchedule:
    """After which cycles a run saves a checkpoint. A live run saves as often as clock and disk allow: its feeds send nothing twice."""

    def __init__(self, keep: StoreSettings, live_period_s: float | None = None) -> None:
        """Args: live_period_s: period of a live run; none: the run is not live."""
        self.newest = -1  # cycle after which one was saved
        self._keep, self._period_s, self._cycles = keep, live_period_s, 1

    def is_due(self, cycle: int, writer_is_idle: bool) -> bool:
        """Whether one is to be saved after a cycle. Args: writer_is_idle: all earlier cycles are written."""
        if cycle == 0 or (cycle + 1) % self._keep.checkpoint_every == 0:
            return True
        return self._period_s is not None and writer_is_idle and cycle - self.newest >= self._cycles

    def note(self, cycle: int, size: int, seconds: float) -> None:
        """One was saved after a cycle. Args: size: bytes; seconds: that it took."""
        self.newest = cycle
        if self._period_s is not None:
            of_clock = seconds / (MOST_OF_PERIOD * self._period_s)
            of_disk = size / (1e6 * self._keep.checkpoint_mb_s * self._period_s)
            self._cycles = max(math.ceil(of_clock), math.ceil(of_disk), 1)


def save(value: object) -> bytes:
    """Bytes from which `load` makes an equal value.

    Args: value: plain data (`coastwatch.batches.plain_data`) of what `Point` declares. An array keeps its dtype, shape and
    order (C or Fortran), not what it shares.
    Raises: TypeError: anything else.
    """
    tree, arrays = to_tree(value, classes())
    text = json.dumps(tree, separators=(",", ":")).encode()
    members: dict[str, Any] = {TREE: np.frombuffer(text, np.uint8)}
    members |= {str(number): array for number, array in enumerate(arrays)}
    file = io.BytesIO()
    np.savez(file, **members)
    return file.getvalue()


def load(saved: bytes) -> Any:
    """The value that `save` was given, with arrays of its own. Only what `Point` declares is made.

    Raises: CheckpointError: the bytes are not of `save`, are damaged, name a class or a field that does not exist, or hold a row
    number that is out of range.
    """
    if not saved.startswith(b"PK"):
        raise CheckpointError("it is not in the format of this version")
    try:
        with np.load(io.BytesIO(saved)) as file:  # numpy refuses arrays of objects by default
            members = {name: file[name] for name in file.files}
        tree = json.loads(members.pop(TREE).tobytes())
        return from_tree(tree, [members[str(number)] for number in range(len(members))], classes())
    except TreeError as error:
        raise CheckpointError(str(error)) from error
    except Exception as error:  # any error of zipfile, numpy or json on damaged bytes
        raise CheckpointError(f"it is damaged: {type(error).__name__}: {error}") from error


def load_point(saved: bytes, run_id: int) -> Point:
    """The point of a run that a checkpoint holds. Raises: CheckpointError that names the run: it cannot be read."""
    try:
        point = load(saved)
        if not isinstance(point, Point):
            raise CheckpointError(f"it holds a {type(point).__name__}")
    except CheckpointError as error:
        raise CheckpointError(f"run {run_id}: its checkpoint cannot be read: {error}; --restart begins again") from error
    return point
