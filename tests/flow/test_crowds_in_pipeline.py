"""A crowd of vessels in one roads: what the stages leave out is counted, told as faults of the run and shown as a trouble."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from coastwatch.centre import Cycle
from coastwatch.cycle import LEFT_OUT, Memory, dropped, run_cycle, start_run
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server import clock
from coastwatch.server.input import Paced
from coastwatch.server.live import CROWD_SHOWN_S, LiveRun
from coastwatch.server.run import Computed
from coastwatch.stage import serial

pytestmark = pytest.mark.contract


@cache
def played(count: int, width_nm: float, cycles: int, method: str = "") -> tuple[Scenario, Memory, list[Cycle]]:
    """The demo with so many vessels in a square, and approaches that count at once. Args: method: of radar tracks, empty: the default."""
    size = {"input.count": str(count), "input.area_width_nm": str(width_nm), "input.area_height_nm": str(width_nm)}
    tracker = {"tracks.method": method} if method else {}
    scenario = load_scenario("guanabara", size | tracker | {"alarms.cpa_known_s": "0"})
    sensors, plan, out = scenario.sensors(), scenario.plan(), list[Cycle]()
    reports, memory, before_s = scenario.input.load(sensors, 1, plan).reports, start_run(scenario, sensors), -np.inf
    for k in range(cycles):
        now_s = plan.instant_s(k)
        given = reports.between(before_s, now_s)
        memory, cycle = run_cycle(scenario, sensors, memory, given, now_s, serial, lambda name: nullcontext())
        before_s = now_s
        out.append(cycle)
    return scenario, memory, out


def faults_of(scenario: Scenario, memory: Memory) -> dict[str, int]:
    return {fault.where: fault.count for fault in dropped(memory, scenario.sensors())}


def test_what_a_crowd_leaves_out_is_counted_and_told() -> None:
    scenario, memory, cycles = played(900, 0.7, 6)
    of_stage = {stage: sum(cycle.left_out.get(stage, 0) for cycle in cycles) for stage in LEFT_OUT}
    assert of_stage["associations"] > 10_000
    assert of_stage["alarms"] > 1000
    told = faults_of(scenario, memory)
    assert {stage: told.get(stage, 0) for stage in of_stage} == of_stage
    last = cycles[-1]
    assert last.associations.tested < 512 * len(last.tracks)
    assert len(last.picture) > 650  # of 900, after 18 s


def test_choices_that_were_not_proven_are_told_with_what_they_may_cost() -> None:
    scenario, memory, cycles = played(200, 0.3, 6, "multi_hypothesis")
    told = [fault for fault in dropped(memory, scenario.sensors()) if fault.where == "tracks"]
    assert [fault.count for fault in told] == [sum(cycle.left_out.get("tracks", 0) for cycle in cycles)]
    assert told[0].count == memory.unproven.count
    assert f"at most {memory.unproven.excess:.3g} more" in told[0].example


def test_ordinary_traffic_leaves_nothing_out() -> None:
    scenario, memory, cycles = played(300, 17.0, 6)
    assert [cycle.left_out for cycle in cycles] == [{}] * 6
    assert memory.left_out == {}
    assert not LEFT_OUT.keys() & faults_of(scenario, memory).keys()


def test_a_server_shows_a_crowd_as_a_trouble_for_a_while(monkeypatch: Any) -> None:
    scenario, _, cycles = played(900, 0.7, 6)
    run = LiveRun(scenario, Paced(), lambda picture: None, database="sqlite://")
    run._sensors = scenario.sensors()
    no_reports = scenario.input.load(run._sensors, 1, scenario.plan()).reports.between(-2.0, -1.0)
    now_s = clock.now_s()
    monkeypatch.setattr(clock, "now_s", lambda: now_s)
    run.computed(Computed(1, 0, 0, replace(cycles[-1], left_out={}), no_reports, {}, 0.0))
    assert [one for one in run.troubles() if one.kind == "crowd"] == []
    run.computed(Computed(1, 1, 0, cycles[-1], no_reports, {}, 0.0))
    shown = {one.name: one for one in run.troubles() if one.kind == "crowd"}
    assert shown.keys() == cycles[-1].left_out.keys()
    assert "associations" in shown
    assert not any(one.is_serious for one in shown.values())
    assert str(cycles[-1].left_out["associations"]) in shown["associations"].text
    now_s += CROWD_SHOWN_S
    assert [one for one in run.troubles() if one.kind == "crowd"] == []
