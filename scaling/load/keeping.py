"""The store of a load run: every cycle written as the server writes it, rows counted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from coastwatch import store
from coastwatch.batches import AisReports, AisStatics, BearingReports, RadarReports, Reports, Sensors
from coastwatch.pipeline import Cycle
from coastwatch.scenario import Scenario
from coastwatch.server.run import version
from coastwatch.stage import Plan

STOPPED = (KeyboardInterrupt, GeneratorExit)
"""By Ctrl-C, while a cycle was made and while it was said; a run that could not go on is `failed`."""


class Keeper:
    """A run in a database; use it in a `with` block."""

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
        """Whether it can be written by a thread of its own."""
        return self._store.shared

    def __enter__(self) -> Keeper:
        return self

    def __exit__(self, *failed: Any) -> None:
        stopped = isinstance(failed[1], STOPPED)
        try:
            store.finish_run(self._store, self._run_id, "interrupted" if stopped else "failed" if failed[0] else "finished")
        finally:
            self._store.close()

    def write(self, number: int, cycle: Cycle, statics: AisStatics, seconds: Mapping[str, float]) -> store.Written:
        """One cycle; what the store says of it. Args: seconds: of each of its stages."""
        reports = Reports(RadarReports.empty(), AisReports.empty(), statics, BearingReports.empty())
        return store.write_cycle(self._store, self._run_id, number, cycle, reports, seconds, self._scenario.store)
