"""A run of a server: a thread that computes cycles as time passes and hands over each picture."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Self, TypeVar

from coastwatch import store
from coastwatch.batches import Fault, Sensors, Videos
from coastwatch.cycle import LEFT_OUT
from coastwatch.errors import StoreError
from coastwatch.scenario import Scenario
from coastwatch.server import clock
from coastwatch.server.alarm_book import MOST_ENDED, Alarm, AlarmBook, known_of
from coastwatch.server.checkpoint import CheckpointError, Point
from coastwatch.server.input import Input
from coastwatch.server.link import Backoff, FeedState
from coastwatch.server.live_picture import LivePicture, Statics, merge_statics, of_cycle, stored_statics, without_absent
from coastwatch.server.regions.publisher import Publisher
from coastwatch.server.run import Computed, run_scenario
from coastwatch.server.timing import Stopwatch
from coastwatch.server.troubles import Trouble, of_feeds
from coastwatch.server.video_health import PlotsOfVideo
from coastwatch.server.writing.live_writer import LiveWriter, WriterState
from coastwatch.store import CycleRecord, ForCentres, NoSuchRunError, Store, Written

LOG = logging.getLogger("coastwatch.serve")
OnPicture = Callable[[LivePicture], None]
T = TypeVar("T")


@dataclass(frozen=True)
class RunAbout:
    """What does not change in a run."""

    scenario: str
    title: str
    period_s: float
    area: dict[str, Any] | None


class NotRunning(StoreError):
    """There is no run that could write a change."""


MOST_RESTARTS, RESTARTS_WITHIN_S = 5, 600.0
"""A run that fails is begun again from its checkpoint. One that fails more often in so long ends the process."""

RESTART = Backoff(1.0, 30.0)
FORGET_EVERY_S = 60.0
"""So often alarms that ended long ago are dropped from memory, before the database deletes them: none can be acknowledged then."""

SHOWN_S = 600.0
"""For how long after it a restart is shown as a trouble."""

CROWD_SHOWN_S = 60.0
"""For how long after it a cycle that left pairs or bearings out is shown as a trouble."""

REPAIRABLE = (ValueError, OSError, StoreError)
"""Errors of a run that the caller can repair: before its first cycle they end it."""

FAILED_SHOWN_S = 60.0
"""For how long after it a write that failed is shown as a trouble: one that succeeds again at once would not be seen."""

MOST_BEHIND = 20
"""Cycles that may wait for a database that works before it is called slow."""

MERGED_AFTER = 2.0
"""Periods that a cycle may be behind before it may be merged with the next ones."""

CAUGHT_UP_S = 30.0
"""Cycles are merged where computing each of them would leave the picture behind for longer."""

MOST_MERGES = 1000
"""Cycles with others merged in them that are remembered, to say for SHOWN_S how many there were."""

REPEATED_S = 300.0
"""Before a restart: changes of alarms of that time are sent to web hooks once more."""

MOST_LEFT = 5
"""Runs whose alarms without an acknowledgement are said, since the process began."""

MOST_STATICS = 200_000
"""Vessels whose names are kept; those of vessels that are not in the picture go first."""


KINDS_OF_LEFT_OUT = {"azimuths": "feed"}
"""The kind of trouble by stage, where what it left out is not of a crowd."""


class LiveRun:
    """Runs a scenario in a thread until it is closed. Use it in a `with` block, which ends after a whole cycle with a checkpoint.

    A cycle that fails does not end it: it is begun again from its checkpoint, and as a new run where that fails in its first cycle.
    """

    live = True

    def __init__(
        self,
        scenario: Scenario,
        source: Input,
        on_picture: OnPicture,
        *,
        database: str,
        workers: int | None = None,
        resume: bool = True,
        publisher: Publisher | None = None,
        on_video: Callable[[Videos], None] | None = None,
        restart: Backoff = RESTART,
    ) -> None:
        """Args: resume: go on with the last run of this scenario, if it ended a short time ago; publisher: of a region's tracks;
        on_video: is given the radar video of each cycle.
        """
        self.stop = threading.Event()
        self.scenario = scenario.model_copy(update={"store": scenario.store.of_live_run()})
        self.alarms = AlarmBook()
        self.seconds: dict[str, float] = {}  # of the stages of the last cycle
        self.late_s = 0.0  # how long after it was due the last picture was ready
        self.cycles = self.cycles_late = self.cycles_merged = self.restarts = 0
        self.faults: tuple[Fault, ...] = ()
        self.failed = False
        self.on_failed: Callable[[], None] = lambda: None  # called in the thread of the run when it has failed for good
        self.source, self._on_picture, self._statics = source, on_picture, Statics()
        self._publisher, self._on_video = publisher, on_video
        self._resume, self._restart = resume, restart
        self._database, self._workers = database, workers
        self._status: str | None = "starting"
        self._refused_zones: tuple[tuple[str, str], ...] = ()  # name, and why it is not watched
        self._sensors: Sensors | None = None
        self.plots = PlotsOfVideo()
        self._writer: LiveWriter | None = None
        self._takes_no_changes = False  # the thread of the run ends
        self._next_writer = threading.Lock()  # while one takes over from the one before
        self._left: deque[Trouble] = deque(maxlen=MOST_LEFT)  # alarms of earlier runs that nobody acknowledged
        self._acknowledged = store.Seen()  # by any server on the database
        self._forgot_s = -math.inf  # time of the cycle in which alarms were last dropped from memory
        self._begun = False
        self._cycles_before = 0  # when this attempt began
        self._left_out: dict[str, tuple[int, float]] = {}  # by stage: as of Cycle, and the time of the last cycle with any
        self._failures: list[tuple[float, str]] = []  # Unix time and text of each, the newest last
        self._defects: list[float] = []  # when those were that count: neither a set clock nor a database that is away
        self._catches_up = False  # the reports of the last cycle had come before it was asked for
        self._computed_s, self._spacing_s = math.inf, 0.0  # monotonic time of the last cycle, and how long after the one before
        self._merges: deque[tuple[float, int]] = deque(maxlen=MOST_MERGES)  # Unix time and cycles of each
        self._reached = False  # whether this attempt has come to its first cycle
        self._thread = threading.Thread(target=self._run, name="cycles", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self.stop.set()
        if self._begun:  # before, kernels are compiled for minutes, and nothing is stored
            self._thread.join()

    @property
    def ended(self) -> bool:
        """Whether no cycle will come any more."""
        return not self._thread.is_alive()

    def error(self) -> str | None:
        """What the run does before its first picture, or why it has ended."""
        return self._status

    def feeds(self) -> Sequence[FeedState]:
        """The feeds with their counters."""
        return self.plots.added_to(self.source.feeds())

    def cycle_s(self) -> float | None:
        """How long the stages of the last cycle took together."""
        return sum(self.seconds.values()) if self.seconds else None

    def counts(self) -> dict[str, float]:
        """Cycles computed, late, merged, how late the last one was, and what the database has not taken."""
        state = self._writer.state if self._writer else WriterState()
        return {
            "cycles": self.cycles,
            "cycles_late": self.cycles_late,
            "cycles_merged": self.cycles_merged,
            "late_s": self.late_s,
            "restarts": self.restarts,
            "store_waiting": state.waiting,
            "store_skipped": state.not_stored,
            "store_failures": state.failures,
            "store_forgotten": state.forgotten,
            "alarms_forgotten": self.alarms.forgotten,
            "log_bytes": state.log_bytes,
        }

    def troubles(self) -> list[Trouble]:
        """What an operator should know."""
        now_s, troubles = clock.now_s(), of_feeds(self.feeds(), clock.now_s())
        state = self._writer.state if self._writer else WriterState()
        failed_s = math.inf if state.failed_s is None else time.monotonic() - state.failed_s
        if state.error is not None:
            since_s = now_s - (time.monotonic() - (state.since_s or time.monotonic()))
            text = (
                f"the database cannot be written: {state.error}; {state.waiting} cycles wait, {state.not_stored} were left out"
            )
            troubles.append(Trouble("store", "", since_s, text, False))
        elif state.waiting > MOST_BEHIND:
            text = f"the database is slow: {state.waiting} cycles wait, {state.not_stored} were left out so far"
            troubles.append(Trouble("store", "", None, text, False))
        elif failed_s < FAILED_SHOWN_S:
            text = f"the database could not be written within the last minute, and can be again: {state.last_error}"
            troubles.append(Trouble("store", "", now_s - failed_s, text, False))
        if state.warning is not None:
            troubles.append(Trouble("log", "", None, state.warning, False))
        late_s = self.late_s
        if self.cycles and late_s > MERGED_AFTER * self.scenario.period_s:
            text = f"cycles take too long: the picture is {late_s:.0f} s late, {self.cycles_merged} cycles were merged"
            troubles.append(Trouble("behind", "", None, text, True))
        elif lately := [(when_s, cycles) for when_s, cycles in list(self._merges) if now_s - when_s < SHOWN_S]:
            merged = sum(cycles for _, cycles in lately)
            text = f"{merged} cycles of the last {SHOWN_S / 60.0:.0f} minutes were merged with the next ones, as the run was behind"
            troubles.append(Trouble("behind", "", lately[0][0], text, False))
        if step_s := clock.CLOCK.step_s:
            text = (
                f"the clock of this machine was set by {step_s:+.0f} s: the watch goes on by its own until it is started again"
            )
            troubles.append(Trouble("clock", "", None, text, False))
        troubles += [Trouble("zone", name, None, text, False) for name, text in self._refused_zones]
        troubles += [
            Trouble(
                KINDS_OF_LEFT_OUT.get(stage, "crowd"),
                stage,
                None,
                f"{LEFT_OUT[stage]} ({count} in the last cycle with any)",
                False,
            )
            for stage, (count, when_s) in tuple(self._left_out.items())
            if now_s - when_s < CROWD_SHOWN_S
        ]
        troubles += [
            Trouble("restart", "", when_s, f"the run was begun again after: {text}", False)
            for when_s, text in self._failures[-1:]
            if now_s - when_s < SHOWN_S
        ]
        return troubles

    def now_s(self) -> float:
        """Now, by the clock that the times of its pictures are of."""
        return clock.now_s()

    def about(self) -> RunAbout:
        """What does not change in the run."""
        scenario = self.scenario
        return RunAbout(scenario.name, scenario.title, scenario.period_s, scenario.area.model_dump(mode="json"))

    def ready(self, sensors: Sensors) -> None:
        """As of `run.Live`."""
        self._begun = True
        if self.stop.is_set():
            raise InterruptedError("stopped before the first cycle")
        self._status, self._sensors = "waiting for the first cycle", sensors

    def begun(self, run_id: int, point: Point) -> None:
        """As of `run.Live`. Names and alarms of a run that goes on come from the database, those of a new one from its cycles."""
        events, alarms = point.memory.centre.events, list[Alarm]()
        self._reached = True
        if point.cycle:
            with store.open_store(self._database, create=False) as opened:
                self._statics = stored_statics(opened, run_id, MOST_STATICS)
                alarms = known_of(store.alarms_before(opened, run_id, events.time_s, MOST_ENDED), events)
        before, left = self.alarms.run_id, len(self.alarms.alarms("unacknowledged"))
        if before == -1 and not point.cycle:  # the process before this one may have left some
            with store.open_store(self._database, create=False) as opened:
                before, left = store.left_unacknowledged(opened, run_id) or (-1, 0)
        if before not in (-1, run_id) and left:
            where = f"coastwatch query alarms --run {before}"
            try:
                with store.open_store(self._database, create=False) as opened:
                    store.run(opened, before)
            except StoreError as error:  # somebody has deleted it
                where = str(error)
            text = f"run {before} had {left} alarms that nobody acknowledged: {where}"
            LOG.warning(text)
            self._left.append(Trouble("alarms", str(before), clock.now_s(), text, False))
        is_first = before == -1 and point.cycle > 0
        self._acknowledged = store.Seen()
        self.alarms.begin(run_id, alarms, events.time_s - REPEATED_S if is_first else math.inf)

    def behind(self, until_s: float) -> int:
        """As of `run.Live`."""
        due_s = self.source.due_s(until_s)
        late_s, period_s = clock.now_s() - due_s, self.source.due_s(until_s + self.scenario.period_s) - due_s
        if late_s <= MERGED_AFTER * period_s:
            return 0
        cycle_s = self._spacing_s
        gained = 1.0 - cycle_s / period_s  # of the delay, a period
        caught_up_s = late_s / period_s * cycle_s / gained if gained > 0.0 else math.inf
        return int(late_s / period_s) if caught_up_s > CAUGHT_UP_S else 0

    def computed(self, done: Computed) -> ForCentres:
        """As of `run.Live`."""
        assert self._sensors is not None
        cycle, period_s = done.cycle, self.scenario.period_s
        self._catches_up = done.waited_s < 0.5 * period_s
        merge_statics(self._statics, done.reports.statics)
        if len(self._statics) > MOST_STATICS:
            self._statics = without_absent(self._statics, cycle.picture.mmsi)
        self.alarms.apply(cycle.events)
        if not 0.0 <= cycle.time_s - self._forgot_s < FORGET_EVERY_S:
            self._forgot_s = cycle.time_s
            self.alarms.forget_ended(cycle.time_s + FORGET_EVERY_S + period_s - self.scenario.store.event_s(period_s))
        if self._on_video is not None:
            self._on_video(done.reports.video)
        self._left_out |= {stage: (count, clock.now_s()) for stage, count in cycle.left_out.items()}
        self.seconds, self._status = done.seconds, None
        self._on_picture(of_cycle(done.run_id, done.number, cycle, self._sensors, self._statics))
        self.late_s = clock.now_s() - self.source.due_s(cycle.time_s)
        computed_s = time.monotonic()
        self._computed_s, self._spacing_s = computed_s, max(computed_s - self._computed_s, 0.0)
        self.cycles += 1
        self.note_merged(done.merged)
        self.cycles_late += self.late_s > period_s
        message = None
        if self._publisher is not None:
            message = self._publisher.message(done.run_id, done.number, cycle, self._sensors, done.merged)
        return ForCentres(message, self.source.intake())

    def refuse_zones(self, refused: Sequence[tuple[str, str]]) -> None:
        """As of `run.Live`."""
        self._refused_zones = tuple(refused)

    def read_acknowledged(self, opened: Store, run_id: int) -> None:
        """As of `run.Live`."""
        with suppress(StoreError):
            found, self._acknowledged = store.acknowledged_since(opened, run_id, self._acknowledged)
            self.alarms.take_acknowledged(run_id, found)

    def note_merged(self, cycles: int) -> None:
        """Count cycles that were merged with the next one."""
        self.cycles_merged += cycles
        if cycles:
            self._merges.append((clock.now_s(), cycles))

    @contextmanager
    def writer(
        self, run_id: int, watch: Stopwatch, write: Callable[[CycleRecord], Written], idle: Callable[[], None]
    ) -> Iterator[LiveWriter]:
        """As `run.Live.writer`."""

        def announce(record: CycleRecord) -> None:
            if self._publisher is not None and record.for_centres.message is not None:
                self._publisher.written(run_id, record.number, record.for_centres.message)

        with self._next_writer:
            writer = LiveWriter(watch, write, announce, catches_up=lambda: self._catches_up, before=self._writer, idle=idle)
            self._writer = writer
        with writer:
            yield writer

    def later(self, job: Callable[[], T]) -> Future[T]:
        """Have a change by an operator written after the cycles until now. While the run is begun again it waits for that.

        Raises: NotRunning: there is no run.
        """
        with self._next_writer:
            if self._writer is None or self._takes_no_changes or self.ended:
                raise NotRunning("there is no run that could write the change")
            return self._writer.later(job)

    def left_alarms(self) -> list[Trouble]:
        """Earlier runs of this process whose alarms are not shown any more, though nobody acknowledged them."""
        return list(self._left)

    def _run(self) -> None:
        try:
            self._attempts()
        finally:
            with self._next_writer:
                self._takes_no_changes = True
            if self._writer is not None:
                self._writer.end_changes(NotRunning("the run has ended before the change could be written"))

    def _attempts(self) -> None:
        def progress(done: int, total: int, text: str) -> None:
            if not done and not self.cycles:
                self._status = text

        resume = self._resume
        while not self.stop.is_set():
            self._cycles_before, self._reached = self.cycles, False
            try:
                self.faults = run_scenario(
                    self.scenario,
                    workers=self._workers,
                    database=self._database,
                    resume=resume,
                    progress=progress,
                    live=self,
                ).faults
                self._status = None if self.stop.is_set() else "the run has ended: its input has no more reports"
                return
            except Exception as error:  # of any part: the run is begun again, and the server goes on answering
                if not self._goes_on(error):
                    return
                if isinstance(error, NoSuchRunError):
                    resume = False  # somebody has deleted the run: a new one begins
                elif self.cycles > self._cycles_before:
                    resume = True
                elif self._reached or isinstance(error, CheckpointError):
                    resume = False  # a checkpoint that fails in its first cycle, or cannot be read, is left
            self.stop.wait(self._restart.wait_s(self.restarts))

    def _goes_on(self, error: Exception) -> bool:
        """Note a failure. Returns: whether the run is begun again."""
        if self.stop.is_set() and not isinstance(error, StoreError):
            return False
        now_s, text = clock.now_s(), str(error) or type(error).__name__
        self._failures = [one for one in self._failures if now_s - one[0] < RESTARTS_WITHIN_S] + [(now_s, text)]
        never_began = not self.cycles and isinstance(error, REPAIRABLE) and not isinstance(error, CheckpointError)
        waits = self.cycles == self._cycles_before and isinstance(error, StoreError)  # for a database that is away
        self._defects = [when_s for when_s in self._defects if now_s - when_s < RESTARTS_WITHIN_S]
        self._defects += [] if waits or isinstance(error, clock.ClockSet) else [now_s]
        if self.stop.is_set() or never_began or len(self._defects) > MOST_RESTARTS:
            self.failed, self._status = True, f"the run has failed: {text}"
            LOG.error(self._status, exc_info=None if never_began else error)
            self.on_failed()
            return False
        self.restarts += 1
        LOG.error(f"the run is begun again after: {text}", exc_info=error)
        return True
