"""A run of the high-level centre over the national picture: times, memory, decisions and rows written of each cycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from coastwatch import store
from coastwatch.batches import (
    AisReports,
    AisStatics,
    BearingReports,
    Floats,
    Ints,
    RadarReports,
    Reports,
    Sensors,
    SourceKind,
    Tracks,
)
from coastwatch.centre import Cycle, run_centre, start_centre
from coastwatch.geodesy import earth_centred
from coastwatch.scenario import Scenario
from coastwatch.scores.confusion import Confusion, bearing_association, decisions
from coastwatch.server.run import version
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writing.writer import BEHIND, STAGE, WAIT, Writer
from coastwatch.stage import Plan
from coastwatch.workers import open_workers
from scaling.load import national
from scaling.load.national import World
from scaling.load.national.traffic import Traffic
from scaling.load.processes import memory_bytes, processor_s

STORE_STAGES = (STAGE, WAIT)  # the stages that are not compute
YOUNG_S = 30.0  # a track younger than this is young
ALL, YOUNG, BEARINGS = "all", "young", "bearings"
TRAFFIC = tuple(kind.name.lower() for kind in Traffic)
STOPPED = (KeyboardInterrupt, GeneratorExit)
"""Ctrl-C inside a cycle, and between two cycles: the run is `interrupted`. Any other exception makes it `failed`."""


@dataclass(frozen=True)
class Load:
    """Size and settings of a run."""

    tracks: int
    cycles: int  # measured cycles
    warmup: int = 20  # cycles before: history windows of tracks fill in 20 cycles, those of bearings in 100
    workers: int = 1
    store: str = "none"  # SQLAlchemy URL
    seed: int = 1
    settings: Mapping[str, str] = field(default_factory=dict)
    score: bool = True  # whether decisions are counted; counting takes memory


@dataclass(frozen=True)
class CycleTimes:
    """Times of one cycle, seconds."""

    stages_s: Mapping[str, float]  # wall time of each stage; `store` is the write that ended in this cycle, in parallel
    cycle_s: float  # wall time of this cycle, or of the write that ended in it if longer: the shortest sustainable period
    compute_cpu_s: float  # of all processes, all stages but the store; without parallel stages it includes the writer thread
    store_cpu_s: float  # of the thread that wrote the previous cycle, 0 if none
    generator_s: float  # wall time to make the input, not part of the cycle

    @property
    def compute_s(self) -> float:
        """Wall time of all stages but the store."""
        return sum(s for stage, s in self.stages_s.items() if stage not in STORE_STAGES)


@dataclass(frozen=True)
class CycleResult:
    """One cycle of a run."""

    number: int
    warm: bool  # the warm-up is over: the cycle counts
    times: CycleTimes
    rows_written: int  # of the previous cycle
    warning: str | None  # of the store, for an operator
    memory_bytes: int
    peak_memory_bytes: int
    tracks: int
    bearing_tracks: int
    vessels: int
    pairs_within_gate: int  # counted in the last cycle, else 0
    decisions: Mapping[str, Confusion]  # empty if not scored

    @property
    def warning_text(self) -> str:
        """The warning as the end of a line of progress, empty if there is none."""
        return f"; {self.warning}" if self.warning else ""


class RunDatabase:
    """A run in a database, written as the server writes it. Use it in a `with` block."""

    def __init__(self, url: str, scenario: Scenario, sensors: Sensors, plan: Plan, workers: int) -> None:
        self._store, self._scenario = store.open_store(url), scenario
        self._run_id = store.begin_run(
            self._store,
            scenario=scenario.name,
            title=scenario.title,
            seed=scenario.seed,
            version=version(),
            settings=scenario.model_dump(mode="json"),
            sensors=sensors,
            plan=plan,
            workers=workers,
        )

    @property
    def shared(self) -> bool:
        """Whether another thread may write to it."""
        return self._store.shared

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failed: Any) -> None:
        stopped = isinstance(failed[1], STOPPED)
        try:
            store.finish_run(self._store, self._run_id, "interrupted" if stopped else "failed" if failed[0] else "finished")
        finally:
            self._store.close()

    def write(
        self, number: int, cycle: Cycle, reports: Reports, stages_s: Mapping[str, float], blob: bytes | None = None
    ) -> store.Written:
        """Write one cycle; returns the number of rows and a warning. Args: stages_s: wall time of each stage; blob: a checkpoint."""
        record = store.CycleRecord(number, cycle, reports, stages_s, blob)
        return store.write_cycle(self._store, self._run_id, record, self._scenario.store)


def run_cycles(load: Load) -> Iterator[CycleResult]:
    """Each cycle of a run as it ends, warm-up included.

    A cycle is written while the next one is computed, as in the server. The times of a cycle include neither the generator of
    the input nor the scores.
    """
    world = national.build_world(load.tracks, load.seed)
    scenario = national.scenario_of(world, load.settings)
    sensors, count = scenario.sensors(), load.warmup + load.cycles
    state, memory, watch = national.initial_state(world), start_centre(scenario), Stopwatch()
    with ExitStack() as stack:
        workers = stack.enter_context(open_workers(scenario.workers.method, load.workers))
        database = stack.enter_context(_open_database(load, world, scenario, sensors))
        in_thread = scenario.store.overlap and (database is None or database.shared)
        writer = stack.enter_context(Writer[tuple[store.Written, float]](watch, in_thread, BEHIND))
        job = None
        for number in range(count):
            begun = time.perf_counter()
            state, received = national.next_cycle(world, state, sensors)
            sent, given = statics_alone(received.statics), [received]
            del received  # otherwise the tracks as received would stay in memory beside the aligned ones
            generator_s, cpu_s, begun = time.perf_counter() - begun, processor_s(), time.perf_counter()
            if job is not None:
                writer.start(job)
            memory, cycle = run_centre(scenario, sensors, memory, given.pop(), world.time_s(number), workers.spots, watch)
            cpu_s = processor_s() - cpu_s
            written, store_cpu_s = writer.wait() or (store.Written(0, None), 0.0)
            stages_s = {**watch.so_far(), **watch.lap()}
            cycle_s = max(time.perf_counter() - begun, stages_s.get(STAGE, 0.0))
            times = CycleTimes(stages_s, cycle_s, cpu_s, store_cpu_s, generator_s)
            warm, last = number >= load.warmup, number == count - 1
            yield CycleResult(
                number,
                warm,
                times,
                written.rows,
                written.warning,
                *memory_bytes(),
                len(cycle.tracks),
                len(cycle.bearing_tracks),
                len(cycle.picture),
                pairs_within_gate(cycle.tracks, scenario.associations.gate_m) if last else 0,
                decision_counts(world, cycle, sensors.source_kinds) if warm and load.score else {},
            )
            job = partial(timed, partial(database.write, number, cycle.to_write(), sent, stages_s)) if database else None
            del cycle  # otherwise it would stay in memory while the next one is made
        if job is not None:
            writer.start(job)


def _open_database(
    load: Load, world: World, scenario: Scenario, sensors: Sensors
) -> AbstractContextManager[RunDatabase | None]:
    if load.store == "none":
        return nullcontext()
    plan = Plan(start_s=world.time_s(-1), period_s=world.period_s, cycles=load.warmup + load.cycles)
    return RunDatabase(load.store, scenario, sensors, plan, load.workers)


def statics_alone(statics: AisStatics) -> Reports:
    """The reports of a cycle for the store: the high-level centre receives no others."""
    return Reports(RadarReports.empty(), AisReports.empty(), statics, BearingReports.empty())


def timed(write: Callable[[], store.Written]) -> tuple[store.Written, float]:
    """What writing a cycle returned, and the processor seconds of this thread."""
    begun = time.thread_time()
    return write(), time.thread_time() - begun


def decision_counts(world: World, cycle: Cycle, kinds: Ints) -> dict[str, Confusion]:
    """Association decisions of a cycle: all, by kind of traffic, on young tracks, and on bearings.

    A decision is on young tracks if the radar track is young, or the AIS track of the same true vessel.
    Args: kinds: SourceKind of each source.
    """
    tracks = cycle.tracks
    made = decisions(tracks, cycle.associations, kinds)
    traffic = world.traffic_of(tracks.origin[made.row])
    age_s = np.minimum(cycle.time_s - tracks.started_s[made.row], _ais_age_s(tracks, made.row, kinds, cycle.time_s))
    out = {ALL: made.counted(), YOUNG: made.take(age_s < YOUNG_S).counted()}
    out |= {name: made.take(traffic == kind).counted() for kind, name in enumerate(TRAFFIC)}
    return out | {BEARINGS: bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations)}


def _ais_age_s(tracks: Tracks, rows: Ints, kinds: Ints, time_s: float) -> Floats:
    """Age of the AIS track of the true vessel of each of these rows, inf if there is none. Returns: (R,)."""
    ais = np.flatnonzero(kinds[tracks.source] == SourceKind.AIS)
    if not len(ais):
        return np.full(len(rows), np.inf)
    ais = ais[np.argsort(tracks.origin[ais], kind="stable")]
    partner = ais[np.minimum(np.searchsorted(tracks.origin[ais], tracks.origin[rows]), len(ais) - 1)]
    return np.where(tracks.origin[partner] == tracks.origin[rows], time_s - tracks.started_s[partner], np.inf)


def pairs_within_gate(tracks: Tracks, gate_m: float) -> int:
    """The number of pairs of tracks of different sources within a distance in metres: the pairs that association has to test."""
    points = earth_centred(tracks.position_deg)
    order = np.argsort(tracks.source, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(tracks.source[order])) + 1)
    tree, trees = cKDTree(points), [cKDTree(points[rows]) for rows in parts]
    return int((tree.count_neighbors(tree, gate_m) - sum(part.count_neighbors(part, gate_m) for part in trees)) // 2)
