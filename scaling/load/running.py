"""The high-level centre over the cycles of a national picture: what each cycle took, decided and wrote."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial

from coastwatch import pipeline, store
from coastwatch.batches import Ints, Sensors
from coastwatch.pipeline import Cycle
from coastwatch.scenario import Scenario
from coastwatch.scores.confusion import Confusion
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writer import STAGE, WAIT, Writer
from coastwatch.stage import Plan
from coastwatch.workers import spread_over
from scaling.load import national
from scaling.load.budget import budget_of, pairs_within
from scaling.load.keeping import Keeper
from scaling.load.national import World
from scaling.load.processes import memory_bytes, processor_s

STORING = (STAGE, WAIT)  # the stages that are not compute


@dataclass(frozen=True)
class Load:
    """What is asked for."""

    tracks: int
    cycles: int  # that count
    warmup: int = 20  # cycles before: windows must fill, those of bearings in 100
    workers: int = 1
    store: str = "none"  # SQLAlchemy URL
    seed: int = 1
    settings: Mapping[str, str] = field(default_factory=dict)
    score: bool = True  # whether decisions are counted, which takes memory of its own


@dataclass(frozen=True)
class Taken:
    """What a cycle took."""

    seconds: Mapping[str, float]  # of each stage, wall; of the store, what writing the cycle before took beside them
    all_s: float  # from the start of the cycle until it is computed and the one before is written: the period that can be sustained
    compute_cpu_s: float  # of all processes, all stages but the store; beside one, what its thread took falls into both
    store_cpu_s: float  # of the thread that wrote the cycle before, 0 where there is none
    generator_s: float  # to make what was received, not part of the cycle
    rows_written: int
    complaint: str | None  # of the store, what an operator should see to
    memory_bytes: int
    peak_memory_bytes: int

    @property
    def compute_s(self) -> float:
        return sum(s for stage, s in self.seconds.items() if stage not in STORING)


def said(taken: Taken) -> str:
    """What the store complains of, to be put after other words; nothing where all is well."""
    return f"; {taken.complaint}" if taken.complaint else ""


@dataclass(frozen=True)
class Measured:
    """One cycle."""

    number: int
    counts: bool  # the warm-up is over
    taken: Taken
    tracks: int
    bearing_tracks: int
    vessels: int
    pairs_tested: int  # 0 but in the last cycle
    budget: Mapping[str, Confusion]  # empty where it is not scored


def measured(load: Load) -> Iterator[Measured]:
    """Each cycle of a run, warm-up and all, as it ends.

    A cycle is written while the next one is computed, as the server does; what the generator and the scores take falls into neither.
    """
    world = national.lay_world(load.tracks, load.seed)
    scenario = national.scenario_of(world, load.settings)
    sensors, last = scenario.sensors(), load.warmup + load.cycles
    state, memory, watch = national.first(world), pipeline.start_centre(scenario), Stopwatch()
    with ExitStack() as open_:
        spread = open_.enter_context(spread_over(scenario.workers.method, load.workers))
        keeper = open_.enter_context(_keeper(load, world, scenario, sensors))
        apart = scenario.store.overlap and (keeper is None or keeper.shared)
        writer = open_.enter_context(Writer[tuple[store.Written, float]](watch, apart))
        job = None
        for number in range(last):
            begun = time.perf_counter()
            state, received = national.receive(world, state, sensors)
            statics, given = received.statics, [received]
            del received  # or the tracks as they came would stay beside the aligned ones
            generator_s, cpu_s, begun = time.perf_counter() - begun, processor_s(), time.perf_counter()
            if job is not None:
                writer.start(job)
            memory, cycle = pipeline.fuse(scenario, sensors, memory, given.pop(), world.time_s(number), spread, watch)
            cpu_s = processor_s() - cpu_s
            written, store_cpu_s = writer.wait() or (store.Written(0, None), 0.0)
            all_s = time.perf_counter() - begun
            seconds = {**watch.so_far(), **watch.lap()}
            taken = Taken(seconds, all_s, cpu_s, store_cpu_s, generator_s, *written, *memory_bytes())
            yield _measured(load, world, scenario.associations.gate_m, sensors.source_kinds, number, cycle, taken)
            job = partial(_written, partial(keeper.write, number, cycle.to_write(), statics, seconds)) if keeper else None
            del cycle  # or the next would be made beside them
        if job is not None:
            writer.start(job)


def _written(write: Callable[[], store.Written]) -> tuple[store.Written, float]:
    """What there is to say of a cycle, and the processor time of the thread that writes it."""
    begun = time.thread_time()
    return write(), time.thread_time() - begun


def _keeper(load: Load, world: World, scenario: Scenario, sensors: Sensors) -> AbstractContextManager[Keeper | None]:
    if load.store == "none":
        return nullcontext()
    plan = Plan(start_s=world.time_s(-1), period_s=world.period_s, cycles=load.warmup + load.cycles)
    return Keeper(load.store, scenario, sensors, plan, load.workers)


def _measured(load: Load, world: World, gate_m: float, kinds: Ints, number: int, cycle: Cycle, taken: Taken) -> Measured:
    counts, is_last = number >= load.warmup, number == load.warmup + load.cycles - 1
    budget = budget_of(world, cycle, kinds) if counts and load.score else {}
    pairs = pairs_within(cycle.tracks, gate_m) if is_last else 0
    return Measured(number, counts, taken, len(cycle.tracks), len(cycle.bearing_tracks), len(cycle.picture), pairs, budget)
