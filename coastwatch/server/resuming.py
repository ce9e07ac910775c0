"""With which run of a database a new one of the same scenario goes on, and why with none."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from pydantic import ValidationError

from coastwatch import store
from coastwatch.scenario.model import Scenario
from coastwatch.server.checkpoint import CheckpointError, Point, load_point
from coastwatch.store import Store

OF_NO_MEMORY = ("title", "store", "workers")
"""Settings that may change while a run goes on: they shape no memory, but for those of OF_MEMORY."""

OF_MEMORY = ("store.event_gap_s",)
"""Settings of `store` that shape the memory: the alarms of the run were ended by it."""

MOST_NAMED = 10
"""Settings that are named where too many differ."""


class Former(NamedTuple):
    """A run to go on with."""

    run_id: int
    cycle: int  # the newest one that its memory has
    point: Point
    said: str | None  # what is different now, in a sentence


def former_run(opened: Store, scenario: Scenario, seed: int, version: str, *, live: bool) -> tuple[Former | None, str | None]:
    """The newest unfinished run of a scenario and seed to go on with; else why the newest one is none, where there is one.

    Settings that shape no memory may differ. A live run also goes on with one of another version, if that memory can be read: it
    has no result to reproduce.
    Raises: StoreError; CheckpointError: one of this version cannot be read.
    """
    why = None
    for run in store.unfinished_runs(opened, scenario.name, seed):
        differs = _differences(run.settings, scenario)
        if differs or (run.version != version and not live):
            other = (
                f"is of version {run.version}, this is {version}"
                if run.version != version
                else f"had other settings: {differs}"
            )
            why = why or f"run {run.run_id} {other}"
            if live:  # an earlier one ended before this one began
                break
            continue
        saved = store.read_checkpoint(opened, run.run_id)
        try:
            point = load_point(saved, run.run_id)
        except CheckpointError as error:
            if run.version == version:
                raise
            why = why or f"run {run.run_id} is of version {run.version}, this is {version}: {error}"
            break  # the run is live, as above
        said = (
            None if run.version == version else f"run {run.run_id} goes on: it was of version {run.version}, this is {version}"
        )
        return Former(run.run_id, run.cycle, point, said), None
    return None, why


def _differences(stored: Mapping[str, object], scenario: Scenario) -> str:
    """The settings that shape the memory and are not those of a stored run; empty: none.

    What the stored run could not set, as it is newer, is taken as its default.
    """
    try:
        before = Scenario.model_validate(stored).model_dump(mode="json")
    except ValidationError:  # it has settings that are no more
        before = dict(stored)
    old, new = (dict(_leaves(settings)) for settings in (before, json.loads(scenario.model_dump_json())))
    names = [name for name in sorted(old.keys() | new.keys()) if old.get(name) != new.get(name)]
    names = [name for name in names if name in OF_MEMORY or name.partition(".")[0] not in OF_NO_MEMORY]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def _leaves(settings: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Each value of some settings that is no table, with its path."""
    if not isinstance(settings, Mapping):
        yield path, settings
        return
    for key, value in settings.items():
        yield from _leaves(value, f"{path}.{key}" if path else key)
