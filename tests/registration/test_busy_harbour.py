"""Radars that see few of the AIS vessels, in harbours drawn by `scaling.load.registration`: short forms of what is asked there."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from coastwatch import store as kept
from coastwatch.batches import RegistrationState
from coastwatch.operators.cli import main
from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario
from scaling.load.registration import CASES, FOUND, Course, harbour, run

pytestmark = pytest.mark.whole

SEED = 31
RIGHT_DEG = 1.0


@cache
def course(case: str, seed: int, minutes: float) -> tuple[Course, ...]:
    return tuple(run(CASES[case], seed, minutes))


@pytest.mark.parametrize(
    ("case", "seeds", "minutes"),
    [
        ("three", (SEED,), 6.0),
        pytest.param("three", (32, 33, 34), 16.0, marks=pytest.mark.slow),
        pytest.param("fifteen", (31, 32, 33), 16.0, marks=pytest.mark.slow),
        pytest.param("moving", (31, 32), 16.0, marks=pytest.mark.slow),
        pytest.param("noise-2", (31, 32), 16.0, marks=pytest.mark.slow),
    ],
)
def test_the_bias_is_found_in_minutes(case: str, seeds: tuple[int, ...], minutes: float) -> None:
    for seed in seeds:
        (found,) = course(case, seed, minutes)
        assert found.found_s < 60.0 * minutes
        assert abs(found.found_off_deg) < RIGHT_DEG
        assert found.late_wrong_deg < RIGHT_DEG
        off_deg, off_m, *_ = found.marks[5 if minutes < 15 else 15]
        assert abs(off_deg) < 0.6
        assert abs(off_m) < 15.0


@pytest.mark.parametrize(
    ("case", "seed", "minutes"),
    [
        ("unseen", SEED, 8.0),
        pytest.param("unseen", 104, 60.0, marks=pytest.mark.slow),  # a lane that is turned lies on another one
        pytest.param("other", 101, 60.0, marks=pytest.mark.slow),
    ],
)
def test_nothing_is_found_where_no_ais_vessel_is_seen(case: str, seed: int, minutes: float) -> None:
    (never,) = course(case, seed, minutes)
    assert not set(never.states) & set(FOUND)
    assert never.most_odds < 1e4
    assert all(azimuth == 0.0 for azimuth, *_ in never.corrections)


@pytest.mark.slow
def test_a_radar_that_is_right_stays_where_it_is() -> None:
    (right,) = course("zero", SEED, 30.0)
    assert right.late_wrong_deg < RIGHT_DEG


@pytest.mark.slow
def test_two_radars_are_registered_each_by_itself() -> None:
    """The second radar's errors change not one bit of what is found of the first."""
    pier, tower = course("two", SEED, 6.0)
    for found in (pier, tower):
        assert found.found_s < 360.0
        assert abs(found.found_off_deg) < RIGHT_DEG
    other = CASES["two"]._replace(errors=(CASES["two"].errors[0], (8.0, -30.0, 0.0)))
    changed, _ = run(other, SEED, 6.0)
    np.testing.assert_array_equal(changed.corrections, pier.corrections)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["step-4", "step-10"])
def test_a_radar_that_is_turned_is_right_again_within_five_minutes(case: str) -> None:
    (turned,) = course(case, SEED, 21.0)
    assert turned.right_again_s <= 300.0


def test_the_harbour_is_as_it_says() -> None:
    """Share of AIS vessels in range that are seen in a turn, and share of plots of nobody with AIS."""
    scenario, (vessels, seen, nobody) = harbour(CASES["three"], SEED, 10.0)
    plan, sensors = scenario.plan(), scenario.sensors()
    reports = scenario.input.load(sensors, SEED, plan).reports
    turns = (plan.instant_s(plan.cycles - 1) - plan.start_s) / 2.5
    of_ais = (reports.radar.origin >= 0) & (reports.radar.origin < vessels)
    assert 0.3 * seen < of_ais.sum() / turns / vessels < 1.3 * seen
    assert nobody - 0.05 < 1.0 - of_ais.mean() < 0.98, "some AIS vessels are out of range, and the moored ones in shadow"
    moored = scenario.input.moored[0].count
    assert not (reports.radar.origin[of_ais] < moored).any(), "they lie in shadow"
    assert len(np.unique(reports.ais.origin)) == vessels


def test_sensors_show_candidate_odds_and_voices_from_the_first_decision(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"sqlite:///{tmp_path / 'x.db'}"
    scenario = load_scenario("busy-harbour", {"warmup_s": "0", "cycles": "12"})
    run_scenario(scenario, seed=SEED, database=url)
    with kept.open_store(url) as found:
        rows = kept.sensor_states(found, kept.latest_run(found), scenario.plan().instant_s(0))
    for name in ("candidate_azimuth_deg", "candidate_range_m", "odds", "voices", "rival_share"):
        assert all(v is not None for v, kind in zip(rows.column(name), rows.column("kind"), strict=True) if kind == "radar"), (
            name
        )
    states = [s for s in rows.column("state") if s is not None]
    assert states == [RegistrationState.ACQUIRING.name.lower()] * 2
    assert main(["sensors", "--db", url]) == 0
    shown = capsys.readouterr().out
    assert "voices" in shown
    assert "to 1" in shown or "1 to" in shown


def test_a_radar_with_no_ais_vessel_in_cover_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = f"sqlite:///{tmp_path / 'x.db'}"
    scenario = load_scenario(
        "busy-harbour", {"warmup_s": "0", "cycles": "6", "radars.1.latitude_deg": "54.9", "area.height_nm": "60"}
    )
    run_scenario(scenario, seed=SEED, database=url)
    assert main(["sensors", "--db", url]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("radar") or " radar " in line]
    assert any("no AIS vessel in cover" in line or "no plots" in line for line in lines)
