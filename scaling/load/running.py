"""The high-level centre over the cycles of a national picture: what each cycle took, decided and wrote."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field

from coastwatch import pipeline
from coastwatch.batches import Ints
from coastwatch.pipeline import Cycle
from coastwatch.scores.confusion import Confusion
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import Plan
from coastwatch.workers import spread_over
from scaling.load import national
from scaling.load.budget import budget_of, pairs_within
from scaling.load.keeping import Keeper
from scaling.load.national import World
from scaling.load.processes import memory_bytes, processor_s

STORE = "store"  # the stage that is not compute


@dataclass(frozen=True)
class Load:
    """What is asked for."""

    tracks: int
    cycles: int  # that count
    warmup: int = 20  # cycles before: windows must fill
    workers: int = 1
    store: str = "none"  # SQLAlchemy URL
    seed: int = 1
    settings: Mapping[str, str] = field(default_factory=dict)
    score: bool = True  # whether decisions are counted, which takes memory of its own


@dataclass(frozen=True)
class Taken:
    """What a cycle took."""

    seconds: Mapping[str, float]  # of each stage, wall
    compute_cpu_s: float  # of all processes, all stages but the store
    generator_s: float  # to make what was received, not part of the cycle
    rows_written: int
    memory_bytes: int
    peak_memory_bytes: int

    @property
    def compute_s(self) -> float:
        return sum(s for stage, s in self.seconds.items() if stage != STORE)

    @property
    def all_s(self) -> float:
        return sum(self.seconds.values())


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
    """Each cycle of a run, warm-up and all, as it ends."""
    world = national.lay_world(load.tracks, load.seed)
    scenario = national.scenario_of(world, load.settings)
    sensors, last = scenario.sensors(), load.warmup + load.cycles
    kinds = sensors.source_kinds
    state, memory, watch = national.first(world), pipeline.start_centre(scenario), Stopwatch()
    with ExitStack() as open_:
        spread = open_.enter_context(spread_over(scenario.workers.method, load.workers))
        keeper = None
        if load.store != "none":
            plan = Plan(start_s=world.time_s(-1), period_s=world.period_s, cycles=last)
            keeper = open_.enter_context(Keeper(load.store, scenario, sensors, plan, load.workers))
        for number in range(last):
            begun = time.perf_counter()
            state, received = national.receive(world, state, sensors)
            generator_s, cpu_s, rows = time.perf_counter() - begun, processor_s(), keeper.rows if keeper else 0
            memory, cycle = pipeline.fuse(scenario, sensors, memory, received, world.time_s(number), spread, watch)
            cpu_s = processor_s() - cpu_s
            if keeper:
                with watch(STORE):
                    keeper.write(number, cycle, received.statics, watch.so_far())
            rows = keeper.rows - rows if keeper else 0
            taken = Taken(watch.lap(), cpu_s, generator_s, rows, *memory_bytes())
            yield _measured(load, world, scenario.associations.gate_m, kinds, number, cycle, taken)
            del received, cycle  # or the next would be made beside them


def _measured(load: Load, world: World, gate_m: float, kinds: Ints, number: int, cycle: Cycle, taken: Taken) -> Measured:
    counts, is_last = number >= load.warmup, number == load.warmup + load.cycles - 1
    budget = budget_of(world, cycle, kinds) if counts and load.score else {}
    pairs = pairs_within(cycle.tracks, gate_m) if is_last else 0
    return Measured(number, counts, taken, len(cycle.tracks), len(cycle.bearing_tracks), len(cycle.picture), pairs, budget)
