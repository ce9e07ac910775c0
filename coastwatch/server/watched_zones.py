"""The zones that a live run watches: those of its scenario file, and those that were drawn or sent since."""

from __future__ import annotations

from contextlib import suppress

from coastwatch import store
from coastwatch.alarms import Numbered, Zone, numbered
from coastwatch.scenario import Scenario
from coastwatch.store import Store, StoreError


class WatchedZones:
    """The zones of a scenario as they are now. They are read again when one was changed."""

    def __init__(self, opened: Store, scenario: Scenario) -> None:
        self._store, self._scenario = opened, scenario
        self._version, self._zones = -1, numbered(scenario.zones)

    def now(self) -> tuple[Numbered, ...]:
        """The zones with their numbers. While the database is away they stay as they were."""
        with suppress(StoreError):
            version = store.zone_version(self._store, self._scenario.name)
            if version != self._version:
                self._zones, self._version = zones_of(self._store, self._scenario), version
        return self._zones


def zones_of(opened: Store, scenario: Scenario) -> tuple[Numbered, ...]:
    """The zones of a scenario file, then those in the database. Raises: StoreError."""
    stored = store.zones(opened, scenario.name)
    return *numbered(scenario.zones), *((zone.number, Zone.model_validate(zone.definition)) for zone in stored)
