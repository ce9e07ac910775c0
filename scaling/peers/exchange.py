"""The input and the result of a task, as npz files. Imports numpy alone, so that it runs in any peer's environment."""

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
class TrackHistory:
    """N tracks of V vessels at T cycles, the same tracks in all of them.

    The truth is for scores; `vessel` is also an input of tasks that come after association.
    """

    time_s: Floats  # (T,)
    measured: int  # cycles at the end that are timed and scored; the ones before fill windows and filters
    track_id: Ints  # (N,)
    source: Ints  # (N,) RADAR or AIS
    vessel: Ints  # (N,) the true one, 0..V-1
    position_m: Floats  # (T, N, 2) east, north in one plane
    position_deg: Floats  # (T, N, 2) latitude, longitude of the same positions
    velocity_m_s: Floats  # (T, N, 2)
    covariance: Floats  # (N, 4, 4) of position and velocity, at all cycles
    report_covariance: Floats  # (N, 2, 2) of one report of the sensor
    true_position_m: Floats  # (T, V, 2)
    true_velocity_m_s: Floats  # (T, V, 2)
    settings: Mapping[str, Any]  # of Coastwatch; a peer uses the ones that it has too

    @property
    def first(self) -> int:
        """The first measured cycle."""
        return len(self.time_s) - self.measured


@dataclass(frozen=True, eq=False)
class PlotHistory:
    """M plots of R radars over T cycles in one plane, and the truth of V vessels, which is for scores alone."""

    time_s: Floats  # (T,) ends of the cycles
    measured: int  # cycles at the end that are timed and scored; tracks begin in the ones before
    cycle: Ints  # (M,) in which the plot arrives, not decreasing
    radar: Ints  # (M,)
    plot_time_s: Floats  # (M,) when the beam passed
    range_m: Floats  # (M,)
    azimuth_rad: Floats  # (M,)
    position_m: Floats  # (M, 2) east, north
    covariance: Floats  # (M, 2, 2)
    site_m: Floats  # (R, 2)
    reach_m: Floats  # (R,) range of each radar
    true_position_m: Floats  # (T, V, 2)
    true_velocity_m_s: Floats  # (T, V, 2)
    settings: Mapping[str, Any]  # of the input

    @property
    def first(self) -> int:
        """The first measured cycle."""
        return len(self.time_s) - self.measured


@dataclass(frozen=True, eq=False)
class TaskResult:
    """Times and output of a task: pairs, or positions and velocities, or spots, or tracks."""

    wall_s: Floats  # per cycle: of each measured one, or one mean of all
    cpu_s: Floats  # the same, of all threads
    versions: Mapping[str, str]
    unit: str = ""  # name of the items that `units` counts
    units: int = 0  # items per measured cycle
    # (A, 3) cycle, row of the radar track, row of the AIS track
    pairs: Ints = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    position_m: Floats = field(default_factory=lambda: np.zeros((0, 0, 2)))  # (C, V, 2) of each vessel at each measured cycle
    velocity_m_s: Floats = field(default_factory=lambda: np.zeros((0, 0, 2)))
    spot: Ints = field(default_factory=lambda: np.zeros(0, np.int64))  # (N,) of each track at the last cycle
    # (A, 6) cycle, number of the track, its position and velocity at the end of the cycle
    tracks: Floats = field(default_factory=lambda: np.zeros((0, 6)))


def input_of(task: str) -> type[TrackHistory] | type[PlotHistory]:
    """What a task reads. A task is a kind of task, or a kind and a variant: `association_batched`."""
    return PlotHistory if task.partition("_")[0] == "tracking" else TrackHistory


def save(path: Path, record: TrackHistory | PlotHistory | TaskResult) -> None:
    """Write an npz file; fields that are no arrays are stored as JSON text."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    arrays: dict[str, Any] = {k: v if isinstance(v, np.ndarray) else np.array(json.dumps(v)) for k, v in values.items()}
    np.savez(path, **arrays)


def load(path: Path, kind: type[Any]) -> Any:
    """The record of this kind in a file. Raises: KeyError: the file lacks one of its arrays."""
    with np.load(path) as file:
        return kind(**{f.name: _value(file[f.name]) for f in fields(kind)})


def _value(array: NDArray[Any]) -> Any:
    return json.loads(str(array)) if array.dtype.kind == "U" else array


class Stopwatch:
    """Wall and processor seconds of the code inside `with watch.lap():`."""

    def __init__(self) -> None:
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []

    @contextmanager
    def lap(self, cycles: int = 1) -> Iterator[None]:
        """Add one entry: the mean over this number of cycles."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.wall_s.append((time.perf_counter() - wall) / cycles)
        self.cpu_s.append((time.process_time() - cpu) / cycles)

    def result(self, packages: tuple[str, ...], **rest: Any) -> TaskResult:
        """The TaskResult with these times and the versions of these packages."""
        return TaskResult(np.array(self.wall_s), np.array(self.cpu_s), {p: version(p) for p in packages}, **rest)


COUNTING: dict[str, Any] = {"threshold_m": 60.0, "hits": 3, "misses": 2}
"""Settings of the task `counting`, of both sides."""

Task = Callable[[Any, Stopwatch], TaskResult]
"""A task takes the record of its input, a TrackHistory or a PlotHistory."""


def run_adapter(tasks: Mapping[str, Task]) -> None:
    """The main program of every adapter: `python -m scaling.peers.PEER.adapter TASK INPUT.npz RESULT.npz`."""
    if len(sys.argv) != 4 or sys.argv[1] not in tasks:
        raise SystemExit(f"got {sys.argv[1:]}, needed a task of {sorted(tasks)}, the input file and the result file")
    task, source, target = sys.argv[1:]
    save(Path(target), tasks[task](load(Path(source), input_of(task)), Stopwatch()))
