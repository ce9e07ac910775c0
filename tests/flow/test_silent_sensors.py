"""The sensors of guanabara fail for five minutes: what is reported is the sensors, not the vessels."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from coastwatch.batches import AlarmKind, Flag, Reports
from coastwatch.batches.kinds import EVENT_KINDS
from coastwatch.cycle import run_cycle, start_run
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.stage import serial, serial_regions

pytestmark = pytest.mark.whole

FAILS, RETURNS, ENDS = 80, 180, 215  # cycles of 3 s
MERGED = (*range(FAILS, RETURNS, 3), *range(RETURNS, ENDS, 2))
"""Cycles of 9 s in the silence and of 6 s after it, as a server that is late merges them."""

SILENT = ("ais_silent", "radar_silent", "source_silent")
PARTS = {"ais": ("ais", "statics"), "radars": ("radar",), "all": ("ais", "statics", "radar", "bearing")}


@dataclass
class Seen:
    """What some cycles yielded."""

    dark: list[int] = field(default_factory=list)  # vessels with the flag, in each cycle
    begun: Counter[str] = field(default_factory=Counter)  # events, by kind
    ended: Counter[str] = field(default_factory=Counter)
    lost: list[int] = field(default_factory=list)  # vessels
    evidence: list[str] = field(default_factory=list)  # of silent sensors
    bits: list[Any] = field(default_factory=list)  # picture and events of each cycle
    memory: bytes = b""  # after the last one


class World:
    """The run up to the failure, as a checkpoint, from which each test goes on."""

    def __init__(self) -> None:
        self.scenario = load_scenario("guanabara", {"cycles": str(ENDS - 20), "input.count": "120"})
        self.sensors, self.plan = self.scenario.sensors(), self.scenario.plan()
        self.reports = self.scenario.input.load(self.sensors, 1, self.plan).reports
        self.before = self.play(save(start_run(self.scenario, self.sensors)), range(FAILS))

    def play(self, memory: bytes, numbers: Any, without: str = "", resumed_at: int = -1) -> Seen:
        """Cycles of these numbers, each since the one before. Args: without: what fails; resumed_at: from a checkpoint there."""
        state, seen = load(memory), Seen()
        last = numbers[0] - 1
        for number in numbers:
            now_s = self.plan.instant_s(number)
            reports = self.reports.between(self.plan.instant_s(last) if last >= 0 else -np.inf, now_s)
            if FAILS <= number < RETURNS:
                reports = lacking(reports, without)
            if number == resumed_at:
                state = load(save(state))
            given = self.scenario, self.sensors, state, reports, now_s, serial, lambda name: nullcontext(), serial_regions
            state, cycle = run_cycle(*given)
            seen.dark.append(int(((cycle.picture.flags & Flag.DARK) != 0).sum()))
            begun, ended = cycle.events.begun, cycle.events.ended
            seen.begun.update(EVENT_KINDS[kind] for kind in begun.kind.tolist())
            seen.ended.update(EVENT_KINDS[kind] for kind in ended.kind.tolist())
            seen.lost += begun.vessel_id[begun.kind == AlarmKind.LOST].tolist()
            seen.evidence += begun.evidence[begun.vessel_id == 0].tolist()
            seen.bits.append((cycle.picture.vessel_id, cycle.picture.flags, begun.vessel_id, begun.kind, begun.evidence))
            last = number
        seen.memory = save(state)
        return seen


def lacking(reports: Reports, what: str) -> Reports:
    """The reports without those of what fails."""
    return replace(reports, **{name: getattr(reports, name).take(np.zeros(0, np.int64)) for name in PARTS.get(what, ())})


@pytest.fixture(scope="module")
def world() -> World:
    return World()


def same(one: Seen, other: Seen) -> None:
    """Two runs yielded the same pictures and events."""
    for a, b in zip(one.bits, other.bits, strict=True):
        for left, right in zip(a, b, strict=True):
            assert left.tolist() == right.tolist()


def test_ais_that_fails_leaves_the_dark_vessels_as_they_are(world: World) -> None:
    before = world.before.dark[-1]
    assert before > 25
    seen = world.play(world.before.memory, MERGED, "ais")
    assert max(abs(dark - before) for dark in seen.dark) <= 2, "as many change without the failure"
    assert seen.begun["dark"] <= 2
    assert {kind: seen.begun[kind] for kind in SILENT} == {"ais_silent": 1, "radar_silent": 0, "source_silent": 0}
    assert seen.ended["ais_silent"] == 1
    assert seen.begun["lost"] == 0
    assert seen.evidence[0].startswith("AIS station corcovado is silent: no AIS report for 30 s")
    assert re.search(r"vessels in range of corcovado: [1-9]\d+;", seen.evidence[0]), seen.evidence[0]


def test_radars_that_fail_are_two_alarms_and_no_vessel_is_without_radar_or_lost(world: World) -> None:
    seen = world.play(world.before.memory, MERGED, "radars")
    assert {kind: seen.begun[kind] for kind in SILENT} == {"ais_silent": 0, "radar_silent": 2, "source_silent": 0}
    assert seen.ended["radar_silent"] == 2
    assert not set(seen.lost) & set(world.before.bits[-1][0].tolist())
    assert seen.begun["ais_without_radar"] == 0
    assert {text.split(" is silent")[0] for text in seen.evidence} == {"radar pao-de-acucar", "radar ilha-rasa"}


@pytest.mark.slow
def test_all_that_fails_is_three_alarms(world: World) -> None:
    seen = world.play(world.before.memory, range(FAILS, ENDS), "all")
    assert {kind: seen.begun[kind] for kind in SILENT} == {"ais_silent": 1, "radar_silent": 2, "source_silent": 0}
    assert seen.begun["lost"] == 0
    assert max(seen.dark) <= world.before.dark[-1] + 2


def test_cycles_after_a_restart_are_computed_without_reports_and_nobody_is_lost(world: World) -> None:
    """The server was away for five minutes: it catches up in ten cycles of 30 s, then its feeds are there again."""
    numbers = [*range(FAILS + 9, RETURNS, 10), *range(RETURNS, ENDS)]
    seen = world.play(world.before.memory, numbers, "all")
    assert seen.begun["lost"] == seen.begun["ais_contradicted"] == 0
    assert max(seen.dark) <= world.before.dark[-1] + 2
    assert all(seen.begun[kind] == seen.ended[kind] for kind in SILENT)
    assert seen.begun["ais_silent"] == 1


def test_a_run_that_goes_on_from_a_checkpoint_in_the_silence_is_the_same(world: World) -> None:
    numbers = range(FAILS, FAILS + 20)
    whole = world.play(world.before.memory, numbers, "all")
    resumed = world.play(world.before.memory, numbers, "all", resumed_at=FAILS + 12)
    same(whole, resumed)
    assert whole.memory == resumed.memory
