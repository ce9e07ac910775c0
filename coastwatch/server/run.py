"""Runs a scenario from its first report to the stored picture: clock, workers, signals, checkpoints and the store."""

from __future__ import annotations

import importlib.metadata
import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

from coastwatch import store
from coastwatch.batches import Fault, FileContent, RadarCorrections, Recording, Reports, Sensors
from coastwatch.centre import Cycle
from coastwatch.cycle import dropped, gathered, run_cycle, start_run
from coastwatch.formats.intake.accounts import losses
from coastwatch.plots import true_video
from coastwatch.scenario import Scenario
from coastwatch.scores import Tally, add, result
from coastwatch.server import checkpoint
from coastwatch.server.checkpoint import CheckpointSchedule, Point
from coastwatch.server.input import AtOnce, Input
from coastwatch.server.processes import handled_by
from coastwatch.server.resuming import former_run
from coastwatch.server.timing import Stopwatch
from coastwatch.server.video_health import PlotsOfVideo
from coastwatch.server.warm_up import warm_up
from coastwatch.server.watched_zones import WatchedZones
from coastwatch.server.writing.writer import BatchWriter, CycleWriter
from coastwatch.shipped import DEFAULT_DB
from coastwatch.stage import Plan
from coastwatch.store import CycleRecord, ForCentres, SkippedCycle, Store, Written
from coastwatch.workers import Workers, open_workers, processors

Progress = Callable[[int, int, str], None]
OnCycle = Callable[[Cycle], None]
OnInput = Callable[[tuple[FileContent, ...], tuple[Fault, ...]], None]

LOG = logging.getLogger("coastwatch.serve")

RESUME_WITHIN_S = 600.0
"""A live run goes on from its checkpoint if that is at most so old: the cycles since then are computed without reports."""

MOST_MERGED = 10
"""Cycles that are merged in the next one at most: a filter that is asked for too long a span predicts too far."""


class Computed(NamedTuple):
    """A cycle that has just been computed."""

    run_id: int
    number: int
    merged: int  # cycles before it that are merged in it
    cycle: Cycle
    reports: Reports  # with the true azimuths of video
    seconds: dict[str, float]  # of its stages
    waited_s: float  # for its reports


class Live(Protocol):
    """A run that goes on as time passes: its input, and who is given each cycle."""

    source: Input
    stop: threading.Event  # ends the run after the cycle in progress
    plots: PlotsOfVideo  # of its radars: the run notes each cycle

    def ready(self, sensors: Sensors) -> None:
        """The kernels are compiled, and the input begins. Raises: InterruptedError: `stop` was set before."""
        ...

    def begun(self, run_id: int, point: Point) -> None:
        """The run has its number. Args: point: from which it goes on."""
        ...

    def behind(self, until_s: float) -> int:
        """How many periods later than a cycle that ends at an instant another one could be computed already. 0: it is in time."""
        ...

    def computed(self, done: Computed) -> ForCentres:
        """Take a cycle. Returns: what is stored of it for other centres."""
        ...

    def refuse_zones(self, refused: Sequence[tuple[str, str]]) -> None:
        """Take the names of the zones in the database that cannot be watched, each with the reason."""
        ...

    def read_acknowledged(self, opened: Store, run_id: int) -> None:
        """Take what other servers on the database have acknowledged."""
        ...

    def writer(
        self, run_id: int, watch: Stopwatch, write: Callable[[CycleRecord], Written], idle: Callable[[], None]
    ) -> AbstractContextManager[CycleWriter]:
        """What takes the cycles to be stored. Args: idle: notes that the run is there, while it has no cycle."""
        ...


def version() -> str:
    """The version that is stored with every run."""
    return importlib.metadata.version("coastwatch")


@dataclass(frozen=True)
class RunResult:
    """The result of a run."""

    run_id: int
    scenario: str
    seed: int
    version: str
    scores: dict[str, Any]
    timings_s: dict[str, dict[str, float]]
    database: str
    faults: tuple[Fault, ...]
    vessels: int
    cycles: int
    elapsed_s: float
    interrupted: bool
    contents: tuple[FileContent, ...]  # of the recorded files
    stop_s: float  # time of the last cycle
    most_vessels: int  # in one picture
    most_vessels_s: float  # when
    corrections: RadarCorrections  # of the radars, as known at the end
    faults_of_input: tuple[Fault, ...] = ()  # those of `faults` that the readers of files counted


def run_scenario(
    scenario: Scenario,
    *,
    seed: int | None = None,
    workers: int | None = None,
    database: str | None = None,
    resume: bool = False,
    restart: bool = False,
    progress: Progress | None = None,
    on_cycle: OnCycle | None = None,
    live: Live | None = None,
    on_input: OnInput | None = None,
) -> RunResult:
    """Run a scenario into a database. Ctrl-C or SIGTERM stops it after the cycle in progress: only whole cycles are stored.

    Args:
        seed, workers: replace those of the scenario. database: SQLAlchemy URL.
        resume: continue the newest unfinished run of this scenario and seed from its last checkpoint, as of `former_run`.
        restart: delete earlier runs of this scenario and seed first.
        progress: called with cycles done, cycles in all and a short text. on_cycle: called with each cycle, before it is stored.
        on_input: called with what the recorded files hold and with their faults, as far as both are known before the first cycle:
            of tables, not of streams.
        live: its input takes the place of that of the scenario, and its `stop` that of signals.
    Raises: StoreError, OSError, ValueError: errors that the caller can repair; the message says how.
    """
    started = time.perf_counter()
    seed = scenario.seed if seed is None else seed
    count = scenario.workers.count if workers is None else workers
    database = database or DEFAULT_DB
    report = progress or (lambda done, total, text: None)
    report(0, 1, "reading input")
    sensors = scenario.sensors()
    source: Input
    if live is None:
        source = whole = AtOnce(scenario, sensors, seed)
        total, stop, schedule = whole.plan.cycles, threading.Event(), CheckpointSchedule(scenario.store)
        if on_input is not None:
            on_input(whole.recording.all_contents(), whole.recording.faults)
    else:
        source, total, stop, schedule = live.source, 1, live.stop, CheckpointSchedule(scenario.store, scenario.period_s)

    def on_signal(*_: object) -> None:  # a second one does not wait for the end of the cycle
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    with store.open_store(database) as opened:
        if restart:
            store.discard_runs(opened, scenario.name, seed, lambda done, runs, what: report(0, total, what))
        with open_workers(scenario.workers.method, count) as opened_workers:
            run = _Run(scenario, sensors, seed, source, live, stop, schedule, opened, opened_workers)
            video = any("radars" in feed for feed in source.feeds())
            warm_up(scenario, sensors, partial(report, 0, total), opened_workers, video=video)
            point = run.begin(resume, processors(count))
            with handled_by(on_signal) if live is None else nullcontext():
                try:
                    with run.writing() as run.writer:
                        point = run.cycles(point, report, on_cycle)
                    memory = gathered(point.memory, opened_workers.regions)
                    scores = result(point.tally, run.recording, sensors)
                except BaseException:
                    faults = *run.recording.all_faults(), *run.lost_workers()
                    store.finish_run(opened, run.run_id, "failed", {}, faults)
                    raise
        recording, plan = run.recording, run.plan
        interrupted = stop.is_set() and point.cycle < plan.cycles
        has_used_files = live is None and scenario.cycles == 0 and not interrupted and bool(recording.all_contents())
        unused = recording.rest(plan.instant_s(plan.cycles - 1)) if has_used_files else 0
        faults = of_input = recording.all_faults()
        if live is None:
            faults += losses(recording.all_contents(), faults, unused)
        faults = *faults, *dropped(memory, sensors), *run.lost_workers()
        store.finish_run(opened, run.run_id, "interrupted" if interrupted else "finished", scores, faults)
    return RunResult(
        run_id=run.run_id,
        scenario=scenario.name,
        seed=seed,
        version=version(),
        scores=scores,
        timings_s=run.watch.summary(),
        database=database,
        faults=faults,
        vessels=run.vessels,
        cycles=point.cycle,
        elapsed_s=time.perf_counter() - started,
        interrupted=interrupted,
        contents=recording.all_contents(),
        stop_s=plan.instant_s(point.cycle - 1),
        most_vessels=run.most[0],
        most_vessels_s=run.most[1],
        corrections=memory.corrections,
        faults_of_input=of_input,
    )


@dataclass
class _Run:
    """A run in progress. The fields without a value are set when its input begins."""

    scenario: Scenario
    sensors: Sensors
    seed: int
    source: Input
    live: Live | None
    stop: threading.Event
    schedule: CheckpointSchedule
    store: Store
    workers: Workers
    watch: Stopwatch = field(default_factory=Stopwatch)
    recording: Recording = field(init=False)
    plan: Plan = field(init=False)
    run_id: int = field(init=False)
    writer: CycleWriter = field(init=False)
    zones: WatchedZones | None = None  # none: those of the scenario
    vessels: int = 0  # of the last picture
    plots: PlotsOfVideo = field(init=False)
    most: tuple[int, float] = field(init=False)  # vessels of a picture, and its time

    def begin(self, resume: bool, workers: int) -> Point:
        """Begin the input, and a new run; or go on with the one before, if `resume` finds a checkpoint. Returns: the first point.

        A live run whose checkpoint is too old is not resumed. One that begins at the same instant is resumed whenever it is.
        No other server may write into its database.

        Raises: InputError: another server of this machine writes one.
        """
        self.plots = PlotsOfVideo() if self.live is None else self.live.plots
        scenario, live, settings = self.scenario, self.live, self.scenario.model_dump(mode="json")
        if live is not None:
            live.ready(self.sensors)
        before, why = None, None
        if resume:
            before, why = former_run(self.store, scenario, self.seed, version(), live=live is not None)
        positions = {} if before is None else store.region_positions(self.store, before.run_id, before.cycle)
        self.recording, plan = self.source.begin(scenario, self.sensors, self.seed, self.stop, positions)
        if live is not None and before is not None:
            former = plan.model_copy(update={"start_s": store.run(self.store, before.run_id)["start_s"]})
            after_s = round(plan.start_s - former.instant_s(before.cycle), 6)  # without what rounding leaves
            if former == plan or 0.0 <= after_s <= RESUME_WITHIN_S:
                plan = former
            else:
                why = f"run {before.run_id} ended {after_s:.0f} s ago, needed {RESUME_WITHIN_S:g} s or less"
                before = None
        if why is not None:
            LOG.warning(f"a new run begins: {why}")
        self.plan, self.most = plan, (0, plan.start_s)
        if before is not None:
            self.run_id, point = before.run_id, before.point
            store.resume_run(
                self.store,
                self.run_id,
                title=scenario.title,
                version=version(),
                settings=settings,
                workers=workers,
                by_server=live is not None,
            )
            if before.said is not None:
                LOG.warning(before.said)
        else:
            self.run_id = store.begin_run(
                self.store,
                scenario=scenario.name,
                title=scenario.title,
                seed=self.seed,
                version=version(),
                settings=settings,
                sensors=self.sensors,
                plan=plan,
                warmup_cycles=scenario.warmup_cycles,
                workers=workers,
                feeds=self.recording.feeds,
                by_server=live is not None,
            )
            point = Point(0, start_run(scenario, self.sensors), Tally())
        if live is not None:
            live.begun(self.run_id, point)
            self.zones = WatchedZones(self.store, scenario, live.refuse_zones)
        return point

    def writing(self) -> AbstractContextManager[CycleWriter]:
        """What takes the cycles to be stored."""

        def write(record: CycleRecord) -> Written:
            return store.write_cycle(self.store, self.run_id, record, self.scenario.store)

        if (live := self.live) is not None:

            def write_and_read(record: CycleRecord) -> Written:
                written = write(record)
                live.read_acknowledged(self.store, self.run_id)
                return written

            def idle() -> None:
                store.note_running(self.store, self.run_id)
                live.read_acknowledged(self.store, self.run_id)

            return live.writer(self.run_id, self.watch, write_and_read, idle)
        return BatchWriter(self.watch, self.scenario.store.overlap and self.store.shared, write)

    def lost_workers(self) -> Iterator[Fault]:
        """The workers that were lost and replaced."""
        if lost := self.workers.lost():
            where = f"workers.method = {self.scenario.workers.method}"
            yield Fault("worker lost and replaced, its work computed again", lost, where, "")

    def cycles(self, point: Point, report: Progress, on_cycle: OnCycle | None) -> Point:
        """Run from a point to the end, or to the end of the cycle in progress after a stop, with a checkpoint. Returns: the point then."""
        stopped = self.stop.is_set()
        while point.cycle < self.plan.cycles and not stopped:
            number = point.cycle
            if self.live is not None and number:  # a later cycle if the run is behind, so that the picture is of now
                behind = self.live.behind(self.plan.instant_s(number))
                number += min(behind, MOST_MERGED, self.plan.cycles - 1 - number)
            began_s = time.monotonic()
            if not self.source.wait(self.plan.instant_s(number), self.stop):
                if point.cycle and self.schedule.newest != point.cycle - 1:
                    blob = self.saved(point)
                    self.writer.later(partial(store.write_checkpoint, self.store, self.run_id, point.cycle - 1, blob))
                break
            point, cycle, warning, stopped = self.cycle(point, number, time.monotonic() - began_s)
            self.vessels = len(cycle.picture)
            self.most = max(self.most, (self.vessels, cycle.time_s), key=lambda one: one[0])
            if on_cycle is not None:
                on_cycle(cycle)
            report(point.cycle, self.plan.cycles, f"{self.vessels} vessels" + (f"; {warning}" if warning else ""))
            del cycle  # else two cycles are in memory at a time
        return point

    def saved(self, point: Point) -> bytes:
        """The checkpoint of a point."""
        return checkpoint.save(replace(point, memory=gathered(point.memory, self.workers.regions)))

    def cycle(self, point: Point, number: int, waited_s: float) -> tuple[Point, Cycle, str | None, bool]:
        """One cycle: reports, pipeline, scores, store.

        Args: number: of the cycle; those from the point's to this one are merged in it; waited_s: for its reports.
        Returns: the point after it, its yield, a warning of the store, and whether it is the last because of a stop.
        """
        plan, first, watch = self.plan, point.cycle, self.watch
        if number == 0:
            reports = self.recording.of_first_cycle(plan.start_s, plan.instant_s(0))
        else:
            reports = self.recording.reports.between(plan.instant_s(first - 1), plan.instant_s(number))
        memory, cycle = run_cycle(
            self.scenario,
            self.sensors,
            point.memory,
            reports,
            plan.instant_s(number),
            self.workers.spots,
            watch,
            self.workers.regions,
            zones=None if self.zones is None else self.zones.now(),
        )
        for_centres = ForCentres()
        self.plots.note(cycle, self.sensors)
        if self.live is not None:
            video = true_video(self.sensors.radars, memory.headings.headings, reports.video)
            of_all = replace(reports, video=video)
            done = Computed(self.run_id, number, number - first, cycle, of_all, watch.so_far(), waited_s)
            for_centres = self.live.computed(done)
        tally = point.tally
        if number >= self.scenario.warmup_cycles and self.recording.truth is not None:
            with watch("scores"):
                tally = add(tally, cycle, self.recording, self.sensors)
        after = Point(number + 1, memory, tally)
        stopped = self.stop.is_set()  # read once: the last cycle has a checkpoint
        blob = None
        with watch("checkpoint"):
            if stopped or self.schedule.is_due(number, self.writer.is_idle):
                begun_s = time.perf_counter()
                blob = self.saved(after)
                self.schedule.note(number, len(blob), time.perf_counter() - begun_s)
        warning = self.writer.wait_for_room()
        counts = (
            store.cycle_counts(cycle, reports) if number > first else {}
        )  # those of the cycle stand for what is merged in it
        record = CycleRecord(
            number,
            cycle.to_write(),
            reports,
            watch.so_far(),
            blob,
            last=after.cycle == plan.cycles or stopped,
            for_centres=for_centres,
            merged=tuple(SkippedCycle(one, plan.instant_s(one), "merged", counts) for one in range(first, number)),
            video=self.plots.stored(self.source.feeds(), self.sensors),
        )
        self.writer.put(record)
        watch.lap()
        return after, cycle, warning, stopped
