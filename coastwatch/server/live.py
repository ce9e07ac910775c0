"""A run of a server: a thread that computes cycles as time passes and hands over each picture."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, Self

from coastwatch import store
from coastwatch.batches import Fault, Recording, Reports, Sensors
from coastwatch.pipeline import Cycle
from coastwatch.scenario import Scenario
from coastwatch.server.live_picture import LivePicture, Statics, merge_statics, of_cycle, of_store
from coastwatch.server.regions.publisher import Publisher
from coastwatch.server.run import run_scenario
from coastwatch.stage import Plan
from coastwatch.store import Intake

OnPicture = Callable[[LivePicture], None]
Positions = Mapping[str, tuple[str, int]]
"""Of each region, its run and the number of the last cycle that is known."""


class Input(Protocol):
    """What a live run takes its reports from."""

    def begin(
        self, scenario: Scenario, sensors: Sensors, seed: int, stop: threading.Event, positions: Positions
    ) -> tuple[Recording, Plan]:
        """The reports and the instants from now on. Args: positions: of each region, the last cycle that is known."""
        ...

    def intake(self) -> Sequence[Intake]:
        """The cycles of regions in the reports of the newest cycle."""
        ...

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """Wait until all reports up to an instant have come. Returns: False: `stop` was set before."""
        ...

    def due_s(self, until_s: float) -> float:
        """When, by the clock of this machine, a cycle that ends at an instant can begin to be computed."""
        ...

    def feeds(self) -> list[dict[str, Any]]:
        """The feeds with their counters."""
        ...


class Paced:
    """The input of a scenario at the speed of a clock. A simulation begins now, a recording where it begins."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._origin = 0.0, 0.0  # an instant, and when it is by the clock

    def begin(
        self, scenario: Scenario, sensors: Sensors, seed: int, stop: threading.Event, positions: Positions
    ) -> tuple[Recording, Plan]:
        """As of `Input`."""
        plan = scenario.plan()
        simulated = scenario.input.method in ("simulated", "crossing")
        if simulated:
            plan = plan.model_copy(update={"start_s": float(int(time.time()))})
        recording = scenario.input.load(sensors, seed, plan)
        self._origin = plan.start_s, plan.start_s if simulated else time.time()
        return replace(recording, truth=None), plan

    def intake(self) -> Sequence[Intake]:
        """As of `Input`: it has no regions."""
        return ()

    def due_s(self, until_s: float) -> float:
        """As of `Input`."""
        instant_s, clock_s = self._origin
        return clock_s + (until_s - instant_s) / self._speed

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """As of `Input`."""
        return not stop.wait(max(self.due_s(until_s) - time.time(), 0.0))

    def feeds(self) -> list[dict[str, Any]]:
        """As of `Input`: it has none."""
        return []


class LiveRun:
    """Runs a scenario in a thread until it is closed. Use it in a `with` block, which ends after a whole cycle with a checkpoint."""

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
    ) -> None:
        """Args: resume: go on with the last run of this scenario, if it ended a short time ago; publisher: of a region's tracks."""
        self.stop = threading.Event()
        self.seconds: dict[str, float] = {}  # of the stages of the last cycle
        self.late_s = 0.0  # how long after it was due the last picture was ready
        self.cycles = self.cycles_late = 0
        self.faults: tuple[Fault, ...] = ()
        self.failed = False
        self._source, self._on_picture, self._statics = source, on_picture, Statics()
        self._publisher = publisher
        self._scenario = scenario
        self._given: dict[str, Any] = {"database": database, "workers": workers, "resume": resume}
        self._said: str | None = "starting"
        self._sensors: Sensors | None = None
        self._begun = False
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
        return self._said

    def feeds(self) -> list[dict[str, Any]]:
        """The feeds with their counters."""
        return self._source.feeds()

    def cycle_s(self) -> float | None:
        """How long the stages of the last cycle took together."""
        return sum(self.seconds.values()) if self.seconds else None

    def counts(self) -> dict[str, float]:
        """Cycles computed, how many of them more than a period late, and how late the last one was."""
        return {"cycles": self.cycles, "cycles_late": self.cycles_late, "late_s": self.late_s}

    def begin(self, scenario: Scenario, sensors: Sensors, seed: int, positions: Positions) -> tuple[Recording, Plan]:
        """As `run.Live.begin`."""
        self._begun = True
        if self.stop.is_set():
            raise InterruptedError("stopped before the first cycle")
        self._said, self._sensors = "waiting for the first cycle", sensors
        return self._source.begin(scenario, sensors, seed, self.stop, positions)

    def wait(self, until_s: float) -> bool:
        """As `run.Live.wait`."""
        return self._source.wait(until_s, self.stop)

    def computed(self, run_id: int, number: int, cycle: Cycle, reports: Reports, seconds: dict[str, float]) -> None:
        """As `run.Live.computed`."""
        assert self._sensors is not None
        if number and not self.cycles:
            self._statics = self._stored_statics(run_id)
        merge_statics(self._statics, reports.statics)
        self.seconds, self._said = seconds, None
        self._on_picture(of_cycle(run_id, number, cycle, self._sensors, self._statics))
        self.late_s = time.time() - self._source.due_s(cycle.time_s)
        self.cycles += 1
        self.cycles_late += self.late_s > self._scenario.period_s

    def for_centres(self, run_id: int, number: int, cycle: Cycle) -> store.ForCentres:
        """As `run.Live.for_centres`."""
        assert self._sensors is not None
        message = None
        if self._publisher is not None:
            message = self._publisher.message(run_id, number, cycle, self._sensors)
        return store.ForCentres(message, self._source.intake())

    def written(self, run_id: int, number: int, passed: store.ForCentres) -> None:
        """As `run.Live.written`."""
        if self._publisher is not None and passed.message is not None:
            self._publisher.written(run_id, number, passed.message)

    def _stored_statics(self, run_id: int) -> Statics:
        """The names of a run that is resumed."""
        with store.open_store(self._given["database"], create=False) as opened:
            newest = store.newest_picture(opened, run_id)
            return {} if newest is None else of_store(opened, *newest).statics

    def _run(self) -> None:
        def progress(done: int, total: int, text: str) -> None:
            if not done:
                self._said = text

        try:
            result = run_scenario(self._scenario, live=self, progress=progress, **self._given)
            self.faults = result.faults
            self._said = None if self.stop.is_set() else "the run has ended: its input has no more reports"
        except Exception as error:  # of any part: the server says so and goes on answering
            self.failed = not self.stop.is_set()
            self._said = f"the run has failed: {error}"
