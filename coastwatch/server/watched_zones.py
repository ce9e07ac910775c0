"""The zones that a live run watches: those of its scenario file, and those that were drawn or sent since."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from pydantic import ValidationError

from coastwatch import store
from coastwatch.alarms import Numbered, Zone, numbered
from coastwatch.errors import StoreError
from coastwatch.scenario import Scenario
from coastwatch.scenario.refusing import refusals
from coastwatch.store import Store, StoredZone

WAIT_S = 0.5
Refused = tuple[str, str]
"""The name of a zone, and why this version does not take it."""


class WatchedZones:
    """The zones of a scenario as they are now. They are read again when one was changed."""

    def __init__(
        self, opened: Store, scenario: Scenario, refuse: Callable[[Sequence[Refused]], None] = lambda refused: None
    ) -> None:
        """Args: refuse: told which zones of the database are not watched, whenever they are read."""
        self._store, self._scenario, self._refuse = opened, scenario, refuse
        self._version, self._zones = -1, numbered(scenario.zones)
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="zones") if opened.shared else None
        self._reading: Future[None] | None = None

    def now(self) -> tuple[Numbered, ...]:
        """The zones with their numbers. While the database is away or slow they stay as they were: the cycle waits for `WAIT_S`."""
        if self._reader is None:  # a database in memory is that of its thread
            self._read_stored()
            return self._zones
        if self._reading is None or self._reading.done():
            self._reading = self._reader.submit(self._read_stored)
        with suppress(TimeoutError):
            self._reading.result(WAIT_S)
        return self._zones

    def _read_stored(self) -> None:
        """Read the zones if one was changed."""
        with suppress(StoreError):
            version = store.zone_version(self._store, self._scenario.name)
            if version != self._version:
                drawn, refused = readable(store.zones(self._store, self._scenario.name))
                self._zones = *numbered(self._scenario.zones), *drawn
                self._version = version
                self._refuse(refused)


def readable(stored: Sequence[StoredZone]) -> tuple[list[Numbered], list[Refused]]:
    """The stored zones with their numbers, and those that this version refuses: another version may have stored them."""
    drawn: list[Numbered] = []
    refused: list[Refused] = []
    for one in stored:
        try:
            drawn.append((one.number, Zone.model_validate(one.definition)))
        except ValidationError as error:
            refusal = f"zone {one.number} is not watched: {'; '.join(refusals(error, Zone))}"
            refused.append((str(one.definition.get("name", one.number)), refusal))
    return drawn, refused
