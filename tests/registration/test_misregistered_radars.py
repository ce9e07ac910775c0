"""Radars that are off, from reports to picture: what comes of it, against the same sea with radars that are right."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from coastwatch.batches import RadarCorrections, RegistrationState
from coastwatch.centre import Cycle
from coastwatch.cycle import run_cycle, start_run
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.server.run import run_scenario
from coastwatch.stage import serial

pytestmark = pytest.mark.whole

SEED = 7
SMALL = {"input.count": "160", "warmup_s": "0.0", "cycles": "50"}
RIGHT = {f"input.radars.{k}.{key}": "0.0" for k in (0, 1) for key in ("azimuth_bias_deg", "range_bias_m", "time_bias_s")}
SIGMAS = 4.5


@cache
def course(folder: Path, right: bool) -> list[Cycle]:
    out: list[Cycle] = []
    settings = SMALL | (RIGHT if right else {})
    run_scenario(
        load_scenario("misregistered-radars", settings),
        seed=SEED,
        database=f"sqlite:///{folder / f'{right}.db'}",
        on_cycle=out.append,
    )
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("registration")


def f1(cycles: list[Cycle]) -> float:
    kinds = load_scenario("misregistered-radars").sensors().source_kinds
    total = sum((association(c.tracks, c.associations, kinds) for c in cycles), Confusion())
    return total.as_dict()["f1"]


def test_association_is_as_good_and_no_ghost_remains(folder: Path) -> None:
    wrong, right = course(folder, False), course(folder, True)
    assert f1(wrong[30:]) >= f1(right[30:]) - 0.002
    assert [len(c.picture) for c in wrong[30:]] == [len(c.picture) for c in right[30:]]
    for cycle in wrong[30:]:
        radar_only = cycle.picture.mmsi < 0
        twice = np.unique(cycle.picture.origin[cycle.picture.origin >= 0], return_counts=True)[1]
        assert radar_only.any()
        assert twice.max() == 1, "a vessel stands twice in the picture"


def test_tracks_begun_in_the_wrong_place_end_where_a_bias_is_acquired_late() -> None:
    """Registration is switched on after 90 s, when the picture has each vessel of radar and AIS twice."""
    scenario = load_scenario("misregistered-radars", SMALL)
    off = load_scenario("misregistered-radars", SMALL | {"registration.method": "none"})
    sensors, plan = scenario.sensors(), scenario.plan()
    reports = scenario.input.load(sensors, SEED, plan).reports
    memory, doubled, before = start_run(off, sensors), [], -np.inf
    former = np.zeros(0, np.int64)  # radar tracks just before
    for number in range(50):
        now = plan.instant_s(number)
        memory = memory if number != 30 else replace(memory, registration=scenario.registration.init())
        chosen = off if number < 30 else scenario
        memory, cycle = run_cycle(chosen, sensors, memory, reports.between(before, now), now, serial, lambda _: nullcontext())
        before = now
        vessels = cycle.picture.origin[cycle.picture.origin >= 0]
        doubled.append(int((np.unique(vessels, return_counts=True)[1] > 1).sum()))
        if number == 29:
            former = cycle.tracks.track_id[cycle.tracks.source == 0]
        if number == 31:
            assert not np.isin(cycle.tracks.track_id, former).any(), "a track from before the jump is still there"
    assert len(former) > 20
    assert min(doubled[20:30]) > 20
    gone = int(np.ceil(scenario.picture.coast_s / scenario.period_s))
    assert max(doubled[31 + gone :]) == 0


def test_a_radar_that_is_right_ends_no_track(folder: Path) -> None:
    assert not any(c.corrections.jumped.any() for c in course(folder, True))


def test_the_errors_are_found_though_ais_is_late(folder: Path) -> None:
    found: RadarCorrections = course(folder, False)[-1].corrections
    assert found.state.tolist() == [RegistrationState.SETTLED] * 2
    off = np.degrees(found.azimuth_bias_rad) - [5.0, -12.0]
    assert (np.abs(off) < SIGMAS * np.degrees(found.azimuth_sigma_rad)).all()
    assert (np.abs(found.range_bias_m - [0.0, 40.0]) < SIGMAS * found.range_sigma_m).all()
    assert (np.abs(found.estimated_lag_s - 1.5) < SIGMAS * found.lag_sigma_s).all()
    assert (found.lag_sigma_s < 0.5).all(), "so small that a latency of 1 to 2 s taken for lag would be seen"
