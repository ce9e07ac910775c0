"""The command line's promises to scripts: one line an error, exit codes, a quiet broken pipe, exactly one JSON object."""

import json
import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coastwatch.batches import Fault, FileContent, RadarCorrections
from coastwatch.formats.intake.accounts import UNACCOUNTED
from coastwatch.operators.cli import main, progress, summary
from coastwatch.scenario import load_scenario
from coastwatch.server.feeds import live_input
from coastwatch.server.feeds.address import parsed

pytestmark = pytest.mark.contract

TIMEOUT_S = 120


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        ([], "COMMAND"),
        (["sail"], "sail"),
        (["run"], "SCENARIO"),
        (["run", "x", "--seed", "-1"], "-1"),
        (["run", "x", "--seed", "1.5"], "1.5"),
        (["run", "x", "--workers", "0"], "needed 1 or more"),
        (["run", "x", "--set", "period_s"], "KEY=VALUE"),
        (["run", "x", "--resume", "--restart"], "not allowed with"),
        (["run", "no-such-scenario"], "no-such-scenario"),
        (["run", "/no/such/scenario.toml"], "/no/such/scenario.toml"),
        (["picture", "--at", "yesterday"], "yesterday"),
        (["picture", "--bbox=1,2,3"], "S,W,N,E"),
        (["picture", "--bbox=91,2,93,4"], "S < N"),
        (["track", "two"], "two"),
        (["query", "--format", "xml"], "xml"),
        (["fuse"], "fuse"),
        (
            ["serve", "guanabara", "--feed", "ias+listen://127.0.0.1:10110"],
            "feed: got 'ias+listen://127.0.0.1:10110', needed FORMAT",
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments: list[str], wanted: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("coastwatch: error: ")
    assert err.count("\n") == 1
    assert wanted in err


def stand_in(monkeypatch: pytest.MonkeyPatch, outcome: Any) -> dict[str, Any]:
    """Puts a run in the place of the real one; gives back what it was called with."""
    seen: dict[str, Any] = {}

    def run_scenario(scenario: Any, **given: Any) -> Any:
        seen.update(given, scenario=scenario)
        if isinstance(outcome, BaseException):
            raise outcome
        given["progress"](1, 2, "tracks")
        return outcome

    monkeypatch.setattr("coastwatch.operators.cli.runs.run_scenario", run_scenario)
    return seen


def outcome(**changed: Any) -> Any:
    counts = {"tp": 99, "fn": 1, "fp": 0, "tn": 3, "accuracy": 0.99, "precision": 1.0, "recall": 0.99, "f1": 0.995, "mcc": 0.9}
    fused = {"position_rmse_m": 1.5, "course_rmse_deg": np.float64(1.0), "speed_rmse_kn": np.nan, "bound_position_rmse_m": 1.25}
    fused |= {"count": 50, "bound_count": 50}
    made = {
        "run_id": np.int64(7),
        "scenario": "x",
        "seed": 5,
        "version": "0.1.0",
        "scores": {"associations": counts, "fused_tracks": fused, "dark": {"found_share": 0.5}},
        "timings_s": {"tracks": {"median": 0.003, "p99": 0.004, "total": 0.1, "share": 0.6}},
        "database": "sqlite:///x.db",
        "faults": (Fault("checksum", 3, "a.nmea:17", "!AIVDM,1,1"),),
        "contents": (FileContent("a.nmea", "AIS reports", 40, 1000.0, 1090.0, read=43),),
        "faults_of_input": (Fault("checksum", 3, "a.nmea:17", "!AIVDM,1,1"),),
        "vessels": 12,
        "cycles": 40,
        "elapsed_s": 1.25,
        "interrupted": False,
    }
    return types.SimpleNamespace(**{"corrections": RadarCorrections.empty(R=1), **made, **changed})


def a_scenario() -> Any:
    radar = types.SimpleNamespace(region="bay", latitude_deg=None)
    return types.SimpleNamespace(
        name="x", title="A trial", seed=5, period_s=3.0, radars=(radar,), stations=(), sonars=(radar, radar), input=None
    )


def test_json_is_one_object_and_not_a_number_is_null() -> None:
    made = json.loads(json.dumps(summary.as_object(a_scenario(), outcome()), allow_nan=False))
    assert {"scores", "timings_s", "database", "run_id", "vessels", "cycles", "elapsed_s", "faults", "scenario", "seed"} <= set(
        made
    )
    assert made["version"].count(".") == 2
    assert made["scores"]["fused_tracks"]["speed_rmse_kn"] is None
    assert (made["run_id"], made["seed"]) == (7, 5)


def test_the_summary_is_for_people() -> None:
    text = summary.as_text(a_scenario(), outcome())
    for wanted in (
        "12 vessels",
        "1 radar in 1 region",
        "2 bearing sensors",
        "F1 99.500 %",
        "1.20 x the bound of 1.25 m",
        "0.100 %",
    ):
        assert wanted in text
    for wanted in (
        "3 x checksum: a.nmea:17",
        "a.nmea: 40 AIS reports, 1970-01-01T00:16:40Z to ",
        "records: 43 read = 40 in reports + 3 refused + 0 set aside",
        "sqlite:///x.db",
        "coastwatch plot",
    ):
        assert wanted in text
    assert "nan" not in text


def test_the_summary_counts_the_files_that_were_given() -> None:
    scenario = a_scenario()
    scenario.radars = scenario.sonars = ()
    assert "sources: none" in summary.as_text(scenario, outcome())
    scenario.input = types.SimpleNamespace(nmea=("a", "b"), ais=("c",), plots=(), bearings=("d", "e"))
    assert "sources: 1 AIS table, 2 NMEA files, 2 tables of bearings\n" in summary.as_text(scenario, outcome())


@pytest.mark.parametrize(
    ("result", "code"),
    [
        (outcome(), 0),
        (outcome(faults=(Fault(UNACCOUNTED, 2, "a.nmea", ""),)), 1),
        (outcome(interrupted=True), 130),
        (KeyboardInterrupt(), 130),
        (OSError(28, "No space left on device"), 1),
    ],
)
def test_exit_codes_of_a_run(
    result: Any, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, result)
    monkeypatch.setattr("coastwatch.operators.cli.runs.load_scenario", lambda name, overrides: a_scenario())
    assert main(["run", "x", "--json"]) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    if not isinstance(result, BaseException):
        assert out.count("\n") == 1
        assert json.loads(out)["database"] == "sqlite:///x.db"


def test_options_reach_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = stand_in(monkeypatch, outcome())
    asked: dict[str, Any] = {}

    def load_scenario(name: str, overrides: Any) -> Any:
        asked.update(name=name, overrides=dict(overrides))
        return a_scenario()

    monkeypatch.setattr("coastwatch.operators.cli.runs.load_scenario", load_scenario)
    line = ["run", "x", "--seed", "9", "--workers", "2", "--db", "sqlite:///y.db", "--set", "radars.0.rpm=20", "--restart"]
    assert main([*line, "--set", "tracks.method=imm"]) == 0
    assert asked == {"name": "x", "overrides": {"radars.0.rpm": "20", "tracks.method": "imm"}}
    assert (seen["seed"], seen["workers"], seen["database"]) == (9, 2, "sqlite:///y.db")
    assert (seen["resume"], seen["restart"]) == (False, True)


def test_an_error_of_ours_names_its_kind_and_how_to_see_more(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, ZeroDivisionError("division\nby zero"))
    monkeypatch.setattr("coastwatch.operators.cli.runs.load_scenario", lambda name, overrides: a_scenario())
    assert main(["run", "x"]) == 1
    err = capsys.readouterr().err
    assert err == "coastwatch: error: ZeroDivisionError: division; by zero (COASTWATCH_TRACEBACK=1 shows where)\n"
    monkeypatch.setenv("COASTWATCH_TRACEBACK", "1")
    assert main(["run", "x"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_progress_without_a_terminal_is_a_line_soon_and_then_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(np.arange(0.0, 1e3, 4.0))
    monkeypatch.setattr("coastwatch.operators.cli.progress.time.monotonic", lambda: float(next(clock)))
    with progress.report_progress() as show:
        for done in range(1, 10):
            show(done, 9, "tracks")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["cycle 1 of 9: tracks", "cycle 4 of 9: tracks", "cycle 7 of 9: tracks"]


def test_a_broken_pipe_is_quiet() -> None:
    code = "import sys; from coastwatch.operators.cli import main; sys.exit(main(sys.argv[1:]))"
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-c", code, "scenarios"], stdout=write, stderr=subprocess.PIPE, timeout=TIMEOUT_S, check=False
    )
    os.close(write)
    assert done.returncode == 141
    assert done.stderr == b""


def test_a_scenario_for_live_feeds_has_no_input_and_is_refused_without_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is the example of the README of live feeds."""
    lines = (Path(live_input.__file__).parent / "README.md").read_text("utf-8").splitlines()
    begin, end = lines.index("    # coast.toml"), next(k for k, line in enumerate(lines) if "serve coast.toml" in line)
    path = tmp_path / "coast.toml"
    path.write_text("\n".join(line[4:] for line in lines[begin:end]))
    scenario = load_scenario(str(path))
    assert scenario.sensors().radars.name.tolist() == ["north"]
    for address in lines[end].split("--feed ")[1:]:
        parsed(address.strip(" '"))
    for command in (["run", str(path)], ["serve", str(path), "--db", str(tmp_path / "x.db"), "--port", "0"]):
        assert main(command) == 2
        assert "input: got none, needed [input] with a method, or live feeds" in capsys.readouterr().err
    to = ["--to", "json+udp://127.0.0.1:1"]
    assert main(["feed", str(path), *to]) == 2
    assert "input: got none" in capsys.readouterr().err
