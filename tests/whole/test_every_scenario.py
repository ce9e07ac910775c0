"""Every shipped scenario runs whole, through the command line into a database: exit code, cycles, scores and the database itself."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from coastwatch.operators.cli import main
from coastwatch.scenario import load_scenario

pytestmark = pytest.mark.whole

HOUSE = Path(__file__).parents[2]
SHIPPED = sorted(path.parent.name for path in (HOUSE / "scenarios").glob("*/scenario.toml"))
SHARED = HOUSE.parent / "shared" / "data"
RECORDED = {name: "autoferry" for name in SHIPPED if name.startswith("autoferry-") or name == "small-craft-harbour"} | {
    "solent": "solent_ais"
}
"""The folder of recordings that a scenario reads."""

FEW = {"input.count": "100"}
SLOWER = {"period_s": "4.0", "cycles": "101"}  # 401 s, as the scenario lasts
SHORTENED: dict[str, dict[str, str]] = {
    "busy-harbour": {"period_s": "60.0", "cycles": "8"},
    "context-driven-500": FEW,
    "context-driven-1000": FEW,
    "guanabara": {"input.count": "60", "cycles": "20"},
    "heymann-figures-1-6": {"cycles": "5"},
    "heymann-figures-7-8": {"cycles": "5"},
    "heymann-repulsion": {"cycles": "5"},
    "heymann-table-1": {"cycles": "20"},
    "misregistered-radars": {"input.count": "60", "cycles": "20"},
    "rangel-figure-3": FEW,
    "rangel-literal-noise": FEW,
    "rangel-table-5": FEW,
    "rangel-table-6": FEW,
    "rangel-table-7": FEW,
    "rangel-table-8": FEW,
    "rangel-tables-1-2": FEW,
    "sagild-complete": SLOWER,
    "sagild-difficult": SLOWER,
    "sagild-easy": SLOWER,
    "sagild-normal": SLOWER,
    "sagild-very-difficult": SLOWER,
    "video-harbour": {"cycles": "3"},
    "solent": {"period_s": "60.0", "cycles": "25"},
}
"""Settings of a quick form of scenarios that take longer. `busy-harbour` and `solent` failed after 1,125 s of their own time."""

PAST_S = {"busy-harbour": 1300.0, "solent": 1500.0}
"""Of its own time that a quick form lasts at least."""

ALIKE = {
    *("autoferry-3", "autoferry-6", "autoferry-13", "autoferry-17"),
    *("heymann-figures-1-6", "heymann-figures-7-8"),  # of the scene of heymann-table-1
    *("context-driven-200", "context-driven-500", "context-driven-1000", "liland-initiation", "liland-run-time"),
    *("hem-fast-ais", "hem-figure-3"),  # of hem-figure-2; the second has its settings
    "rangel-tables-3-4",  # has the settings of context-driven-100
    *("rangel-literal-noise", "rangel-table-6", "rangel-table-7", "rangel-table-8"),
    *("sagild-complete", "sagild-difficult", "sagild-easy", "sagild-very-difficult", "liland-shadow"),
}
"""Each differs from a quick one in numbers alone, and runs with the slow tests."""

ELSEWHERE = {"rangel-tables-1-2", "rangel-table-5", "misregistered-radars", "autoferry-2"}
"""Quick tests of `test_context_driven.py`, `test_real_recordings.py` and `tests/registration` run these whole.

Here they run with the slow tests."""


def each(names: Iterable[str]) -> list[Any]:
    """The names as parameters, those alike and those that run elsewhere with the mark `slow`."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (name in ALIKE | ELSEWHERE)) for name in names]


NOT_FUSED = (
    "autoferry-",
    "heymann-",
    "liland-",
    "hem-no-ais",
    "small-craft-harbour",
    "sagild-complete",
    "sagild-very-difficult",
)
"""Beginnings of the names of scenarios in which each vessel has one source, of the last two in their quick form."""

QUICK = [name for name in SHIPPED if name not in SHORTENED]


def stored(path: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(path)) as raw:
        return raw.execute(query).fetchall()


def runs_whole(name: str, settings: dict[str, str], folder: Path, capsys: pytest.CaptureFixture[str], *more: str) -> None:
    """Run a scenario and check what it says and what is stored. It is skipped where its recording is absent.

    Args: more: further parts of the command line.
    """
    if name in RECORDED and not (SHARED / RECORDED[name]).is_dir():
        pytest.skip(f"no recording: {SHARED / RECORDED[name]} is absent")
    path = folder / "run.db"
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    assert main(["run", name, "--json", "--db", f"sqlite:///{path}", *given, *more]) == 0
    made, plan = json.loads(capsys.readouterr().out), load_scenario(name, settings).plan()
    assert (made["cycles"], made["interrupted"]) == (plan.cycles, False)
    assert stored(path, "SELECT count(*), min(number), max(number) FROM cycle") == [(plan.cycles, 0, plan.cycles - 1)]
    assert stored(path, "SELECT status FROM run") == [("finished",)]
    assert not settings or plan.cycles * plan.period_s >= PAST_S.get(name, 0.0)
    has_finite_scores(made["scores"])
    assert made["scores"]["fused_tracks"]["count"] > 0 or name.startswith(NOT_FUSED)
    assert name not in RECORDED or made["records"]["unaccounted"] == 0
    assert main(["db", "check", "--db", f"sqlite:///{path}"]) == 0
    assert stored(path, "PRAGMA integrity_check") == [("ok",)]
    assert stored(path, "PRAGMA foreign_key_check") == []


def has_finite_scores(scores: dict[str, Any]) -> None:
    """Every scenario has truth. A figure that is not finite is none in JSON, and so is one that has nothing to count."""
    fused, picture = scores["fused_tracks"], scores["picture"]
    assert picture["gospa_rms_m"] is not None
    assert picture["ospa_mean_m"] is not None
    if fused["count"]:
        assert None not in (fused["position_rmse_m"], fused["speed_rmse_kn"])
    if fused["bound_count"]:
        assert fused["bound_position_rmse_m"] is not None
    for stage in ("associations", "bearing_associations"):
        if scores[stage].get("tp"):
            assert scores[stage]["f1"] is not None


def test_each_list_names_shipped_scenarios() -> None:
    assert set(SHORTENED) | ALIKE | ELSEWHERE <= set(SHIPPED)


@pytest.mark.parametrize("name", each(QUICK))
def test_a_quick_scenario_runs_whole(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs_whole(name, {}, tmp_path, capsys)


@pytest.mark.parametrize("name", each(SHORTENED))
def test_a_longer_scenario_runs_in_a_quick_form(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs_whole(name, SHORTENED[name], tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORTENED)
def test_a_longer_scenario_runs_whole(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs_whole(name, {}, tmp_path, capsys)
