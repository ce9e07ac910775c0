"""What a peer is given and what it gives back: two npz files. Knows numpy alone, so that it runs in any peer's environment."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RADAR, AIS = 0, 1  # sources of the file


@dataclass(frozen=True, eq=False)
class Given:
    """N tracks of V vessels at T cycles, the same tracks in all of them.

    The truth is for scores; `vessel` also for tasks that begin where association ends.
    """

    time_s: Floats  # (T,)
    measured: int  # cycles at the end that are timed and scored; those before only fill windows and filters
    track_id: Ints  # (N,)
    source: Ints  # (N,) RADAR or AIS
    vessel: Ints  # (N,) the true one, 0..V-1
    position_m: Floats  # (T, N, 2) east, north in one plane
    position_deg: Floats  # (T, N, 2) the same places
    velocity_m_s: Floats  # (T, N, 2)
    covariance: Floats  # (N, 4, 4) of position and velocity, at all cycles
    report_covariance: Floats  # (N, 2, 2) of one report of the sensor
    true_position_m: Floats  # (T, V, 2)
    true_velocity_m_s: Floats  # (T, V, 2)
    settings: Mapping[str, Any]  # of Coastwatch, for peers to use the same where they have the same setting

    @property
    def first(self) -> int:
        """The first measured cycle."""
        return len(self.time_s) - self.measured


@dataclass(frozen=True, eq=False)
class Answer:
    """What a task gave; of the last three groups the one that the task is about."""

    wall_s: Floats  # of a cycle, each measured one or the mean of all
    cpu_s: Floats  # the same, of all threads
    versions: Mapping[str, str]
    unit: str = ""  # what `units` counts
    units: int = 0  # of a measured cycle
    pairs: Ints = field(
        default_factory=lambda: np.zeros((0, 3), np.int64)
    )  # (A, 3) cycle, row of the radar track, of the AIS track
    position_m: Floats = field(default_factory=lambda: np.zeros((0, 0, 2)))  # (C, V, 2) of each vessel at each measured cycle
    velocity_m_s: Floats = field(default_factory=lambda: np.zeros((0, 0, 2)))
    spot: Ints = field(default_factory=lambda: np.zeros(0, np.int64))  # (N,) of each track at the last cycle


def save(path: Path, what: Given | Answer) -> None:
    """Writes an npz file; what is no array is text in JSON."""
    values = {f.name: getattr(what, f.name) for f in fields(what)}
    np.savez(path, **{k: v if isinstance(v, np.ndarray) else np.array(json.dumps(v)) for k, v in values.items()})


def load(path: Path, kind: type[Any]) -> Any:
    """The Given or Answer in a file. Raises: KeyError: the file lacks one of its arrays."""
    with np.load(path) as held:
        return kind(**{f.name: _value(held[f.name]) for f in fields(kind)})


def _value(array: NDArray[Any]) -> Any:
    return json.loads(str(array)) if array.dtype.kind == "U" else array


class Watch:
    """Wall and processor seconds of what runs inside `with watch.lap():`."""

    def __init__(self) -> None:
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []

    @contextmanager
    def lap(self, cycles: int = 1) -> Iterator[None]:
        """One entry: the mean over so many cycles."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.wall_s.append((time.perf_counter() - wall) / cycles)
        self.cpu_s.append((time.process_time() - cpu) / cycles)

    def answer(self, packages: tuple[str, ...], **rest: Any) -> Answer:
        """The Answer with these times and the versions of these packages."""
        return Answer(np.array(self.wall_s), np.array(self.cpu_s), {p: version(p) for p in packages}, **rest)


Task = Callable[[Given, Watch], Answer]


def answer_command(tasks: Mapping[str, Task]) -> None:
    """What every adapter does as a program: `python -m scaling.peers.PEER.adapter TASK GIVEN.npz ANSWER.npz`."""
    if len(sys.argv) != 4 or sys.argv[1] not in tasks:
        raise SystemExit(f"got {sys.argv[1:]}, needed a task of {sorted(tasks)}, the file given and the file to write")
    task, given, out = sys.argv[1:]
    save(Path(out), tasks[task](load(Path(given), Given), Watch()))
