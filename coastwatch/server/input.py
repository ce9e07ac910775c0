"""What a run takes its reports from. `feeds.live_input` is the input of live feeds and regions."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from coastwatch.batches import Recording, Sensors
from coastwatch.scenario import Scenario
from coastwatch.sensors import SIMULATIONS
from coastwatch.server import clock
from coastwatch.server.link import FeedState
from coastwatch.stage import Plan
from coastwatch.store import Intake

Positions = Mapping[str, tuple[str, int]]
"""Of each region, its run and the number of the last cycle that is known."""


class Input(Protocol):
    """Reports of files, of a simulation or of live feeds, and when they are complete."""

    def begin(
        self, scenario: Scenario, sensors: Sensors, seed: int, stop: threading.Event, positions: Positions
    ) -> tuple[Recording, Plan]:
        """The reports and the instants from now on. It may wait for the first report.

        Args: stop: ends waiting; positions: of each region, the last cycle that the run to be resumed has used.
        """
        ...

    def due_s(self, until_s: float) -> float:
        """When, by the clock of this machine, a cycle that ends at an instant can begin to be computed: here at once."""
        return 0.0

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """Wait until all reports up to an instant have come. Returns: False: `stop` was set before."""
        ...

    def intake(self) -> Sequence[Intake]:
        """The cycles of regions in the reports of the newest cycle: here none."""
        return ()

    def feeds(self) -> Sequence[FeedState]:
        """The feeds with their counters: here none."""
        return ()


class AtOnce(Input):
    """The input of a scenario as fast as cycles are computed. It is read when this is made."""

    def __init__(self, scenario: Scenario, sensors: Sensors, seed: int) -> None:
        """Raises: OSError, ValueError: a file cannot be read."""
        self.plan = scenario.plan()
        self.recording = scenario.input.load(sensors, seed, self.plan)

    def begin(self, *unused: object) -> tuple[Recording, Plan]:
        """As of `Input`."""
        return self.recording, self.plan

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """As of `Input`: nothing is waited for, and the run looks at `stop` after each cycle."""
        return True


class Paced(Input):
    """The input of a scenario at the speed of a clock. A simulation begins now, a recording where it begins."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._origin = 0.0, 0.0  # an instant, and when it is by the clock

    def begin(
        self, scenario: Scenario, sensors: Sensors, seed: int, stop: threading.Event, positions: Positions
    ) -> tuple[Recording, Plan]:
        """As of `Input`."""
        plan = scenario.plan()
        simulated = isinstance(scenario.input, SIMULATIONS)
        if simulated:
            plan = plan.model_copy(update={"start_s": float(int(clock.now_s()))})
        recording = scenario.input.load(sensors, seed, plan)
        self._origin = plan.start_s, plan.start_s if simulated else clock.now_s()
        return replace(recording, truth=None), plan

    def due_s(self, until_s: float) -> float:
        """As of `Input`."""
        instant_s, clock_s = self._origin
        return clock_s + (until_s - instant_s) / self._speed

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """As of `Input`."""
        return not stop.wait(max(self.due_s(until_s) - clock.now_s(), 0.0))
