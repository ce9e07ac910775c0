"""The runs that are missing, done: over processes, and then those that are timed, alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from coastwatch.operators.reproduction.keeping import Kept
from coastwatch.operators.reproduction.measuring import measure
from coastwatch.operators.reproduction.planning import Job
from coastwatch.server.many import over_processes

Progress = Callable[[int, int, str], None]
VESSEL_CYCLE_S = 6e-5  # computing time of one vessel in one cycle, on one core of the 2-core machine; only for the estimate
CYCLE_S = 0.018  # of a cycle without any vessel


def missing(kept: Kept, jobs: Sequence[Job]) -> list[Job]:
    """The jobs that are not in the output folder."""
    return [job for job in jobs if kept.record(job.key) is None]


def estimate_s(jobs: Sequence[Job], workers: int) -> float:
    """About how long these jobs take."""
    together, alone = (sum(_cost_s(job) for job in jobs if job.serial is serial) for serial in (False, True))
    return together / workers + alone


def carry_out(kept: Kept, jobs: Sequence[Job], workers: int, progress: Progress) -> None:
    """Runs every job that is missing and keeps what it measured at once.

    Raises: KeyboardInterrupt on Ctrl-C; what was finished by then is kept.
    """
    todo = missing(kept, jobs)
    done = len(jobs) - len(todo)
    progress(done, len(jobs), "runs kept from before" if done else "starting")
    for serial, count in ((False, workers), (True, 1)):
        for job, record in over_processes(measure, [job for job in todo if job.serial is serial], count):
            if record is None:
                raise KeyboardInterrupt
            kept.keep(job.key, record)
            done += 1
            progress(done, len(jobs), f"{job.scenario.name}, seed {job.seed}")


def records(kept: Kept, jobs: Sequence[Job]) -> list[dict[str, Any]]:
    """What was measured in each job. Raises: LookupError where one is not there."""
    found = []
    for job in jobs:
        record = kept.record(job.key)
        if record is None:
            raise LookupError(f"run {job.key}, {job.scenario.name}, seed {job.seed}: is not in {kept.folder}")
        found.append(record)
    return found


def _cost_s(job: Job) -> float:
    cycles = job.scenario.warmup_cycles + job.scenario.cycles
    vessels = getattr(job.scenario.input, "count", 0)
    return cycles * (CYCLE_S + VESSEL_CYCLE_S * vessels * (3.0 if job.roc else 1.0))
