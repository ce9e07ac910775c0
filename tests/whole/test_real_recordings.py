"""Recorded input from file to picture: the Solent with silenced vessels, Autoferry against its floor, and no use of the future."""

from __future__ import annotations

import gzip
import json
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_every_scenario import runs_whole

from coastwatch.batches import Recording, Sensors
from coastwatch.scenario import load_scenario
from coastwatch.sensors import Solent
from coastwatch.server.run import run_scenario
from coastwatch.stage import Plan

pytestmark = pytest.mark.whole

SHARED = Path(__file__).parents[2].parent / "shared"
SOLENT, AUTOFERRY, SCORER = (
    SHARED / "data" / "solent_ais",
    SHARED / "data" / "autoferry",
    SHARED / "scoring" / "score_autoferry.py",
)
needs_solent = pytest.mark.skipif(not SOLENT.is_dir(), reason=f"no recording: {SOLENT} is absent")
needs_autoferry = pytest.mark.skipif(not AUTOFERRY.is_dir(), reason=f"no recording: {AUTOFERRY} is absent")

SEED = 2001
FALSE_DARK = 0.01  # of the instants of vessels that are not silent
FLOOR_GOSPA_M = 23.0  # nearest neighbour with the stamp corrected, shared/data/autoferry/README.md
COVERAGE = 0.85


def history(path: Path, before: int = 10**9) -> list[tuple[Any, ...]]:
    """The stored rows of all cycles before one, to the bit, run number left out."""
    with sqlite3.connect(path) as raw:
        return raw.execute("SELECT * FROM history WHERE cycle < ? ORDER BY cycle, vessel_id", (before,)).fetchall()


@pytest.mark.slow
@needs_solent
def test_every_silenced_vessel_in_the_solent_is_flagged_and_hardly_another(tmp_path: Path) -> None:
    scenario = load_scenario("solent", {"cycles": "200"})
    found = run_scenario(scenario, seed=SEED, database=f"sqlite:///{tmp_path / 'x.db'}").scores["picture"]
    assert found["silent_vessels_in_cover"] >= 2
    assert found["silent_vessels_flagged"] == found["silent_vessels_in_cover"]
    assert found["dark_false_rate"] < FALSE_DARK


EVERY_CYCLE = {"store.history_max_s": "0"}  # a point of every vessel in each, so that whole pictures are compared


@needs_autoferry
def test_autoferry_runs_whole_and_is_better_than_its_floor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tracks, scored = tmp_path / "tracks.csv", tmp_path / "scored.json"
    runs_whole("autoferry-2", {}, tmp_path, capsys, "--tracks-csv", str(tracks))
    if not SCORER.is_file():
        pytest.skip(f"{SCORER} is absent")
    scoring = [sys.executable, str(SCORER), "--scenario", "2", "--tracks", str(tracks), "--json", str(scored)]
    subprocess.run(scoring, check=True, capture_output=True)
    found = json.loads(scored.read_text("utf-8"))
    assert found["gospa_rms"] < FLOOR_GOSPA_M
    assert found["coverage"] > COVERAGE


def cut_short(source: Path, target: Path, seconds: float) -> float:
    """Writes an Autoferry recording that ends so long after it began, in order of arrival; returns the instant of the end.

    The truth is left whole: nothing but the scores may read it.
    """
    target.mkdir(parents=True)
    (name,) = source.glob("*_detections.json.gz")
    with gzip.open(name, "rt") as file:
        items = json.load(file)
    arrived = np.maximum.accumulate([item["time"] for item in items])
    until_s = float(np.floor(arrived[0]) + seconds)
    with gzip.open(target / name.name, "wt") as file:
        json.dump(items[: int(np.searchsorted(arrived, until_s, side="right"))], file)
    (truth,) = source.glob("*_groundTruth.json.gz")
    (target / truth.name).write_bytes(truth.read_bytes())
    return until_s


@needs_autoferry
@pytest.mark.parametrize("number", [2, pytest.param(6, marks=pytest.mark.slow)])
def test_what_autoferry_brings_later_changes_no_picture_of_before(number: int, tmp_path: Path) -> None:
    until_s = cut_short(AUTOFERRY / f"scenario{number}", tmp_path / "data" / f"scenario{number}", 40.0)
    whole = load_scenario(f"autoferry-{number}", {"cycles": "60", **EVERY_CYCLE})
    cut = load_scenario(f"autoferry-{number}", {"input.root": str(tmp_path / "data"), **EVERY_CYCLE})
    run_scenario(whole, database=f"sqlite:///{tmp_path / 'whole.db'}")
    run_scenario(cut, database=f"sqlite:///{tmp_path / 'cut.db'}")
    plan = whole.plan()
    assert plan.start_s == cut.plan().start_s
    common = int(np.floor((until_s - plan.start_s) / plan.period_s))
    assert 30 < common < 60
    assert len(history(tmp_path / "whole.db", common)) > 20
    assert history(tmp_path / "whole.db", common) == history(tmp_path / "cut.db", common)


@needs_solent
@pytest.mark.slow
def test_what_the_solent_brings_later_changes_no_picture_of_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulated radars run along a truth that is smoothed over the whole recording, so reports are cut, not the file."""
    common, load = 40, Solent.load

    def cut(self: Solent, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        found = load(self, sensors, seed, plan)
        return replace(found, reports=found.reports.between(float("-inf"), plan.instant_s(common - 1)))

    scenario = load_scenario("solent", {"cycles": "15", **EVERY_CYCLE})
    run_scenario(scenario, seed=SEED, database=f"sqlite:///{tmp_path / 'whole.db'}")
    monkeypatch.setattr(Solent, "load", cut)
    run_scenario(scenario, seed=SEED, database=f"sqlite:///{tmp_path / 'cut.db'}")
    assert len(history(tmp_path / "whole.db", common)) > 1000
    assert history(tmp_path / "whole.db", common) == history(tmp_path / "cut.db", common)
    assert history(tmp_path / "whole.db") != history(tmp_path / "cut.db")
