"""Kernels are loaded before the first cycle, with a word on it, and nothing of it is left in the run."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import active_children

import numpy as np
import pytest

from coastwatch.batches import RadarReports
from coastwatch.kernels.association import polar_pairs
from coastwatch.kernels.filters import ais_tracker
from coastwatch.kernels.geometry import radar_plane
from coastwatch.plots import CfarExtraction, ExtractionInput, ExtractionMemory
from coastwatch.scenario import load_scenario
from coastwatch.sensors.simulated import video as simulated_video
from coastwatch.server.warm_up import _places, _with_spots, warm_up
from coastwatch.workers import open_workers

pytestmark = pytest.mark.contract

SCENARIOS = {
    "context-driven-100": {},
    "solent": {},
    "guanabara": {"radars": "[]", "sonars": "[]"},
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_it_runs_on_the_sensors_of_a_scenario_and_names_each_stage(name: str) -> None:
    scenario = load_scenario(name, SCENARIOS[name])
    said: list[str] = []
    warm_up(scenario, scenario.sensors(), said.append)
    for stage in ("tracks", "ais_tracks", "associations", "picture", "registration"):
        assert sum(f": {stage}, stage" in text for text in said) == 1, said
    assert all("compiled once" in text for text in said)


def test_the_kernels_that_take_longest_are_loaded() -> None:
    scenario = load_scenario("context-driven-100")
    warm_up(scenario, scenario.sensors(), lambda text: None)
    for kernel in (
        radar_plane.to_region,
        ais_tracker.update,
        ais_tracker.estimates,
        ais_tracker.carry_numbers,
        polar_pairs.near_pairs,
    ):
        assert kernel.signatures, kernel.__name__


@pytest.mark.parametrize("video", [False, True])
def test_kernels_of_video_are_loaded_where_a_feed_has_some(video: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("context-driven-100")
    spokes: list[int] = []
    step = CfarExtraction.step

    def looked(self: CfarExtraction, memory: ExtractionMemory, given: ExtractionInput) -> tuple[ExtractionMemory, RadarReports]:
        spokes.append(len(given.video))
        return step(self, memory, given)

    monkeypatch.setattr(CfarExtraction, "step", looked)
    warm_up(scenario, scenario.sensors(), lambda text: None, video=video)
    assert (sum(spokes) > 1024) == video


def test_no_land_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("heymann-table-1", {"input.cells": "64", "input.spokes": "64"})
    ring = ((54.0, 12.0), (54.1, 12.0), (54.1, 12.1))
    scenario = scenario.model_copy(update={"input": scenario.input.model_copy(update={"land_deg": (ring,)})})
    monkeypatch.setattr(simulated_video, "inside", lambda *given: pytest.fail("the land of a coast may take minutes"))
    warm_up(scenario, replace(scenario.sensors(), land_deg=(ring,)), lambda text: None)


def test_worker_processes_have_done_both_kinds_of_work_before_the_first_cycle() -> None:
    radar = '{{name = "{0}", region = "{0}", latitude_deg = {1}, longitude_deg = -43.1, range_nm = 4.0, rpm = 20.0}}'
    radars = f"[{radar.format('north', -23.0)}, {radar.format('south', -23.1)}]"
    scenario = load_scenario("context-driven-100", {"radars": radars})
    with open_workers("processes", 2) as workers:
        warm_up(scenario, scenario.sensors(), lambda text: None, workers)
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
