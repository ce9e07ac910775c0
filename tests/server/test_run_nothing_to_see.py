"""A run with no truth, vessels, sensors or pairs ends with something sensible."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from run_world import column, rows, run, small, stored, url

from coastwatch.operators.cli.summary import as_text
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract


def test_no_truth_gives_no_scores(tmp_path: Path) -> None:
    nmea = tmp_path / "one.nmea"
    nmea.write_text(
        "".join(f"2025-06-01T12:00:{s:02d}Z !AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0*23\n" for s in range(0, 60, 10))
    )
    scenario = load_scenario("context-driven-100", {"cycles": "3", "warmup_s": "0.0"}).model_copy(
        update={"input": feed("nmea", files=[str(nmea)])}
    )
    made = run(tmp_path / "x.db", scenario)
    assert made.scores == {}
    assert column(tmp_path / "x.db", "SELECT scores FROM run") == [None]


def feed(method: str, **settings: Any) -> Any:
    """An input that a file could name."""
    scenario = load_scenario("context-driven-100").model_dump(mode="json")
    return Scenario.model_validate(scenario | {"input": {"method": method, **settings}}).input


def test_no_vessels_give_an_empty_picture(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    made = run(path, small(input__count="0"))
    assert (made.vessels, made.cycles, stored(path)) == (0, 10, 10)
    assert all(found == [] for table, found in rows(path).items() if table not in ("spot", "sensor_registration"))
    assert made.scores["fused_tracks"]["count"] == 0
    assert made.scores["fused_tracks"]["position_rmse_m"] is None
    assert check(url(path)) == []


def test_clutter_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    run(path, small(input__count="0", input__radar__clutter_per_m2="5e-7", tracks__plot_origin="estimated"))
    assert column(path, "SELECT sum(reports) FROM cycle")[0] > 100
    assert column(path, "SELECT status FROM run") == ["finished"]


@pytest.mark.parametrize("without", [{"input__ais__share": "0.0"}, {"radars": "[]"}], ids=["AIS", "radars"])
def test_where_nothing_can_be_fused_the_rest_is_scored(without: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    made = run(path, small(**without))
    assert made.vessels > 20
    assert made.scores["fused_tracks"]["count"] == 0
    assert made.scores["fused_tracks"]["bound_position_rmse_m"] is None
    assert column(path, "SELECT status FROM run") == ["finished"]


@pytest.mark.parametrize(("share", "said"), [("1.0", "(no bound: lanes sway)"), ("0.5", "the others have none: lanes sway)")])
def test_vessels_without_a_bound_are_said_to_have_none(share: str, said: str, tmp_path: Path) -> None:
    scenario = small(input__lanes__share=share)
    made = run(tmp_path / "x.db", scenario)
    fusion = made.scores["fused_tracks"]
    assert fusion["bound_count"] < fusion["count"]
    assert (fusion["bound_position_rmse_m"] is None) == (share == "1.0")
    (line,) = (line for line in as_text(scenario, made).splitlines() if "position RMSE" in line)
    assert said in line
    assert "x the bound" not in line


def test_one_vessel(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    settings = {"input__count": "1", "input__ais__share": "1.0", "input__area_width_nm": "1.0", "input__area_height_nm": "1.0"}
    made = run(path, small(workers__method="threads", **settings), workers=2)
    assert made.vessels == 1
    assert set(column(path, "SELECT vessel_id FROM history")) == {1}
    assert check(url(path)) == []


def test_a_sea_without_sensors(tmp_path: Path) -> None:
    made = run(tmp_path / "x.db", small(radars="[]", stations="[]", sonars="[]", input__ais__share="0.0"))
    assert made.vessels == 0
