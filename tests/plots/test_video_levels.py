"""The scale of the levels of radar video, told from its noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coastwatch.plots.video.levels import levels_of
from coastwatch.scenario import load_scenario

pytestmark = pytest.mark.contract


@pytest.mark.parametrize("step_db", [0.5, 2.0])
def test_the_scale_of_levels_is_told_from_the_noise(step_db: float) -> None:
    power = np.random.default_rng(1).standard_exponential((600, 200))
    decibels = np.clip((10.0 * np.log10(power) + 20.0) / step_db, 0, 255).astype(np.uint8)
    assert levels_of(decibels).db_per_level == pytest.approx(step_db, rel=0.15)
    assert levels_of((20.0 * np.sqrt(power)).astype(np.uint8)).db_per_level == 0.0
    cleaned = np.where(power > 3.0, 200, 0).astype(np.uint8)
    assert levels_of(cleaned).db_per_level is None
    assert levels_of(cleaned).zero_share == pytest.approx(1.0 - math.exp(-3.0), abs=0.01)


@pytest.mark.parametrize("step_db", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("name", ["video-harbour", "heymann-table-1"])
def test_neither_land_nor_a_blanked_sector_hides_the_scale_of_levels(name: str, step_db: float) -> None:
    scenario = load_scenario(name, {"radars.0.db_per_level": step_db})
    begin_s = scenario.plan().start_s
    stream = scenario.input.load(scenario.sensors(), scenario.seed, scenario.plan()).reports
    turn = np.concatenate([part.level for part in stream.between(begin_s - 1e-3, begin_s + 2.399).video.parts])
    assert levels_of(turn).db_per_level == pytest.approx(step_db, rel=0.1)
    blanked = np.where(np.arange(len(turn))[:, None] % 1024 < 300, 0, turn)
    assert levels_of(blanked).db_per_level == pytest.approx(step_db, rel=0.1)
