"""Runs a scenario from its first report to the stored picture: clock, workers, signals, checkpoints and the store."""

from __future__ import annotations

import importlib.metadata
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

from coastwatch import store
from coastwatch.batches import Fault, FileContent, Recording, Reports, Sensors
from coastwatch.centre import Cycle
from coastwatch.cycle import dropped, gathered, run_cycle, start_run
from coastwatch.formats.intake.accounts import losses
from coastwatch.scenario import Scenario
from coastwatch.scores import add, result, start
from coastwatch.server import checkpoint
from coastwatch.server.checkpoint import CheckpointError, Pace, Point
from coastwatch.server.timing import Stopwatch
from coastwatch.server.warm_up import warm_up
from coastwatch.server.watched_zones import WatchedZones
from coastwatch.server.writer import BEHIND, BatchWriter, CycleWriter, Writer
from coastwatch.stage import Plan
from coastwatch.store import CycleRecord, SkippedCycle, Written
from coastwatch.workers import Workers, open_workers, processors

DEFAULT_DATABASE = "sqlite:///coastwatch.db"
Progress = Callable[[int, int, str], None]
OnCycle = Callable[[Cycle], None]
OnInput = Callable[[tuple[FileContent, ...], tuple[Fault, ...]], None]

RESUME_WITHIN_S = 600.0
"""A live run goes on from its checkpoint if that is at most so old: the cycles since then are computed without reports."""

MOST_MERGED = 10
"""Cycles that are merged in the next one at most: a filter that is asked for too long a span predicts too far."""


class Live(Protocol):
    """Input that comes as time passes, and who is given each cycle."""

    stop: threading.Event  # ends the run after the cycle in progress

    def begin(
        self, scenario: Scenario, sensors: Sensors, seed: int, positions: Mapping[str, tuple[str, int]]
    ) -> tuple[Recording, Plan]:
        """The input and the instants from now on; it may wait for the first report.

        Args: positions: of each region, its run and the last cycle that the run to be resumed has used.
        """
        ...

    def begun(self, run_id: int, point: Point) -> None:
        """The run has its number. Args: point: from which it goes on."""
        ...

    def behind(self, until_s: float) -> int:
        """How many periods later than a cycle that ends at an instant another one could be computed already. 0: it is in time."""
        ...

    def wait(self, until_s: float) -> bool:
        """Wait until all reports up to an instant have come. Returns: False: `stop` was set before."""
        ...

    def computed(self, run_id: int, number: int, cycle: Cycle, reports: Reports, seconds: dict[str, float]) -> None:
        """Take a cycle. Args: reports: of the cycle; seconds: of its stages."""
        ...

    def refuse_zones(self, refused: Sequence[tuple[str, str]]) -> None:
        """Take the names of the zones in the database that cannot be watched, each with the reason."""
        ...

    def for_centres(self, run_id: int, number: int, cycle: Cycle) -> store.ForCentres:
        """What is stored of this cycle for other centres."""
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
        resume: continue the newest unfinished run of this scenario, seed and version from its last checkpoint, if there is one.
        restart: delete earlier runs of this scenario and seed first.
        progress: called with cycles done, cycles in all and a short text. on_cycle: called with each cycle, before it is stored.
        on_input: called with what the recorded files hold and with their faults, as far as both are known before the first cycle:
            of tables, not of streams.
        live: takes the place of the scenario's input and start; its `stop` takes the place of signals.
    Raises: StoreError, OSError, ValueError: errors that the caller can repair; the message says how.
    """
    started = time.perf_counter()
    seed = scenario.seed if seed is None else seed
    count = scenario.workers.count if workers is None else workers
    database = database or DEFAULT_DATABASE
    report = progress or (lambda done, total, text: None)
    report(0, 1, "reading input")
    sensors = scenario.sensors()
    if live is None:
        plan = scenario.plan()
        recording = scenario.input.load(sensors, seed, plan)
        if on_input is not None:
            on_input(recording.all_contents(), recording.faults)
    with store.open_store(database) as opened:
        if restart:
            store.discard_runs(opened, scenario.name, seed)
        watch = Stopwatch()
        with open_workers(scenario.workers.method, count) as opened_workers:
            warm_up(scenario, sensors, partial(report, 0, plan.cycles if live is None else 1), opened_workers)
            if live is not None:
                before = _resume_point(opened, scenario, seed) if resume else None
                recording, plan = live.begin(scenario, sensors, seed, _positions(opened, before))
                plan, resume = _live_plan(opened, before, plan)
            run_id, point = _begin(opened, scenario, sensors, recording, plan, seed, processors(count), resume)
            if live is not None:
                live.begun(run_id, point)
            with _interrupt_as_flag() if live is None else nullcontext(live.stop) as interrupted:
                try:
                    with _cycle_writer(live, opened, scenario, run_id, watch) as writer:
                        parts = (
                            scenario,
                            sensors,
                            recording,
                            plan,
                            opened,
                            run_id,
                            opened_workers,
                            watch,
                            writer,
                            interrupted,
                            live,
                            Pace(scenario.store, scenario.period_s) if live is not None else Pace(scenario.store),
                            None if live is None else WatchedZones(opened, scenario, live.refuse_zones),
                        )
                        point, vessels, most = _run_cycles(_Run(*parts), point, report, on_cycle)
                    memory = gathered(point.memory, opened_workers.regions)
                    scores = result(point.tally, recording, sensors)
                except BaseException:
                    faults = *recording.all_faults(), *_losses(scenario, opened_workers)
                    store.finish_run(opened, run_id, "failed", {}, faults)
                    raise
        status = "interrupted" if interrupted.is_set() and point.cycle < plan.cycles else "finished"
        unused = recording.rest(plan.instant_s(plan.cycles - 1)) if _is_of_whole_files(scenario, recording, live, status) else 0
        faults = of_input = recording.all_faults()
        if live is None:
            faults += losses(recording.all_contents(), faults, unused)
        faults = *faults, *dropped(memory, sensors), *_losses(scenario, opened_workers)
        store.finish_run(opened, run_id, status, scores, faults)
    return RunResult(
        run_id,
        scenario.name,
        seed,
        version(),
        scores,
        watch.summary(),
        database,
        faults,
        vessels,
        point.cycle,
        time.perf_counter() - started,
        status == "interrupted",
        recording.all_contents(),
        plan.instant_s(point.cycle - 1),
        *most,
        of_input,
    )


@dataclass(frozen=True)
class _Run:
    """The parts of a run that do not change from cycle to cycle."""

    scenario: Scenario
    sensors: Sensors
    recording: Recording
    plan: Plan
    store: Any
    run_id: int
    workers: Workers
    watch: Stopwatch
    writer: CycleWriter
    interrupted: threading.Event
    live: Live | None
    pace: Pace
    zones: WatchedZones | None  # none: those of the scenario


def _is_of_whole_files(scenario: Scenario, recording: Recording, live: Live | None, status: str) -> bool:
    """Whether a run has used its files to their ends: of recorded files, not cut to a number of cycles, and finished."""
    return live is None and scenario.cycles == 0 and status == "finished" and bool(recording.all_contents())


def _losses(scenario: Scenario, workers: Workers) -> Iterator[Fault]:
    """The workers that were lost and replaced."""
    if lost := workers.lost():
        yield Fault(
            "worker lost and replaced, its work computed again", lost, f"workers.method = {scenario.workers.method}", ""
        )


def _resume_point(opened: Any, scenario: Scenario, seed: int) -> tuple[int, int, bytes] | None:
    """As `store.resume_point`, of this scenario with these settings."""
    return store.resume_point(opened, scenario.name, seed, version(), scenario.model_dump(mode="json"))


def _positions(opened: Any, before: tuple[int, int, bytes] | None) -> dict[str, tuple[str, int]]:
    """The last cycle of each region that a run had used at its checkpoint."""
    return {} if before is None else store.region_positions(opened, before[0], before[1])


def _live_plan(opened: Any, found: tuple[int, int, bytes] | None, plan: Plan) -> tuple[Plan, bool]:
    """The plan of a live run and whether it is resumed: that of an unfinished run whose checkpoint is young enough, else a new one.

    A run that begins at a set instant is resumed whenever it is.
    """
    if found is None:
        return plan, False
    run_id, cycle, _ = found
    before = plan.model_copy(update={"start_s": store.run(opened, run_id)["start_s"]})
    resumed = before == plan or 0.0 <= plan.start_s - before.instant_s(cycle) <= RESUME_WITHIN_S
    return before if resumed else plan, resumed


def _begin(
    opened: Any,
    scenario: Scenario,
    sensors: Sensors,
    recording: Recording,
    plan: Plan,
    seed: int,
    workers: int,
    resume: bool,
) -> tuple[int, Point]:
    """The number of the run and its first point: a checkpoint if `resume` finds one, else the first cycle of a new run."""
    if resume:
        found = _resume_point(opened, scenario, seed)
        if found is not None:
            run_id, _, blob = found
            point = _loaded_point(blob, run_id)
            store.resume_run(opened, run_id)
            return run_id, point
    run_id = store.begin_run(
        opened,
        scenario=scenario.name,
        title=scenario.title,
        seed=seed,
        version=version(),
        settings=scenario.model_dump(mode="json"),
        sensors=sensors,
        plan=plan,
        warmup_cycles=scenario.warmup_cycles,
        workers=workers,
        feeds=recording.feeds,
    )
    return run_id, Point(0, start_run(scenario, sensors), start(sensors))


def _loaded_point(saved: bytes, run_id: int) -> Point:
    """The point that a checkpoint holds. Raises: CheckpointError: it cannot be read."""
    try:
        point = checkpoint.load(saved)
        if not isinstance(point, Point):
            raise CheckpointError(f"it holds a {type(point).__name__}")
    except CheckpointError as error:
        raise CheckpointError(f"run {run_id}: its checkpoint cannot be read: {error}; --restart begins again") from error
    return point


def _run_cycles(run: _Run, point: Point, report: Progress, on_cycle: OnCycle | None) -> tuple[Point, int, tuple[int, float]]:
    """Run from a point to the end, or to the end of the cycle in progress after an interrupt, with a checkpoint.

    Returns: the point after it; the vessels of the last picture; the most vessels of a picture, and its time.
    """
    vessels, most, stopped = 0, (0, run.plan.start_s), run.interrupted.is_set()
    while point.cycle < run.plan.cycles and not stopped:
        number = _next_cycle(run, point)
        if run.live is not None and not run.live.wait(run.plan.instant_s(number)):
            _save(run, point)
            break
        point, cycle, warning, stopped = _run_cycle(run, point, number)
        vessels = len(cycle.picture)
        most = max(most, (vessels, cycle.time_s), key=lambda found: found[0])
        if on_cycle is not None:
            on_cycle(cycle)
        report(point.cycle, run.plan.cycles, f"{vessels} vessels" + (f"; {warning}" if warning else ""))
        del cycle  # else two cycles are in memory at a time
    return point, vessels, most


def _next_cycle(run: _Run, point: Point) -> int:
    """The number of the next cycle: a later one where a live run is behind, so that the picture is of now. Cycles before it are merged."""
    if run.live is None or point.cycle == 0:
        return point.cycle
    merged = min(run.live.behind(run.plan.instant_s(point.cycle)), MOST_MERGED, run.plan.cycles - 1 - point.cycle)
    return point.cycle + merged


def _run_cycle(run: _Run, point: Point, number: int) -> tuple[Point, Cycle, str | None, bool]:
    """One cycle: reports, pipeline, scores, store. Args: number: of the cycle; those from the point's to this one are merged in it.

    Returns: the point after it, its yield, a warning of the store, and whether it is the last because of an interrupt.
    """
    scenario, plan = run.scenario, run.plan
    if number == 0:
        reports = run.recording.of_first_cycle(plan.start_s, plan.instant_s(0))
    else:
        reports = run.recording.reports.between(plan.instant_s(point.cycle - 1), plan.instant_s(number))
    spots, regions = run.workers.spots, run.workers.regions
    given = scenario, run.sensors, point.memory, reports, plan.instant_s(number), spots, run.watch, regions
    memory, cycle = run_cycle(*given, zones=None if run.zones is None else run.zones.now())
    if run.live is not None:
        run.live.computed(run.run_id, number, cycle, reports, run.watch.so_far())
    tally = point.tally
    if number >= scenario.warmup_cycles and run.recording.truth is not None:
        with run.watch("scores"):
            tally = add(tally, cycle, run.recording, run.sensors)
    after = Point(number + 1, memory, tally)
    stopped = run.interrupted.is_set()  # read once: the last cycle has a checkpoint
    blob = None
    with run.watch("checkpoint"):
        if stopped or run.pace.is_due(number, run.writer.is_idle):
            begun_s = time.perf_counter()
            blob = checkpoint.save(replace(after, memory=gathered(memory, regions)))
            run.pace.note(number, len(blob), time.perf_counter() - begun_s)
    for_centres = store.ForCentres() if run.live is None else run.live.for_centres(run.run_id, number, cycle)
    warning = run.writer.wait_for_room()
    record = CycleRecord(
        number,
        cycle.to_write(),
        reports,
        run.watch.so_far(),
        blob,
        last=after.cycle == plan.cycles or stopped,
        for_centres=for_centres,
        merged=_merged(plan, point.cycle, number, cycle, reports),
    )
    run.writer.put(record)
    run.watch.lap()
    return after, cycle, warning, stopped


def _merged(plan: Plan, first: int, number: int, cycle: Cycle, reports: Reports) -> tuple[SkippedCycle, ...]:
    """The cycles that are merged in one. They count what it has."""
    if first == number:
        return ()
    counts = store.cycle_counts(cycle, reports)
    return tuple(SkippedCycle(one, plan.instant_s(one), "merged", counts) for one in range(first, number))


def _save(run: _Run, point: Point) -> None:
    """Write a checkpoint of a run that ends while it waits for the reports of its next cycle, unless its last cycle has one."""
    if point.cycle and run.pace.newest != point.cycle - 1:
        blob = checkpoint.save(replace(point, memory=gathered(point.memory, run.workers.regions)))
        run.writer.later(partial(store.write_checkpoint, run.store, run.run_id, point.cycle - 1, blob))


@contextmanager
def _cycle_writer(live: Live | None, opened: Any, scenario: Scenario, run_id: int, watch: Stopwatch) -> Iterator[CycleWriter]:
    """What takes the cycles of a run to be stored."""

    def write(record: CycleRecord) -> Written:
        return store.write_cycle(opened, run_id, record, scenario.store)

    if live is not None:
        with live.writer(run_id, watch, write, partial(store.note_running, opened, run_id)) as writer:
            yield writer
        return
    with Writer[Written](watch, scenario.store.overlap and opened.shared, BEHIND) as jobs:
        yield BatchWriter(jobs, write)


@contextmanager
def _interrupt_as_flag() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets, so that a cycle is completed. A second signal raises KeyboardInterrupt."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    usual = {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)}

    def note(number: int, frame: object) -> None:
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    for s in usual:
        signal.signal(s, note)
    try:
        yield event
    finally:
        for s, handler in usual.items():
            signal.signal(s, handler)
