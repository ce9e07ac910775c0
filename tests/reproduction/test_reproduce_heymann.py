"""`coastwatch reproduce heymann` in short, 300 s of one run: trackers on the same video, beside what was printed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from coastwatch.operators.plot import draw_run
from coastwatch.reproduction import figures, planning, published, report, running
from coastwatch.reproduction.figures import Made, Spread
from coastwatch.reproduction.finished_runs import FinishedRuns
from coastwatch.reproduction.trackers import picture_of

pytestmark = pytest.mark.whole

SEED = 2001


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[report.Reproduction, Path]:
    """The folders of the whole scene, one run."""
    folders = published.chosen("heymann", ("table-1", "figures-1-6", "figures-7-8"))
    short = folders["heymann-table-1"].short
    kept = FinishedRuns(str(tmp_path_factory.mktemp("heymann")))
    plan = planning.plan(folders, 1, "test", short, SEED)
    jobs = planning.unlike(plan)
    assert len(jobs) == 1, "the folders of one scene share their runs"
    running.carry_out(kept, jobs, 1, lambda *_: None, draw_run)
    done = report.made("heymann", folders, plan, kept, "coastwatch reproduce heymann")
    return done, report.written_numbers(kept, done)


def test_both_trackers_of_the_paper_find_both_tugs_and_keep_them(made: tuple[report.Reproduction, Path]) -> None:
    found = made[0].folders[0].made[0].records[0]["scores"]["trackers"]
    for name in ("literal", "scenario", "imm_jpda", "vimmjipda", "known"):
        assert found[name]["completeness_after"] > 0.99, name
        assert found[name]["position_m"] < 6.0, name
        assert found[name]["false_tracks_settled"] <= 0.01, name
    assert found["literal"]["acquisition_s"] <= 31.6
    assert found["literal"]["identities"] == found["scenario"]["identities"] == 2
    assert 0.5 < found["literal"]["nees"] < 5.0
    assert found["particles"]["completeness_after"] > 0.9
    assert found["particles"]["acquisition_s"] <= found["one_search"]["acquisition_s"]
    assert found["literal"]["position_m"] < found["frame_time"]["position_m"]
    assert found["literal"]["ospa_m"]["250"] < found["literal"]["ospa_m"]["500"]
    assert found["plots"]["detected"]["0"] > 0.95


def test_the_report_has_the_printed_figures_beside_ours(made: tuple[report.Reproduction, Path]) -> None:
    said = list(report.lines(made[0]))
    line = next(text for text in said if text.strip().startswith("acquisition, mean, literal"))
    assert " 12.0 " in line, "published"
    assert "asked: reached" in line
    assert any(text.strip().startswith("OSPA 200 to 400 s, c = 250 m, literal") for text in said)
    page = report.written_page(FinishedRuns(str(made[1].parent)), made[0]).read_text("utf-8")
    assert page.count("data:image/svg") == 4, "OSPA twice, the paths, and a turn of video with particles"
    kept = made[0].folders[0].made[0].records[0]["scores"]["trackers"]
    assert len(kept["acquired"]["acquired"]) == 2 * 200
    assert picture_of(kept["scan"]).max() > 40
    assert any("completeness" in sentence for sentence in made[0].failures), "acquisition takes 4 % of 300 s: exit code 4"
    numbers = json.loads(made[1].read_text("utf-8"))
    figure = next(
        f for f in numbers["scenarios"]["heymann-table-1"]["figures"] if f["name"] == "completeness, RMPF, one search"
    )
    assert figure["published"] == pytest.approx(0.974)


def test_the_repulsion_as_printed_is_shown_beside_the_repaired_one(tmp_path: Path) -> None:
    folders = published.chosen("heymann", ("repulsion",))
    plan, kept = planning.plan(folders, 1, "test", folders["heymann-repulsion"].short, SEED), FinishedRuns(str(tmp_path))
    running.carry_out(kept, planning.unlike(plan), 1, lambda *_: None, draw_run)
    done = report.made("heymann", folders, plan, kept, "coastwatch reproduce heymann")
    found = done.folders[0].made[0].records[0]["scores"]["trackers"]
    assert found["particles"]["acquisition_s"] <= 31.6
    assert found["literal_equation"]["acquisition_s"] is None, "filters gather on the same tug"
    assert found["uniform_start"]["acquisition_s"] is None


def test_median_and_worst_are_of_all_runs() -> None:
    of = published.chosen("heymann", ("table-1",))["heymann-table-1"]
    wanted = planning.plan({"heymann-table-1": of}, 3, "test", of.short)["heymann-table-1"][0]
    records = [{"scores": {"trackers": {"literal": {"acquisition_s": s, "completeness": s / 100}}}} for s in (9.6, 31.2, 12.0)]
    lines = {line.figure.name: line.measured for line in figures.lines(of, [Made(wanted, tuple(records))])}
    assert lines["acquisition, median, literal"] == Spread((12.0,))
    assert lines["acquisition, worst, literal"] == Spread((31.2,))
    assert lines["acquisition, mean, literal"].mean == pytest.approx(17.6)
    records[1]["scores"]["trackers"]["literal"]["acquisition_s"] = None  # it found nothing
    lines = {line.figure.name: line.measured for line in figures.lines(of, [Made(wanted, tuple(records))])}
    assert lines["acquisition, median, literal"] == Spread((12.0,))
    assert lines["acquisition, worst, literal"] == Spread((math.inf,))
