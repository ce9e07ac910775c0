"""Kernels are loaded before the first cycle, with a word on it, and nothing of it is left in the run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import active_children
from typing import Any

import numpy as np
import pytest
from numba import njit

from coastwatch.batches import RadarReports
from coastwatch.cycle import run_cycle
from coastwatch.kernels.association import polar_pairs
from coastwatch.kernels.filters import ais_tracker
from coastwatch.kernels.geometry import radar_plane
from coastwatch.plots import CfarExtraction, ExtractionInput, ExtractionMemory
from coastwatch.scenario import load_scenario
from coastwatch.sensors import Tables
from coastwatch.sensors.simulated import video as simulated_video
from coastwatch.server.warm_up import _places, _with_spots, kind_of, load_kernels, warm_up
from coastwatch.stage import serial, serial_regions
from coastwatch.workers import ThreadedRegions, Workers, open_workers

pytestmark = pytest.mark.contract

SCENARIOS = {
    "context-driven-100": {},
    "solent": {},
    "guanabara": {"radars": "[]", "sonars": "[]"},
}


@pytest.mark.parametrize(
    "name", ["context-driven-100", *(pytest.param(n, marks=pytest.mark.slow) for n in ("solent", "guanabara"))]
)
def test_each_stage_whose_kernels_are_compiled_is_named_once_and_no_other(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario(name, SCENARIOS[name])
    compiled: list[str] = []

    def compiling(*given: Any, **named: Any) -> Any:
        """A cycle in which most stages compile a kernel."""
        *before, timer, regions = given

        @contextmanager
        def of_stage(stage: str) -> Iterator[None]:
            with timer(stage):
                if stage not in ("spots", "octants") and compiled.count(stage) < 2:  # it is named at the first alone
                    compiled.append(stage)
                    njit(lambda number: number + 1)(1)
                yield

        return run_cycle(*before, of_stage, regions, **named)

    load_kernels(scenario, scenario.sensors(), lambda text: None)  # all of its own kernels are loaded by now
    said: list[str] = []
    monkeypatch.setattr("coastwatch.server.warm_up.run_cycle", compiling)
    load_kernels(scenario, scenario.sensors(), said.append)
    assert {"tracks", "ais_tracks", "associations", "picture", "registration"} <= set(compiled)
    assert len(said) == len(set(compiled))
    for stage in compiled:
        assert sum(f": {stage}, stage" in text for text in said) == 1, said
    assert all("compiled once" in text for text in said)


def test_nothing_is_said_where_every_kernel_comes_from_disk() -> None:
    code = """
from coastwatch.scenario import load_scenario
from coastwatch.server.warm_up import warm_up
scenario = load_scenario("context-driven-100")
warm_up(scenario, scenario.sensors(), print)
"""
    scenario = load_scenario("context-driven-100")
    load_kernels(scenario, scenario.sensors(), lambda text: None)  # kernels may be compiled
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_a_second_run_of_a_kind_goes_on_at_once_and_another_kind_or_new_processes_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr("coastwatch.server.warm_up.load_kernels", lambda scenario, *_, **__: loaded.append(scenario.name))
    monkeypatch.setattr("coastwatch.server.warm_up._loaded", set())

    def loads(settings: dict[str, str], workers: Workers, video: bool = False) -> bool:
        loaded.clear()
        scenario = load_scenario("context-driven-100", settings)
        warm_up(scenario, scenario.sensors(), lambda text: None, workers, video=video)
        return bool(loaded)

    here, there = Workers(serial, ThreadedRegions()), Workers(serial, serial_regions)
    assert [loads({}, there), loads({}, here), loads({}, here)] == [True, True, False], "what others have loaded is not here"
    assert not loads({"cycles": "7", "input.count": "9"}, here)
    assert [loads({"tracks.method": "imm"}, here), loads({}, here, video=True), loads({}, there)] == [True, True, True]
    assert [loads({"input.count": "5000"}, here), loads({"radars": "[]"}, here)] == [True, True], "several spots, no radar"


def test_the_kind_of_a_run_has_no_number_but_zero() -> None:
    assert kind_of({"a": 1.5, "b": (1, 2), "c": True}) == kind_of({"a": 2.5, "b": [7], "c": True})
    for other in ({"a": 0.0}, {"a": None}, {"a": True}, {"a": "1.5"}, {"a": 2}, {"b": 1.5}):
        assert kind_of({"a": 1.5}) != kind_of(other)


def test_the_kernels_that_take_longest_are_loaded() -> None:
    scenario = load_scenario("context-driven-100")
    load_kernels(scenario, scenario.sensors(), lambda text: None)
    for kernel in (
        radar_plane.to_region,
        ais_tracker.update,
        ais_tracker.estimates,
        ais_tracker.carry_numbers,
        polar_pairs.near_pairs,
    ):
        assert kernel.signatures, kernel.__name__


@pytest.mark.parametrize("by", ["", "live feed", "fuse --video"])
def test_kernels_of_video_are_loaded_where_a_feed_has_some(by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("context-driven-100")
    if by == "fuse --video":
        scenario = scenario.model_copy(update={"input": Tables(feeds=("video+file:turns.pcap",))})
    spokes: list[int] = []
    step = CfarExtraction.step

    def looked(self: CfarExtraction, memory: ExtractionMemory, given: ExtractionInput) -> tuple[ExtractionMemory, RadarReports]:
        spokes.append(len(given.video))
        return step(self, memory, given)

    monkeypatch.setattr(CfarExtraction, "step", looked)
    load_kernels(scenario, scenario.sensors(), lambda text: None, video=by == "live feed")
    assert (sum(spokes) > 1024) == bool(by)


def test_no_land_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("heymann-table-1", {"input.cells": "64", "input.spokes": "64"})
    ring = ((54.0, 12.0), (54.1, 12.0), (54.1, 12.1))
    scenario = scenario.model_copy(update={"input": scenario.input.model_copy(update={"land_deg": (ring,)})})
    monkeypatch.setattr(simulated_video, "inside", lambda *given: pytest.fail("the land of a coast may take minutes"))
    load_kernels(scenario, replace(scenario.sensors(), land_deg=(ring,)), lambda text: None)


def test_worker_processes_have_done_both_kinds_of_work_before_the_first_cycle() -> None:
    radar = '{{name = "{0}", region = "{0}", latitude_deg = {1}, longitude_deg = -43.1, range_nm = 4.0, rpm = 20.0}}'
    radars = f"[{radar.format('north', -23.0)}, {radar.format('south', -23.1)}]"
    scenario = load_scenario("context-driven-100", {"radars": radars})
    with open_workers("processes", 2) as workers:
        load_kernels(scenario, scenario.sensors(), lambda text: None, workers)
        assert 3 <= len(active_children()) <= 4  # two of regions, two or one of spots
        assert workers.lost() == 0


def test_a_sensor_without_a_place_gets_no_vessel() -> None:
    scenario = load_scenario("context-driven-100")
    sensors = scenario.sensors()
    every = len(_places(scenario, sensors))
    sensors.radars.site_deg[0] = np.nan
    assert len(_places(scenario, sensors)) == every - 4


def test_several_spots_where_many_vessels_are_to_come() -> None:
    assert _with_spots(load_scenario("context-driven-1000")).spots.count == 2
    for name in ("context-driven-100", "solent"):
        scenario = load_scenario(name)
        assert _with_spots(scenario) is scenario
        assert _with_spots(scenario, several=True).spots.count == 2
