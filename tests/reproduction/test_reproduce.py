"""`coastwatch reproduce`: every folder runs, what is finished is kept, the report stands alone, the JSON has its schema."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from run_world import Start

from coastwatch.operators.cli import main
from coastwatch.operators.plot import draw_run
from coastwatch.reproduction import (
    figures,
    finished_runs,
    html_report,
    measuring,
    planning,
    published,
    report,
    running,
    systems,
)
from coastwatch.reproduction.figures import Line, Made, Spread, at_path, orders
from coastwatch.reproduction.finished_runs import FinishedRuns
from coastwatch.reproduction.report_plots import roc_curve
from coastwatch.server.processes import over_processes

pytestmark = pytest.mark.whole


@cache
def rangel() -> dict[str, published.Published]:
    return published.chosen("rangel", ())


TWO = ("rangel-tables-3-4", "rangel-table-8")
SHORT = ("cycles=3", "warmup_s=45", "input.count=25")  # only has to run
TIMEOUT_S = 600.0


def quiet(*_: object) -> None:
    """A progress that shows nothing."""


def at_first_point(of: published.Published) -> published.Published:
    """The same with one value a sweep, so that a test is over in seconds."""
    variants = tuple(v.model_copy(update={"sweep": {k: x[:1] for k, x in v.sweep.items()}}) for v in of.variant)
    return of.model_copy(update={"sweep": {k: x[:1] for k, x in of.sweep.items()}, "variant": variants})


def reproduced(folder: Path, names: tuple[str, ...], further: tuple[str, ...] = SHORT) -> report.Reproduction:
    """Some folders, short, one run of each variant."""
    folders = {name: at_first_point(rangel()[name]) for name in names}
    plan, kept = planning.plan(folders, 1, "test", further), FinishedRuns(str(folder))
    running.carry_out(kept, planning.unlike(plan), 1, quiet, draw_run)
    return report.made("rangel", folders, plan, kept, "coastwatch reproduce rangel")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[report.Reproduction, Path]:
    """Two folders, short."""
    folder = tmp_path_factory.mktemp("reproduction")
    return reproduced(folder, TWO), folder


def test_the_tracks_of_few_targets_are_scored_beside_the_bound(tmp_path: Path) -> None:
    """Three seeds at one detection probability, of two variants; two claims, one of them wrong."""
    of = published.chosen("hem", ("hem-figure-2",))["hem-figure-2"]
    key = next(iter(of.sweep))
    wrong = published.Ordering(path="targets.ospa_m", less="radar", more="sequential")
    claims = (*(o for o in of.ordering if (o.less, o.more) == ("sequential", "radar")), wrong)
    few = {"variant": (of.named("radar"), of.named("sequential")), "sweep": {key: (0.5,)}, "ordering": claims}
    wanted = tuple(f for f in of.figure if f.at == {key: 0.5} and f.default in ("radar", "sequential") and not f.literal)
    folders = {"hem-figure-2": of.model_copy(update={**few, "figure": wanted})}
    plan, kept = planning.plan(folders, 3, "test", ("cycles=24",)), FinishedRuns(str(tmp_path))
    running.carry_out(kept, planning.unlike(plan), 1, quiet, draw_run)
    made = report.made("hem", folders, plan, kept, "coastwatch reproduce hem")
    lines = {line.figure.name: line for line in made.folders[0].lines}
    assert 0.0 < lines["OSPA, A, P_D 0.5"].bound.mean < lines["OSPA, A, P_D 0.5"].measured.mean
    one, other = made.folders[0].orders
    assert one.difference.mean == -other.difference.mean > 0.0
    assert one.verdict in ("holds", "equal within 2 standard errors")
    assert other.verdict != "holds"
    assert any("radar < sequential" in said for said in made.failures) == (other.verdict == "fails")
    assert sum("sequential < radar" in line for line in report.lines(made)) == 1
    page = report.written_page(kept, made).read_text("utf-8")
    assert page.count("data:image/svg") == 2
    assert "OSPA, A, P_D 0.5" in page
    numbers = json.loads(report.written_numbers(kept, made).read_text("utf-8"))
    assert numbers["scenarios"]["hem-figure-2"]["orderings"][0]["less"] == "sequential"


def test_methods_side_by_side_and_two_filters_are_reported(tmp_path: Path) -> None:
    few = {"synchronous": ("ais_messages=60",), "figure-11-2": ("ais_messages=12",), "normal": ("cycles=12",)}
    for name, short in few.items():
        folders = published.chosen("sagild", (name,))
        plan, kept = planning.plan(folders, 2 if name != "normal" else 1, "test", short), FinishedRuns(str(tmp_path))
        running.carry_out(kept, planning.unlike(plan), 1, quiet, draw_run)
        made = report.made("sagild", folders, plan, kept, "coastwatch reproduce sagild")
        page = report.written_page(kept, made).read_text("utf-8")
        assert "data:image/svg+xml;base64," in page
        assert report.written_numbers(kept, made).exists()
        if name == "synchronous":
            exact = {line.figure.name: line.bound.mean for line in made.folders[0].lines if line.figure.bound}
            assert exact["ANEES, dependent, noise 3, radar 20"] == pytest.approx(4.0, abs=1e-3)
            assert any(">exact<" in part for part in page.split("th"))
            lines = {line.figure.name: line for line in made.folders[0].lines}
            assert lines["manoeuvring index, noise 3, radar 20"].against_published == "equal within 2 standard errors"
        if name == "normal":
            record = made.folders[0].made[0].records[0]["scores"]
            assert len(record["pairs"]) == len(folders["sagild-normal"].side_by_side.associations)
            curves = [f"counting {m} {n + 1} {n}" for m in (10, 20, 30, 40) for n in (1, 2, 3, 4, 5)]
            assert {*curves, *(f"test {a}" for a in (0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99))} <= set(record["pairs"])
            assert all(one["tp"] + one["tn"] >= 0 for one in record["pairs"].values())


def test_complete_systems_are_scored_against_the_true_vessels(tmp_path: Path) -> None:
    of = published.chosen("sagild", ("complete",))["sagild-complete"]
    few = {"variant": (of.named("track_01"), of.named("measurement_01")), "ordering": of.ordering[:1]}
    wanted = tuple(f for f in of.figure if f.default in ("track_01", "measurement_01"))
    folders = {"sagild-complete": of.model_copy(update={**few, "figure": wanted})}
    plan, kept = planning.plan(folders, 1, "test", ("cycles=40",)), FinishedRuns(str(tmp_path))
    running.carry_out(kept, planning.unlike(plan), 1, quiet, draw_run)
    made = report.made("sagild", folders, plan, kept, "coastwatch reproduce sagild")
    fused, taken = (one.records[0]["scores"]["system"] for one in made.folders[0].made)
    for found in (fused, taken):
        assert 0.3 < found["present"] <= 1.0
        assert 0.0 < found["position_rmse_m"] < found["rmse"] < 30.0
        assert found["ospa2_m"] <= 100.0
        swept = found["ospa2"]
        assert set(swept) == {"n1", "n5", "n15", "n20", "c20", "c50", "c200", "c300", "p1", "p4", "p8"}
        assert swept["c20"] < swept["c50"] < found["ospa2_m"] < swept["c200"] < swept["c300"]
        powers = [swept["p1"], found["ospa2_m"], swept["p4"], swept["p8"], 100.0]
        assert np.diff(powers).min() > -1e-9, "a mean of higher order is no smaller; of one vessel all are equal"
        parts = found["gospa_localisation_m"] ** 2 + 0.5 * 200.0**2 * (found["gospa_missed"] + found["gospa_false"])
        assert found["gospa_m"] ** 2 <= parts, "a mean is below the root of the mean square"
        assert 0.0 <= found["late_s"] < 40.0
    assert fused != taken
    assert all(line.measured.values for line in made.folders[0].lines)
    page = report.written_page(kept, made).read_text("utf-8")
    assert "rmse: track_01 &lt; measurement_01" in page
    assert "OSPA(2)</th>" in page


def test_two_methods_of_a_variant_are_compared_and_their_names_may_have_dots() -> None:
    of = published.chosen("sagild", ("normal",))["sagild-normal"]
    claim = next(o for o in of.ordering if o.than == "pairs.counting 30 4 3.initialisation_s")
    assert claim.title == "initialisation_s: test 0.01 < counting 30 4 3 (fast)"
    pairs = [{"test 0.01": {"initialisation_s": t}, "counting 30 4 3": {"initialisation_s": 4.0}} for t in (0.5, 0.0, None)]
    records = tuple({"scores": {"pairs": one}} for one in pairs)
    made = [Made(planning.Wanted(of.named("fast"), (), (), ()), records)]
    (order,) = orders(of.model_copy(update={"ordering": (claim,)}), made)
    assert order.difference.values == (3.5, 4.0)
    assert order.verdict == "holds"


def test_two_points_of_a_sweep_are_compared() -> None:
    of = published.chosen("liland", ("tracking",))["liland-tracking"]
    claim = next(o for o in of.ordering if o.against == {"tracks.window": 1})
    assert claim.title == "loss: literal < literal at window 1"
    variant, detection = of.named("literal"), "input.detection_probability,tracks.detection_probability"
    made = []
    for window, loss in ((1, 0.9), (3, 0.5)):
        point = (("input.transponders", "S0"), (detection, 0.5), ("tracks.window", window))
        records = tuple({"scores": {"paths": {"loss": loss + more}}} for more in (0.0, 0.01, 0.02))
        made.append(Made(planning.Wanted(variant, point, (), ()), records))
    (order,) = orders(of.model_copy(update={"ordering": (claim,)}), made)
    assert order.point == made[1].wanted.point
    assert order.difference.mean == pytest.approx(0.4)
    assert order.verdict == "holds"
    other = replace(order, difference=figures.Spread((-0.1, 0.05)))
    folder = report.Folder("liland-tracking", of, tuple(made), (), (order, other, replace(order, difference=figures.Spread())))
    said = html_report.in_short(report.Reproduction("liland", (folder,), "", "", {}, ""))
    assert said[-1] == "Their differences, means over the runs: 1 as ordered, 0 zero, 1 reversed."


def test_each_way_to_begin_a_track_is_compared_with_and_without_ais() -> None:
    of = published.chosen("liland", ("initiation",))["liland-initiation"]
    points = [(claim, dict(point)) for claim in of.ordering for point in of.points(of.named(claim.less))]
    compared = [point for claim, point in points if all(point.get(key) in wanted for key, wanted in claim.at.items())]
    assert len(compared) == 4 * 3 * 12 * 3  # transponders, probabilities of detection, m/n, densities of clutter


def test_targets_have_as_many_runs_as_are_asked_for() -> None:
    of = published.chosen("liland", ("tracking",))
    made = planning.plan(of, 30, "test")["liland-tracking"]
    asked = [figure for figure in of["liland-tracking"].figure if figure.asked is not None]
    for figure in asked:
        (one,) = (w for w in made if w.variant.name == figure.asked_of and figure.at.items() <= dict(w.point).items())
        assert len(one.jobs) == 30
    assert len(asked) == 16


def test_each_point_of_a_sweep_changes_one_of_window_cutoff_and_order() -> None:
    swept = systems.Systems().swept()
    assert [swept[name] for name in ("n1", "c300", "p4")] == [(1, 100.0, 2.0), (10, 300.0, 2.0), (10, 100.0, 4.0)]


def test_systems_are_matched_once_and_only_nearby() -> None:
    """Two estimates near the first vessel, none near the second, one far from all."""
    estimate, true = np.array([[0.0, 30.0], [10.0, 0.0], [5e3, 0.0]]), np.array([[0.0, 0.0], [900.0, 0.0]])
    row, column = systems.matches(estimate, true, 100.0)
    assert (row.tolist(), column.tolist()) == ([1], [0])
    row, column = systems.matches(np.zeros((0, 2)), true, 100.0)
    assert len(row) == len(column) == 0


# ---- what runs ------------------------------------------------------------------------------------------------------


def test_every_published_table_and_figure_has_a_folder() -> None:
    said = " ".join(figure.source for of in rangel().values() for figure in of.figure)
    wanted = {"Fig. 2", "Fig. 3", *(f"Table {n}" for n in ("I", "II", "III", "IV", "V", "VI", "VII", "VIII"))}
    assert wanted <= set(re.findall(r"Fig\. \d|Table [IV]+", said))


def test_a_folder_runs_and_fills_the_columns_that_it_names(whole: tuple[report.Reproduction, Path]) -> None:
    columns_are_filled(whole[0])


@pytest.mark.slow
def test_the_other_folders_do_so_too(tmp_path: Path) -> None:
    columns_are_filled(reproduced(tmp_path, tuple(name for name, of in rangel().items() if not of.picture and name not in TWO)))


def columns_are_filled(said: report.Reproduction) -> None:
    """Every method has a value in each line, and a bound where the figure names one."""
    for folder in said.folders:
        first = {key: values[0] for key, values in folder.of.sweep.items()}
        for line in folder.lines:
            late = re.match(r"history\.(\d+)", line.figure.path)  # a short run does not last so long
            if line.figure.at not in ({}, first) or (late and int(late[1]) > 45):
                continue
            assert line.measured.values, f"{folder.name}: {line.figure.name}, {line.variant.name}"
            assert bool(line.bound.values) == bool(line.figure.bound), f"{folder.name}: {line.figure.name}"


def test_equal_runs_of_two_tables_are_made_once() -> None:
    plan = planning.plan({name: rangel()[name] for name in ("rangel-table-5", "rangel-table-7")}, 2, "test")
    keys = {name: [job.key for one in wanted for job in one.jobs] for name, wanted in plan.items()}
    assert all(len(set(of)) == len(of) for of in keys.values())
    assert set(keys["rangel-table-5"]) <= set(keys["rangel-table-7"])
    assert len(planning.unlike(plan)) == len(keys["rangel-table-7"])


def test_timed_runs_come_last_and_as_many_as_the_paper_averages() -> None:
    plan = planning.plan(rangel(), None, "test")
    serial = [job.serial for job in planning.unlike(plan)]
    assert serial == sorted(serial)
    assert any(serial)
    runs = {name: {len(w.jobs) for w in wanted} for name, wanted in plan.items()}
    assert runs["rangel-table-5"] == runs["rangel-table-6"] == {30, 10}, (
        "readings of the paper that are not its columns need fewer"
    )
    assert runs["rangel-table-8"] == {10}
    assert runs["rangel-tables-1-2"] == {10, 3}, "a sweep's own points need fewer"
    assert [job.seed for job in plan["rangel-tables-1-2"][0].jobs] == list(range(1000, 1010))


def test_the_screen_shows_what_figure_2_shows_and_counts_it_nowhere(tmp_path: Path) -> None:
    said = reproduced(tmp_path, ("rangel-figure-2",), ())
    lines = said.folders[0].lines
    assert [line.measured.values for line in lines] == [(1.0,), (1.0,), (1.0,), (2.0,)]
    assert {(line.reached, line.against_published) for line in lines} == {(None, "")}
    page = report.written_page(FinishedRuns(str(tmp_path)), said).read_text("utf-8")
    assert "data:image/png;base64,iVBOR" in page
    assert "Figures of a scene laid out by hand to give them, counted nowhere: 4." in page


def test_the_seed_of_the_first_run_can_be_given() -> None:
    folders = published.chosen("rangel", ("figure-2",))
    (wanted,) = planning.plan(folders, 3, "test", seed=3001)["rangel-figure-2"]
    assert [job.seed for job in wanted.jobs] == [3001, 3002, 3003]


# ---- what is kept ---------------------------------------------------------------------------------------------------


def test_an_interrupted_reproduction_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    line = ["reproduce", "rangel", "--only", "tables-3-4", "--runs", "2", "--output", str(tmp_path)]
    jobs = planning.unlike(planning.plan(published.chosen("rangel", ("tables-3-4",)), 2, finished_runs.code()))
    seen: list[str] = []

    def measured(job: planning.Job, draw: measuring.Draw) -> dict[str, Any] | None:
        seen.append(job.key)
        return None if len(seen) == 6 else {"seed": job.seed, "scores": {}, "timings_s": {}, "history": {}, "elapsed_s": 1.0}

    monkeypatch.setattr(running, "measure", measured)
    assert main(line) == 130
    assert f"interrupted with {len(jobs) - 5} of {len(jobs)} runs to do" in capsys.readouterr().err
    assert len(list((tmp_path / "runs").glob("*.json"))) == 5
    assert not (tmp_path / "report.html").exists()
    assert main(line) == 0
    assert f"{len(jobs)} runs, {len(jobs) - 5} of them to do" in capsys.readouterr().err
    assert sorted(seen) == sorted([*(job.key for job in jobs), seen[5]]), "every run once, the interrupted one again"
    assert main(line) == 0
    assert len(seen) == len(jobs) + 1
    assert (tmp_path / "report.html").exists()


def group_lives(number: int) -> bool:
    """Whether any process of this group is there; the server of forks goes a moment after its parent."""
    try:
        os.killpg(number, 0)
    except ProcessLookupError:
        return False
    return True


def test_ctrl_c_leaves_whole_files_and_no_process(start: Start, tmp_path: Path) -> None:
    line = ["reproduce", "sagild", "--only", "synchronous", "--workers", "2", "--output", str(tmp_path)]  # of 900 short runs
    going = start(*line, start_new_session=True)
    until = time.monotonic() + TIMEOUT_S
    while not list((tmp_path / "runs").glob("*.json")) and time.monotonic() < until:
        assert going.poll() is None
        time.sleep(0.2)
    os.killpg(going.pid, signal.SIGINT)
    _, err = going.communicate(timeout=TIMEOUT_S)
    assert going.returncode == 130, err
    assert "the same command continues" in err
    assert "Traceback" not in err
    kept = list((tmp_path / "runs").glob("*.json"))
    assert kept
    assert all(json.loads(path.read_text("utf-8"))["scores"] for path in kept)
    while group_lives(going.pid):
        assert time.monotonic() < until, "a process is left behind"
        time.sleep(0.2)


def test_a_file_that_is_not_whole_is_run_again(tmp_path: Path) -> None:
    kept = FinishedRuns(str(tmp_path))
    kept.keep("a", {"seed": 1})
    assert kept.record("a") == {"seed": 1}
    (tmp_path / "runs" / "a.json").write_text('{"seed": ', "utf-8")
    assert kept.record("a") is None
    assert kept.record("b") is None


def test_settings_seed_and_code_decide_the_key() -> None:
    def keys(code: str, *further: str) -> set[str]:
        folders = {"rangel-table-5": rangel()["rangel-table-5"]}
        return {job.key for job in planning.unlike(planning.plan(folders, 2, code, further))}

    assert keys("a") == keys("a")
    assert len(keys("a")) == 2 * len(rangel()["rangel-table-5"].variant)
    assert not keys("a") & keys("b")
    assert not keys("a") & keys("a", "cycles=7")
    assert re.fullmatch(r"[\d.]+\+[0-9a-f]{12}", finished_runs.code())


def test_the_digest_covers_every_module_of_the_folder_that_makes_records() -> None:
    """All that `measuring` imports, but the settings: they are in the key."""
    settings, folder = {"planning.py", "published.py"}, Path(finished_runs.__file__).parent
    reached, waiting = set[str](), ["measuring.py"]
    while waiting:
        reached.add(name := waiting.pop())
        for node in ast.walk(ast.parse((folder / name).read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("coastwatch.reproduction"):
                own = (node.module or "").removeprefix("coastwatch.reproduction").lstrip(".")
                files = {f"{own}.py"} if own else {f"{alias.name}.py" for alias in node.names}
                waiting += files - reached - settings
    assert set(finished_runs.MEASURING) == reached


def test_every_piece_of_work_is_done_once_over_processes() -> None:
    for count in (1, 2, 3, 9):
        assert sorted(over_processes(abs, [-1, -2, -3, -4, -5], count)) == [(-5, 5), (-4, 4), (-3, 3), (-2, 2), (-1, 1)]


# ---- what is written ------------------------------------------------------------------------------------------------


def test_the_page_stands_alone(whole: tuple[report.Reproduction, Path]) -> None:
    said, folder = whole
    text = report.written_page(FinishedRuns(str(folder)), said).read_text("utf-8")
    assert re.findall(r"https?:|<script|<link|@import|url\(", text) == []
    assert set(re.findall(r'src="([^"]{0,10})', text)) == {"data:image"}
    assert text.count("<table") == text.count("</table>") == 1 + 2 * len(said.folders)
    assert "as good as published" not in text
    assert "Not compared, and absent" in text
    assert text.count("<img") == sum(len(folder.of.plots) for folder in said.folders)
    for part in (*(folder.of.title for folder in said.folders), "always associate", "MCC", "seeds 1000"):
        assert part in text
    assert "nan" not in re.sub(r'src="[^"]*"', "", text)


def test_a_published_value_stands_in_the_line_of_the_papers_own_method_alone() -> None:
    for name, of in {n: x for folders in published.papers().values() for n, x in folders.items()}.items():
        for line in (line for line in figures.lines(of, ()) if line.published is not None):
            ours = line.variant.name == "default" and of.paper == "rangel"
            assert not ours or line.figure.by_hand, f"{name}: {line.figure.name}"


def test_every_value_that_is_not_compared_has_a_reason_and_every_missed_target_is_asked() -> None:
    courses = [f for n in (6, 8) for f in rangel()[f"rangel-table-{n}"].figure if f.name.endswith("Weighted Average, course")]
    assert [f.asked for f in courses] == [f.published for f in courses] == [1.09, 1.09, 1.08, 1.09]
    cells = [f for n in ("synchronous", "asynchronous") for f in published.chosen("sagild", (n,))[f"sagild-{n}"].figure]
    assert sum(f.equal and f.published is not None and not f.why_not for f in cells) == 108 + 9, (
        "Tables 11.2 to 11.13, and 11.1"
    )


@pytest.mark.parametrize(
    ("values", "verdict"),
    [((1.0,), "better"), ((1.5,), "worse"), ((1.05, 1.15), "equal within 2 standard errors"), ((1.4, 1.5), "worse"), ((), "")],
)
def test_a_method_is_compared_with_the_published_value_of_its_own(values: tuple[float, ...], verdict: str) -> None:
    of = rangel()["rangel-table-6"]
    figure = next(f for f in of.figure if f.name == "Weighted Average, course")
    assert Line(figure, of.named("literal weighted average"), Spread(values)).against_published == verdict
    assert Line(figure, of.named("default"), Spread(values)).against_published == ""
    even = figure.model_copy(update={"equal": True})
    other = {"better": "not decided: one run", "worse": "differs"}.get(verdict, verdict)
    other = "not decided: one run" if len(values) == 1 else other
    assert Line(even, of.named("literal weighted average"), Spread(values), runs_published=30).against_published == other
    counted = next(f for f in rangel()["rangel-tables-3-4"].figure if f.name == "TP")
    literal = rangel()["rangel-tables-3-4"].named("literal")
    assert "scene differs" in Line(counted, literal, Spread((1.0,))).not_compared


def test_a_missed_target_gives_the_exit_code_4_and_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    def measured(job: planning.Job, draw: measuring.Draw) -> dict[str, Any]:
        f1 = 0.5 if job.seed == 3001 else 0.4
        return {
            "seed": job.seed,
            "scores": {"bearing_associations": {"f1": f1}},
            "timings_s": {},
            "history": {},
            "elapsed_s": 1.0,
        }

    monkeypatch.setattr(running, "measure", measured)
    line = ["reproduce", "rangel", "--only", "tables-3-4", "--runs", "1", "--seed", "3001", "--output", str(tmp_path)]
    assert main(line) == 4
    said = capsys.readouterr().out
    assert "Targets of the project: 0 of 1 reached, 1 missed." in said
    assert "Fails: rangel-tables-3-4: F1, our default: 50.00 < 99.00 %" in said


def test_the_json_has_every_figure_and_every_run(whole: tuple[report.Reproduction, Path]) -> None:
    said, folder = whole
    made = json.loads(report.written_numbers(FinishedRuns(str(folder)), said).read_text("utf-8"))
    assert set(made) == {"schema", "paper", "command", "date_utc", "code", "machine", "scenarios"}
    assert made["schema"] == 2
    assert {"processor", "processors", "system", "python", "load"} == set(made["machine"])
    for name, scenario in made["scenarios"].items():
        assert set(scenario) == {"title", "figures", "orderings", "absent", "variants"}
        assert [f["name"] for f in scenario["figures"]] == [f.name for f in rangel()[name].figure for _ in f.variants]
        for variant in scenario["variants"]:
            assert set(variant) == {"name", "title", "settings", "at", "scenario", "runs"}
            assert [run["seed"] for run in variant["runs"]] == [1000]
            assert {"scores", "timings_s", "history", "elapsed_s"} <= set(variant["runs"][0])
    first = made["scenarios"]["rangel-tables-3-4"]
    literal, f1 = (f for f in first["figures"] if f["name"] == "F1")
    assert (literal["published"], literal["asked"]) == (0.9226, None)
    runs = next(v for v in first["variants"] if v["name"] == "default")["runs"]
    assert f1["measured"]["values"] == [run["scores"]["bearing_associations"]["f1"] for run in runs] == [f1["measured"]["mean"]]
    assert (f1["published"], f1["asked"], f1["unit"]) == (None, 0.99, "fraction of 1")


def test_decisions_swaps_and_the_baseline_fit_together(whole: tuple[report.Reproduction, Path]) -> None:
    for folder in whole[0].folders:
        for made in folder.made:
            for record in made.records:
                for stage in ("associations", "bearing_associations"):
                    said = record["scores"][stage]
                    total = said["tp"] + said["fn"] + said["fp"] + said["tn"]
                    assert total - said["swaps"] == said["decisions"]
                    assert 0 <= said["swaps"] <= min(said["fn"], said["fp"])


def test_a_path_leads_to_a_number_or_to_none() -> None:
    record = {"scores": {"a": {"f1": 0.5, "none": None}}, "timings_s": {"a": {"median": 2.0}}}
    assert at_path(record, "a.f1") == 0.5
    assert at_path(record, "timings_s.a.median") == 2.0
    assert at_path(record, "a.none") is at_path(record, "b.f1") is at_path(record, "a.f1.deeper") is None


def test_a_roc_curve_counts_what_every_threshold_accepts() -> None:
    rng = np.random.default_rng(5)
    true, wrong = (np.sort(rng.normal(mean, 1.0, count))[::-1] for mean, count in ((3.0, 200), (0.0, 300)))
    said = {"true": list(true), "wrong": list(wrong), "true_count": 250, "wrong_count": 1000}
    false_rate, true_rate = roc_curve([said])
    assert (np.diff(false_rate) >= 0.0).all()
    assert (np.diff(true_rate) >= 0.0).all()
    cut = wrong[-1]
    assert true_rate[-1] == (true >= cut).sum() / 250
    assert false_rate[-1] == 0.3


def test_whole_paths_are_scored_and_a_gain_is_of_means(tmp_path: Path) -> None:
    """A look of the figure's variant, and the ratio to another point of means, where a run alone may have a divisor of 0."""
    of = published.chosen("liland", ("shadow",))["liland-shadow"]
    ours = next(f for f in of.figure if f.default == "vimmjipda")
    folders = {"liland-shadow": of.model_copy(update={"variant": (of.named("vimmjipda"),), "figure": (ours,)})}
    plan, kept = planning.plan(folders, 1, "test", ("cycles=30", "input.clutter_per_m2=1e-7")), FinishedRuns(str(tmp_path))
    running.carry_out(kept, planning.unlike(plan), 1, quiet, draw_run)
    made = report.made("liland", folders, plan, kept, "coastwatch reproduce liland")
    paths = made.folders[0].made[0].records[0]["scores"]["paths"]
    assert paths["online_tracking"] == paths["tracking"] > 0.8
    assert paths["loss"] < 0.3
    assert 0.0 < paths["online_rmsd_m"] < 15.0
    assert "track loss" in report.written_page(kept, made).read_text("utf-8")
    key, variant = "input.clutter_per_m2", of.named("vimmjipda")
    figure = ours.model_copy(update={"path": "a", "over": "", "at": {key: 1.0}, "against": {key: 2.0}, "of_means": True})
    both = [(1.0, ({"a": 1.0}, {"a": 3.0})), (2.0, ({"a": 0.0}, {"a": 4.0}))]
    points = [Made(planning.Wanted(variant, ((key, point),), (), ()), records) for point, records in both]
    (line,) = figures.lines(of.model_copy(update={"figure": (figure,)}), points)
    assert line.measured.values == (0.5, 1.5)
