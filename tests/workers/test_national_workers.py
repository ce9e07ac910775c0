"""The whole centre over a national picture: every bit is the same however the work is spread, and into however many spots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from functools import cache

import numpy as np
import pytest

from coastwatch.batches import Batch, Sensors
from coastwatch.centre import Cycle, Received, run_centre, start_centre
from coastwatch.kernels import threads
from coastwatch.server.timing import Stopwatch
from coastwatch.workers import open_workers
from scaling.load import national

pytestmark = pytest.mark.contract

TRACKS, CYCLES, SEED = 2000, 8, 3
LEAST = 64
"""Rows a thread at least, in place of up to 4096: so few tracks would else be the work of one thread."""

SPREAD = [
    ("threads", 4, 60),
    ("processes", 1, 1),
    ("processes", 3, 7),
]
"""Method, workers, spots; 0: as many as by default. All are held against one thread and the default."""


@pytest.fixture(autouse=True)
def _blocks_of_few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = threads.blocks
    monkeypatch.setattr(threads, "blocks", lambda count, least: plain(count, min(least, LEAST)))


@cache
def load() -> tuple[national.World, Sensors, list[Received]]:
    """A world and what its centre receives."""
    world = national.build_world(TRACKS, SEED)
    sensors, state, out = national.scenario_of(world, {}).sensors(), national.initial_state(world), []
    for _ in range(CYCLES):
        state, received = national.next_cycle(world, state, sensors)
        out.append(received)
    return world, sensors, out


def cycles(method: str, count: int, spots: int) -> Iterator[Cycle]:
    world, sensors, received = load()
    scenario = national.scenario_of(world, {"spots.count": str(spots)})
    memory, watch = start_centre(scenario), Stopwatch()
    with open_workers(method, count) as workers:
        for number in range(CYCLES):
            memory, cycle = run_centre(scenario, sensors, memory, received[number], world.time_s(number), workers.spots, watch)
            yield cycle


def told(cycle: Cycle) -> dict[str, bytes]:
    """Every column of what an operator can see of a cycle."""
    batches: dict[str, Batch] = {
        "picture": cycle.picture,
        "members": cycle.members,
        "associations": cycle.associations,
        "bearing_associations": cycle.bearing_associations,
    }
    return {
        f"{name}.{field.name}": np.ascontiguousarray(getattr(batch, field.name)).tobytes()
        for name, batch in batches.items()
        for field in fields(batch)
    }


@cache
def alone() -> list[dict[str, bytes]]:
    """Each cycle as one thread makes it."""
    made = list(cycles("threads", 1, 0))
    assert len(made[-1].tracks) > 0.8 * TRACKS
    assert len(made[-1].spots.centre_m) not in (1, 60)
    assert len(made[-1].associations.first) > 500
    assert len(made[-1].bearing_associations.bearing_row) > 20
    return [told(cycle) for cycle in made]


def same(method: str, count: int, spots: int) -> None:
    number = -1
    for number, (cycle, wanted) in enumerate(zip(cycles(method, count, spots), alone(), strict=True)):
        got = told(cycle)
        assert [name for name in wanted if got[name] != wanted[name]] == [], f"cycle {number}"
    assert number == CYCLES - 1


@pytest.mark.parametrize(("method", "count", "spots"), SPREAD)
def test_the_picture_is_the_same_to_the_bit(method: str, count: int, spots: int) -> None:
    same(method, count, spots)
