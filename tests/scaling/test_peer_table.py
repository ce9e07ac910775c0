"""The driver: its table, and its message about a peer that cannot run."""

import sys
from pathlib import Path

import pytest

from scaling.peers import run
from scaling.peers.environment import Environment
from scaling.peers.run import COMPARISONS, HEADS, Comparison, table

pytestmark = pytest.mark.contract

ROW = {
    "peer": "stonesoup",
    "task": "association",
    "tracks": 200,
    "cycles": 40,
    "measured": 20,
    "versions": {"stonesoup": "1.9.1"},
    "peer_ms": 163.5,
    "ours_ms": 2.0,
    "ratio": 81.75,
    "peer_us_each": 654.0,
    "size_of": "tracks",
    "unit": "pair of tracks over 40 cycles",
    "figure": "F1 %",
    "peer_quality": 99.25,
    "ours_quality": 100.0,
}
RESULT = {
    "machine": {"processor": "A", "processors": 2, "system": "L", "python": "3.11.7", "load": 0.5},
    "date": "2026-11-21T12:00Z",
    "clock": "cpu",
    "seed": 1,
    "rows": [ROW],
    "environments": ["stonesoup: /out"],
    "missing": ["filterpy: left out"],
}


def test_the_table_has_times_ratio_and_quality_of_both() -> None:
    lines = table(RESULT)
    assert lines[0] == "# A, 2 processors, load 0.5, Python 3.11.7, 2026-11-21T12:00Z"
    assert "processor time of all threads" in lines[1]
    assert "default settings of" in lines[2]
    head, row = lines[3], lines[4]
    assert [head.index(name) for name in HEADS[:3]] == sorted(head.index(name) for name in HEADS[:3])
    words = row.split()
    assert words[:7] == ["stonesoup", "association", "200", "163.50", "2.00", "81.8", "654"]
    assert words[-3:] == ["%", "99.25", "100.00"]
    assert lines[5:] == ["# stonesoup: /out", "# filterpy: left out"]
    assert "wall time" in table(RESULT | {"clock": "wall"})[1]


def test_tracks_of_a_peer_have_more_figures_below_their_row() -> None:
    peer = {"completeness": 0.98, "false_tracks": 1.5, "rmse_m": 9.0, "gospa_m": 12.0}
    row = ROW | {"task": "tracking", "size_of": "vessels", "peer_figures": peer, "ours_figures": peer | {"rmse_m": 8.25}}
    lines = table(RESULT | {"rows": [row]})
    assert lines[5] == "#   stonesoup: completeness 0.980, 1.50 false tracks a cycle, RMSE 9.00 m"
    assert lines[6].endswith("ours: completeness 0.980, 1.50 false tracks a cycle, RMSE 8.25 m")


def test_a_peer_that_cannot_run_is_reported(monkeypatch) -> None:
    monkeypatch.setattr(run, "prepare", lambda peer: Environment(None, f"{peer}: left out"))
    result = run.run([c for c in COMPARISONS if not c.product], 1, "cpu")
    assert result["rows"] == []
    assert result["missing"] == ["stonesoup: left out", "filterpy: left out", "scipy: left out"]


def test_an_adapter_that_fails_does_not_stop_the_others(monkeypatch) -> None:
    monkeypatch.setattr(run, "prepare", lambda peer: Environment(Path(sys.executable), f"{peer}: here"))
    wanted = [Comparison("filterpy", "fusion_by_filterpy", 30, 3, 1), Comparison("scipy", "fusion", 30, 3, 1)]
    result = run.run(wanted, 1, "cpu")
    assert [r["peer"] for r in result["rows"]] == ["scipy"]
    assert len(result["missing"]) == 1
    assert result["missing"][0].startswith("scaling.peers.filterpy.adapter fusion_by_filterpy: ")
    (row,) = result["rows"]
    assert row["ratio"] == pytest.approx(row["peer_ms"] / row["ours_ms"])
    assert row["peer_quality"] == pytest.approx(row["ours_quality"], rel=1e-3)


def test_every_comparison_is_a_task_that_both_have() -> None:
    from scaling.peers import ours
    from scaling.peers.filterpy import adapter as filterpy
    from scaling.peers.filterpy import method
    from scaling.peers.scipy import adapter as scipy

    by_stone_soup = {"association", "counting", "tracking", "tracking_jpda"}
    tasks = {"filterpy": filterpy.TASKS, "scipy": scipy.TASKS, "stonesoup": by_stone_soup}
    for c in COMPARISONS:
        assert c.task in (method.TASKS if c.product else tasks[c.peer])
        assert run.kind_of(c.task) in ours.TASKS
        assert 0 < c.measured < c.cycles


@pytest.mark.parametrize("words", [["--peer", "stonesoup", "--task", "imm"], ["--size", "3"]])
def test_an_unknown_comparison_is_refused(words, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["run", *words])
    with pytest.raises(SystemExit):
        run.main()
    assert "needed" in capsys.readouterr().err
