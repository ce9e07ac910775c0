"""A run of the whole chain: `cycle.run_cycle` as the server runs it, with times, memory and scores of each cycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from coastwatch import scores, store
from coastwatch.centre import Cycle
from coastwatch.cycle import gathered, run_cycle, start_run
from coastwatch.server import checkpoint
from coastwatch.server.checkpoint import Point
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writing.writer import BEHIND, STAGE, Writer
from coastwatch.workers import open_workers
from scaling.load.chain import scores as quality
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.world import Size, World
from scaling.load.processes import memory_bytes, processor_s
from scaling.load.run import CycleTimes, RunDatabase, timed


@dataclass(frozen=True)
class Load:
    """Size and settings of a run."""

    size: Size
    warmup: int = 10  # cycles before the measured ones; the cycles of `size` include them
    workers: int = 1
    store: str = "none"  # SQLAlchemy URL
    seed: int = 1
    settings: Mapping[str, str] = field(default_factory=dict)
    score: bool = True


@dataclass(frozen=True, eq=False)
class CycleResult:
    """One cycle of a run."""

    number: int
    warm: bool  # the warm-up is over: the cycle counts
    times: CycleTimes
    stages_cpu_s: Mapping[str, float]  # processor time of this process; with a store, of its writer too
    rows_written: int  # of the previous cycle
    warning: str | None  # of the store, for an operator
    memory_bytes: int
    peak_memory_bytes: int
    plots: int
    clutter: int
    ais_reports: int
    bearings: int
    tracks: int
    vessels: int
    pairs_tested: int  # inside the gate of the association of tracks
    tally: quality.Tally | None  # in the last cycle, if scored


class StageTimer:
    """Times stages by the clock, with a Stopwatch, and by the processor time of all threads of this process."""

    def __init__(self, watch: Stopwatch) -> None:
        self._watch, self._cpu_s = watch, dict[str, float]()

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begun = time.process_time()
        with self._watch(stage):
            yield
        self._cpu_s[stage] = self._cpu_s.get(stage, 0.0) + time.process_time() - begun

    def lap_cpu_s(self) -> dict[str, float]:
        """Processor seconds of each stage since the last call."""
        done, self._cpu_s = self._cpu_s, {}
        return done


def run_cycles(load: Load, world: World, on_cycle: Callable[[Cycle], None] | None = None) -> Iterator[CycleResult]:
    """Each cycle of a run as it ends, warm-up included.

    A cycle is written while the next one is computed, as in the server, with its checkpoints. The times of a cycle include neither
    the generator of the input nor the scores.
    Args: on_cycle: called with each cycle.
    """
    scenario, sensors, plan, watch = world.scenario, world.sensors, world.plan, Stopwatch()
    state, memory = initial_state(world), start_run(scenario, sensors)
    timer = StageTimer(watch)
    tally, sample, no_scores = quality.Tally(), quality.sample_of(world), scores.Tally()
    with ExitStack() as stack:
        workers = stack.enter_context(open_workers(scenario.workers.method, load.workers))
        opened = nullcontext() if load.store == "none" else RunDatabase(load.store, scenario, sensors, plan, load.workers)
        database: RunDatabase | None = stack.enter_context(opened)
        in_thread = scenario.store.overlap and (database is None or database.shared)
        writer = stack.enter_context(Writer[tuple[store.Written, float]](watch, in_thread, BEHIND))
        job: Any = None
        for number in range(plan.cycles):
            begun = time.perf_counter()
            state, reports = next_cycle(world, state)
            generator_s, cpu_s, begun = time.perf_counter() - begun, processor_s(), time.perf_counter()
            if job is not None:
                writer.start(job)
            now_s = plan.instant_s(number)
            memory, cycle = run_cycle(scenario, sensors, memory, reports, now_s, workers.spots, timer, regions=workers.regions)
            cpu_s = processor_s() - cpu_s
            blob = None
            if database is not None and (number == 0 or (number + 1) % scenario.store.checkpoint_every == 0):
                with watch("checkpoint"):
                    saved = gathered(memory, workers.regions)
                    blob = checkpoint.save(Point(number + 1, saved, no_scores))
            written, store_cpu_s = writer.wait() or (store.Written(0, None), 0.0)
            stages_s = {**watch.so_far(), **watch.lap()}
            cycle_s = max(time.perf_counter() - begun, stages_s.get(STAGE, 0.0))
            times = CycleTimes(stages_s, cycle_s, cpu_s, store_cpu_s, generator_s)
            in_use = memory_bytes()
            warm = number >= load.warmup
            if load.score:
                tally = quality.received(tally, reports, sample)
                tally = quality.add(tally, world, cycle, sample) if warm else tally
            if on_cycle is not None:
                on_cycle(cycle)
            yield CycleResult(
                number,
                warm,
                times,
                timer.lap_cpu_s(),
                written.rows,
                written.warning,
                *in_use,
                plots=len(reports.radar),
                clutter=int((reports.radar.origin < 0).sum()),
                ais_reports=len(reports.ais),
                bearings=len(reports.bearing),
                tracks=len(cycle.tracks),
                vessels=len(cycle.picture),
                pairs_tested=cycle.associations.tested,
                tally=tally if load.score and number == plan.cycles - 1 else None,
            )
            if database is not None:
                write = partial(database.write, number, cycle.to_write(), reports, stages_s, blob)
                job = partial(timed, write)
            del cycle, reports, blob  # otherwise they would stay in memory while the next cycle is made
        if job is not None:
            writer.start(job)
