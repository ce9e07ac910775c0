"""Runs the missing jobs over processes, then the timed ones one at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from coastwatch.reproduction.finished_runs import FinishedRuns
from coastwatch.reproduction.measuring import Draw, measure
from coastwatch.reproduction.planning import Job
from coastwatch.reproduction.two_filters import TwoFilters
from coastwatch.sensors.simulated.video import SimulatedVideo
from coastwatch.server.processes import over_processes

Progress = Callable[[int, int, str], None]
VESSEL_CYCLE_S = 6e-5  # computing time of one vessel in one cycle, on one core of the 2-core machine; only for the estimate
TWO_FILTERS_STEP_S = 4e-5  # of a step of two filters, with its share of the gains
VIDEO_CELL_S = 1.2e-7  # of a cell of simulated video, with extraction and a few trackers
CYCLE_S = 0.018  # of a cycle without any vessel


def missing(kept: FinishedRuns, jobs: Sequence[Job]) -> list[Job]:
    """The jobs that are not in the output folder."""
    return [job for job in jobs if kept.record(job.key) is None]


def estimate_s(jobs: Sequence[Job], workers: int) -> float:
    """Estimated duration of these jobs."""
    together, alone = (sum(_cost_s(job) for job in jobs if job.serial is serial) for serial in (False, True))
    return together / workers + alone


def carry_out(kept: FinishedRuns, jobs: Sequence[Job], workers: int, progress: Progress, draw: Draw) -> None:
    """Runs every missing job and stores its record immediately. Args: draw: for folders that show the picture.

    Raises: KeyboardInterrupt on Ctrl-C; the records of finished runs are kept.
    """
    todo = missing(kept, jobs)
    done = len(jobs) - len(todo)
    progress(done, len(jobs), "runs kept from before" if done else "starting")
    for serial, count in ((False, workers), (True, 1)):
        for job, record in over_processes(partial(measure, draw=draw), [job for job in todo if job.serial is serial], count):
            if record is None:
                raise KeyboardInterrupt
            kept.keep(job.key, record)
            done += 1
            progress(done, len(jobs), f"{job.name}, seed {job.seed}")


def records(kept: FinishedRuns, jobs: Sequence[Job]) -> list[dict[str, Any]]:
    """The record of each job. Raises: LookupError if one is missing."""
    found = []
    for job in jobs:
        record = kept.record(job.key)
        if record is None:
            raise LookupError(f"run {job.key}, {job.name}, seed {job.seed}: is not in {kept.folder}")
        found.append(record)
    return found


def _cost_s(job: Job) -> float:
    if isinstance(job.subject, TwoFilters):
        return TWO_FILTERS_STEP_S * job.subject.steps
    cycles = job.scenario.warmup_cycles + job.scenario.cycles
    if isinstance(job.scenario.input, SimulatedVideo):
        return cycles * VIDEO_CELL_S * job.scenario.input.spokes * job.scenario.input.cells * len(job.scenario.radars)
    vessels = getattr(job.scenario.input, "count", 0)
    return cycles * (CYCLE_S + VESSEL_CYCLE_S * vessels * (3.0 if job.roc else 1.0))
