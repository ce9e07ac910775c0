"""The commands of scaling/ run in a small size and print what their readers take; their command lines are in `tests/docs`."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from coastwatch.scenario import load_scenario
from scaling import bench
from scaling.decisions import literal_association
from scaling.load import cycle, queries, ramp, soak
from scaling.load.accuracy import Case, load_cases
from scaling.peers import environment, ours
from scaling.peers.environment import peers, pins
from scaling.peers.exchange import Stopwatch
from scaling.peers.filterpy import adapter as filterpy, method
from scaling.peers.input import make_history
from scaling.peers.plots import make_plots
from scaling.peers.quality import quality, track_figures
from scaling.peers.run import COMPARISONS, Comparison, kind_of
from scaling.peers.scipy import adapter as scipy

pytestmark = pytest.mark.contract

READERS: dict[str, Callable[[Any], list[bench.Row]]] = {"load.cycle": bench.cycle_rows, "load.chain.command": bench.chain_rows}
OF_A_RAMP = "--vessels 60 120 --width-nm 0.5 --cycles 3"

PRINTED = [
    ("load.cycle", "--tracks 500 --cycles 2 --warmup 2 --store sqlite:///{folder}/x.db --json", "decisions all f1"),
    ("load.cycle", "--tracks 200 --cycles 2 --warmup 1", "no plots; non-default settings: fused_tracks.method=convex"),
    (
        "load.chain.command",
        "--vessels 200 --region-vessels 100 --cycles 2 --warmup 6 --workers 1 --json",
        "quality tracks position_rmse_m",
    ),
    (
        "load.chain.command",
        "--vessels 60 --cycles 2 --warmup 1 --workers 1 --store sqlite:///{folder}/x.db",
        "1 regions, 2 radars",
    ),
    ("load.chain.stages", "60 2", "60 vessels, 1 regions"),
    ("load.dense", f"{OF_A_RAMP} --json", "runs 1 in_picture"),
    ("load.dense", OF_A_RAMP, "exponent"),
    ("load.soak", "--tracks 100 --minutes 1 --json", "minutes 0 wal_mib"),
    ("load.queries", "--points 6000 --vessels 150 --database {folder}/q.db --ask 3 --only box --warm --json", ""),
    ("load.seeds", "context-driven-100 --seeds 1-1 --set cycles=2 --set warmup_s=6 --json", "0 associations f1"),
    ("load.scenario_cost", "guanabara --set cycles=3 --set input.count=30 --json", "quality associations"),
    ("load.accuracy", "--seeds 1-1 --case base --set input.count=40 --set cycles=2 --set warmup_s=12", "base"),
    ("load.frames", "--vessels 300", "bytes: full"),
]
"""Module, words, and what is printed: a path into the JSON, or a text."""


@pytest.mark.parametrize(("module", "words", "wanted"), PRINTED)
def test_a_script_prints_its_figures(
    module: str, words: str, wanted: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "argv", [module, *words.format(folder=tmp_path).split()])
    importlib.import_module(f"scaling.{module}").main()
    printed = capfd.readouterr().out
    if "--json" not in words:
        assert wanted in printed
        return
    figures = found = json.loads(printed)
    for step in wanted.split():
        found = found[int(step) if isinstance(found, list) else step]
    assert found
    if module in READERS:
        assert bench.as_text(["# machine"], READERS[module](figures), []).count("\n") > 3


@pytest.mark.parametrize(
    ("main", "words", "code", "message"),
    [
        (cycle.main, "--tracks 0", 2, "--tracks: got '0', needed 1 or more"),
        (cycle.main, "--set period_s", 2, "--set: got 'period_s', needed KEY=VALUE"),
        (cycle.main, "--baseline /nowhere", 2, "needed a checkout with .venv/bin/python, and no --store"),
        (cycle.main, "--tracks 50 --set colour=red", 1, "error: --set colour: got 'red' for an unknown setting"),
        (soak.main, "--store :memory:", 2, "--store: got ':memory:', needed a database that"),
        (soak.main, "--tracks 50 --store /nowhere/x.db", 1, "error: /nowhere/x.db: there is no folder /nowhere"),
        (ramp.main, "--from 10 --to 10", 2, "got 10 and 10, needed the first below the last"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(
    main: Callable[[], None],
    words: str,
    code: int,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["command", *words.split()])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capfd.readouterr()
    assert (end.value.code, out) == (code, "")
    assert message in err.splitlines()[-1]
    assert "Traceback" not in err


def test_a_ramp_has_the_exponents_of_its_costs_over_large_sizes_and_from_one_to_the_next() -> None:
    """A stage that is not in every size has none."""
    runs = [
        {
            "tracks": n,
            "compute_s": {"median": 1e-3 * n**1.5},
            "compute_cpu_s": n,
            "stages_s": {"spots": {"median": 2 * n}} | ({"writer": 1.0} if n > 1000 else {}),
        }
        for n in (1000, 10_000, 100_000)
    ]
    found = ramp.exponents(runs, lambda f: f["tracks"], "stages_s", 10_000)
    powers = {"compute_s": 1.5, "compute_cpu_s": 1.0, "stages_s.spots": 1.0, "stages_s.writer": 0.0}
    assert found["exponent"] == pytest.approx(powers)
    assert found["local"]["stages_s.writer"] == [None, pytest.approx(0.0)]
    assert found["local"]["compute_s"] == pytest.approx([1.5, 1.5])


@pytest.mark.parametrize("there", [True, False])
def test_queries_delete_only_a_database_that_they_made(there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database, measured = tmp_path / "watch.db", []
    if there:
        database.write_text("of somebody else", "utf-8")
    monkeypatch.setattr(queries, "fill", lambda url, *_: Path(url.removeprefix("sqlite:///")).touch())
    monkeypatch.setattr(queries, "_measure", lambda url, options: measured.append(database.exists()))
    monkeypatch.setattr(sys, "argv", ["queries", "--database", str(database)])
    queries.main()
    assert measured == [True]
    assert database.exists() == there


@pytest.mark.parametrize("of", [c for c in COMPARISONS if c.peer != "stonesoup"], ids=lambda c: f"{c.peer} {c.task}")
def test_a_peer_does_its_task_on_our_input_about_as_well_as_we_do(of: Comparison) -> None:
    """Stone Soup is no dependency: it runs where `python -m scaling.peers.run` has made its environment."""
    theirs = (method if of.product else {"filterpy": filterpy, "scipy": scipy}[of.peer]).TASKS[of.task]
    kind = kind_of(of.task)
    if kind == "tracking":
        plots = make_plots(60, 14, 4, 1)
        a, b = (track_figures(plots, task(plots, Stopwatch())) for task in (theirs, ours.TASKS[kind]))
        assert a["rmse_m"] == pytest.approx(b["rmse_m"], rel=0.3)
        return
    history = make_history(90, 24, 3, 1)
    a, b = (quality(kind, history, task(history, Stopwatch()))[1] for task in (theirs, ours.TASKS[kind]))
    assert a == pytest.approx(b, rel=0.3 if kind == "spots" else 0.02)


def test_every_requirement_of_a_peer_is_an_exact_pin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(peers()) >= 3
    assert all(peer in pins(peer) for peer in peers())
    (tmp_path / "loose").mkdir()
    (tmp_path / "loose" / "requirements.txt").write_text("numpy==2.1.0\nscipy>=1.14\n", "utf-8")
    monkeypatch.setattr(environment, "HERE", tmp_path)
    with pytest.raises(ValueError, match=r"loose/requirements\.txt:2: got 'scipy>=1\.14', needed package==version"):
        pins("loose")


@pytest.mark.parametrize("case", load_cases(), ids=lambda case: case.name)
def test_a_case_of_accuracy_is_a_scenario_that_loads(case: Case) -> None:
    given = dict(setting.split("=", 1) for setting in case.settings)
    assert load_scenario(case.scenario, given).name == case.scenario


@pytest.mark.parametrize("case", literal_association.CASES)
@pytest.mark.parametrize("tracker", [{}, literal_association.DEAD_RECKONING], ids=["default", "of the paper"])
def test_a_case_of_literal_association_loads_with_the_default_tracks_and_those_of_the_paper(
    case: str, tracker: dict[str, str]
) -> None:
    """With the default tracks the settings of one were unknown."""
    loaded = load_scenario("context-driven-1000", literal_association.CASES[case] | tracker)
    assert loaded.tracks.method == tracker.get("tracks.method", "guided_vimmjipda")
