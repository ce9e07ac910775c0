"""Each command on a real run: a scenario is run once, then looked at in every way the command line offers."""

import contextlib
import csv
import io
import json
import re
import signal
import socket
import sqlite3
import subprocess
import time
from pathlib import Path

import polars
import pytest
from run_world import FinishedRun, Start

from coastwatch import store
from coastwatch.batches import Flag
from coastwatch.errors import StoreError
from coastwatch.operators import presentation, verdict
from coastwatch.operators.cli import main
from coastwatch.server.feeds import live_input
from coastwatch.store.processes import this_process
from coastwatch.store.schema import migrate
from coastwatch.store.schema.tables import REVISION

pytestmark = pytest.mark.contract

PATIENCE_S = 600.0  # a busy machine that compiles the kernels for the first time


def answer(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def test_a_run_on_live_feeds_is_shown_without_a_total() -> None:
    assert presentation.ENDLESS == live_input.ENDLESS, "`runs` knows a run without an end by its planned cycles"


def test_the_json_of_a_run(finished_run: FinishedRun) -> None:
    url, made = finished_run.url, finished_run.printed
    assert made["database"] == url
    assert (made["scenario"], made["seed"], made["cycles"], made["interrupted"]) == ("guanabara", 3, 30, False)
    assert made["vessels"] > 200
    assert {"tp", "fn", "fp", "tn", "accuracy", "precision", "recall", "f1", "specificity", "mcc"} <= set(
        made["scores"]["associations"]
    )
    assert {"position_rmse_m", "course_rmse_deg", "speed_rmse_kn", "bound_position_rmse_m"} <= set(
        made["scores"]["fused_tracks"]
    )
    assert {"tracks", "associations", "store"} <= set(made["timings_s"])
    assert {"median", "p99", "total", "share"} == set(made["timings_s"]["tracks"])


def test_the_picture_is_the_same_in_every_format(
    finished_run: FinishedRun, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    url, made = finished_run.url, finished_run.printed
    rows = list(csv.DictReader(io.StringIO(answer(["picture", "--db", url, "--format", "csv"], capsys))))
    assert len(rows) == made["vessels"]
    with_ais = [row for row in rows if row["mmsi"]]
    assert with_ais
    assert all(len(row["mmsi"]) == 9 for row in with_ais)
    assert all(row["time_utc"].endswith("Z") for row in rows)
    geo = json.loads(answer(["picture", "--db", url, "--format", "geojson"], capsys))
    assert [f["properties"]["vessel_id"] for f in geo["features"]] == [int(row["vessel_id"]) for row in rows]
    path = tmp_path / "p.parquet"
    assert answer(["picture", "--db", url, "--format", "parquet", "--output", str(path)], capsys) == ""
    assert polars.read_parquet(path)["vessel_id"].to_list() == [int(row["vessel_id"]) for row in rows]
    table = answer(["picture", "--db", url], capsys).splitlines()
    assert len(table) == len(rows) + 3
    assert table[0] == f"run 1 of guanabara, seed 3: {len(rows)} vessels at {rows[0]['time_utc']}"
    assert table[1].split() == list(presentation.MAIN_COLUMNS)


def test_the_picture_of_the_past_and_of_a_box(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    url = finished_run.url
    past = answer(["picture", "--db", url, "--at", "2025-06-01T12:00:30Z", "--format", "csv"], capsys)
    assert {row["time_utc"] for row in csv.DictReader(io.StringIO(past))} == {"2025-06-01T12:00:30.000Z"}
    half = answer(["picture", "--db", url, "--bbox", "-23.05,-44,-22,-43", "--format", "csv"], capsys)
    found = list(csv.DictReader(io.StringIO(half)))
    assert found
    assert all(float(row["latitude_deg"]) >= -23.05 for row in found)


def test_sensors(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    """The radars of the run are right, have AIS vessels in view, and are said to be so; the past has its own state."""
    url = finished_run.url
    said = json.loads(answer(["sensors", "--db", url, "--json"], capsys))
    named = {"ais": {"corcovado"}, "bearing": {"copacabana"}, "radar": {"pao-de-acucar", "ilha-rasa"}}
    assert {kind: {s["name"] for s in said if s["kind"] == kind} for kind in named} == named
    assert len(said) == 4
    said = sorted(said, key=lambda s: s["name"])
    assert all(s["heard_utc"].endswith("Z") for s in said)
    assert {s["state"] for s in said if s["kind"] == "radar"} <= {"unknown", "acquiring", "settled"}
    assert said[2]["spec"]["period_s"] == 3.0
    table = answer(["sensors", "--db", url], capsys).splitlines()
    assert len(table) == 2 + 4
    assert sum("azimuth_sigma_deg=0.3" in row for row in table) == 1
    assert "noise_factors" in table[0]
    assert all(s["range_noise_factor"] >= 1.0 and s["azimuth_noise_factor"] >= 1.0 for s in said if s["kind"] == "radar")
    begun = json.loads(answer(["sensors", "--db", url, "--json", "--at", "2025-06-01T12:00:04Z"], capsys))
    assert {s["time_utc"] for s in begun if s["kind"] == "radar"} == {"2025-06-01T12:00:03.000Z"}
    assert main(["sensors", "--db", url, "--at", "2025-06-01T11:00:00Z"]) == 1
    assert "holds nothing up to 2025-06-01T11:00:00Z" in capsys.readouterr().err


def test_a_track(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    url = finished_run.url
    said = json.loads(answer(["track", "1", "--db", url, "--json"], capsys))
    assert said["vessel_id"] == 1
    assert len(said["history"]) >= 2
    assert said["members"]
    assert {row["first_source"] for row in said["associations"]} <= {row["source"] for row in said["members"]}
    assert "log-likelihood ratio" in said["statistics"]["associations"]
    table = answer(
        ["picture", "--db", url, "--json", "--sort", "-sog_kn", "--limit", "2", "--columns", "vessel_id,sog_kn"], capsys
    )
    fast = json.loads(table)
    assert [list(row) for row in fast] == [["vessel_id", "sog_kn"]] * 2
    assert fast[0]["sog_kn"] >= fast[1]["sog_kn"]
    gpx = answer(["track", "1", "--db", url, "--format", "gpx"], capsys)
    assert gpx.count("<trkpt") == len(said["history"])
    text = answer(["track", "1", "--db", url], capsys)
    assert "vessel id" in text
    assert "\nhistory" in text
    assert main(["track", "999", "--db", url]) == 1
    assert "999" in capsys.readouterr().err


def test_runs_are_listed_deleted_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    db = f"sqlite:///{tmp_path / 'x.db'}"
    for seed in (4, 5, 6):
        made = ["run", "context-driven-100", "--seed", str(seed), "--db", db, "--json"]
        assert main([*made, *("--set", "input.count=4", "--set", "cycles=2", "--set", "warmup_s=3")]) == 0
    capsys.readouterr()
    listed = json.loads(answer(["runs", "--db", db, "--json"], capsys))
    assert [(run["run"], run["seed"], run["status"], run["cycles_stored"]) for run in listed] == [
        (3, 6, "finished", 3), (2, 5, "finished", 3), (1, 4, "finished", 3)
    ]  # fmt: skip
    assert "f1" in listed[0]["scores"]["associations"]
    with contextlib.closing(sqlite3.connect(tmp_path / "x.db")) as raw, raw:
        silent = "UPDATE run SET status = 'running', written_utc = '2020-01-01T00:00:00Z'"
        raw.execute(f"{silent}, machine = 'another', cycles = 9 WHERE id = 2")
        raw.execute(f"{silent}, process = ?, machine = ? WHERE id = 1", this_process()[::-1])  # it waits for its feeds
    head = answer(["picture", "--db", db, "--run", "2"], capsys).splitlines()[0]
    assert head.endswith("the run died after cycle 3 of 9")
    assert main(["picture", "--db", db, "--run", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    assert len(json.loads(out)) > 0
    assert "the run died after cycle 3 of 9" in err
    assert [line.split()[4] for line in answer(["runs", "--db", db], capsys).splitlines()[2:]] == [
        "finished",
        "died",
        "running",
    ]
    assert main(["runs", "delete", "1", "--db", db]) == 1
    assert "run 1 is being written" in capsys.readouterr().err
    assert main(["runs", "delete", "--db", db]) == 2
    assert main(["runs", "delete", "9", "--db", db]) == 1
    capsys.readouterr()
    answer(["runs", "delete", "2", "--db", db], capsys)
    assert main(["runs", "keep", "0", "--db", db]) == 2  # it would delete every run
    assert "runs keep: got 0, needed 1 or more" in capsys.readouterr().err
    assert len(answer(["runs", "keep", "1", "--db", db], capsys).splitlines()) == 4
    assert [run["run"] for run in json.loads(answer(["runs", "--db", db, "--json"], capsys))] == [3, 1]


def test_a_figure_that_fell_is_said_with_exit_code_4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    db = tmp_path / "x.db"
    line = ["run", "context-driven-100", "--db", f"sqlite:///{db}", "--json", "--compare", "last"]
    line += [*("--set", "input.count=4", "--set", "cycles=2", "--set", "warmup_s=3")]
    assert main([*line, "--require", "fused_tracks.position_rmse_m>0"]) == 0
    assert "there is no earlier good run" in capsys.readouterr().err
    assert main([*line, "--require", "fused_tracks.position_rmse_m<0", "--require", "picture.dark_recall>=0.5"]) == 4
    said = capsys.readouterr().err
    assert "fused_tracks.position_rmse_m is " in said
    assert "picture.dark_recall was not scored, required >= 0.5" in said
    with contextlib.closing(sqlite3.connect(db)) as raw, raw:  # the run that fell was better; it is not compared with
        raw.execute("UPDATE run SET scores = json_set(scores, '$.fused_tracks.position_rmse_m', 1e-6) WHERE id = 2")
    assert main(line) == 0
    with contextlib.closing(sqlite3.connect(db)) as raw, raw:
        raw.execute("UPDATE run SET scores = json_set(scores, '$.fused_tracks.position_rmse_m', 1e-6) WHERE id = 3")
    capsys.readouterr()
    assert main(line) == 4
    assert "fused_tracks.position_rmse_m rose from 1e-06 in run 3 to " in capsys.readouterr().err
    listed = json.loads(answer(["runs", "--db", f"sqlite:///{db}", "--json"], capsys))
    assert [len(run["verdict"]) for run in listed] == [1, 0, 2, 0]
    assert main([*line, "--keep", "1"]) == 4
    capsys.readouterr()
    listed = json.loads(answer(["runs", "--db", f"sqlite:///{db}", "--json"], capsys))
    assert [run["run"] for run in listed] == [5, 3]  # the newest, and the last good one, with which the next is compared
    assert main([*line, "--require", "f1=3"]) == 2
    assert "got 'f1=3', needed FIGURE>=NUMBER" in capsys.readouterr().err
    assert main([*line, "--require", "association.f1>=0.5"]) == 2  # before the first cycle: no run is made
    assert "did you mean 'associations.f1'?" in capsys.readouterr().err
    assert len(json.loads(answer(["runs", "--db", f"sqlite:///{db}", "--json"], capsys))) == 2


@pytest.mark.parametrize(
    ("now", "fell"),
    [
        ({"f1": 0.949}, []),
        ({"f1": 0.94}, ["a.f1 fell"]),
        ({"f1": 1.0}, []),
        ({}, ["a.f1 was not scored"]),
        ({"f1": None}, ["a.f1"]),
    ],
)
def test_a_share_may_fall_by_the_tolerance(now: dict[str, float | None], fell: list[str]) -> None:
    said = verdict.worse_than({"a": now}, 1, {"a": {"f1": 0.95, "tp": 7}}, 0.002)
    assert len(said) == len(fell)
    assert all(sentence.startswith(start) for sentence, start in zip(said, fell, strict=True))


def test_alarms_of_a_span_and_of_a_vessel(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    url = finished_run.url
    line = ["query", "alarms", "--db", url, "--format", "csv"]
    found = list(csv.DictReader(io.StringIO(answer([*line, "--kind", "dark"], capsys))))
    assert found
    assert {row["kind"] for row in found} == {"dark"}
    start = found[-1]["start_utc"]
    until = list(csv.DictReader(io.StringIO(answer([*line, "--kind", "dark", "--to", start], capsys))))
    assert {row["start_utc"] for row in until} == {start}
    of_vessel = json.loads(answer(["track", found[0]["vessel_id"], "--db", url, "--json"], capsys))["events"]
    assert ("dark", found[0]["start_utc"]) in [(event["kind"], event["start_utc"]) for event in of_vessel]
    assert main([*line, "--kind", "darc"]) == 2
    assert "parameter kind: got 'darc', needed one of alarms, dark" in capsys.readouterr().err
    assert main([*line, "--kind", "dark", "--set", "kind=coasting"]) == 2
    assert "got --kind dark and --set kind=coasting" in capsys.readouterr().err


def test_every_question_has_an_answer(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    url = finished_run.url
    listed = answer(["query"], capsys)
    needed = {"mmsi": "123456789", "latitude_deg": "-23.05", "longitude_deg": "-43.1"}
    for name, question in store.operator_queries().items():
        assert name in listed
        given = [f"--set={key}={needed[key]}" for key, p in question.parameters.items() if p.default is None]
        answer(["query", name, "--db", url, *given], capsys)
        then = answer(["query", name, "--db", url, "--json", "--at", "2025-06-01T12:00:30Z", *given], capsys)
        assert isinstance(json.loads(then), list)


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["sunken"], "sunken"),
        (["fastest", "--set", "knots=3"], "knots"),
        (["history_of_mmsi"], "mmsi"),
        (["history_of_mmsi", "--set", "mmsi=12345"], "parameter mmsi: got '12345', needed nine digits"),
        (["fastest", "--set", "count=-1"], "parameter count: got '-1', needed 0 or more"),
        (["fastest", "--run", "0"], "parameter run: got '0', needed 1 or more"),
        (["fastest", "--run", "1", "--set", "run=2"], "--run 1 and --set run=2"),
        (
            ["near_position", "--set", "latitude_deg=91", "--set", "longitude_deg=0"],
            "parameter latitude_deg: got '91', needed -90 to 90",
        ),
    ],
)
def test_a_wrong_question_is_bad_input(
    arguments: list[str], wanted: str, finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", *arguments, "--db", finished_run.url]) == 2
    assert wanted in capsys.readouterr().err


def test_a_question_of_a_run(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]) -> None:
    url, made = finished_run.url, finished_run.printed
    latest = answer(["query", "fastest", "--db", url], capsys)
    assert answer(["query", "fastest", "--db", url, "--run", str(made["run_id"])], capsys) == latest
    assert answer(["query", "fastest", "--db", url, "--set", f"run={made['run_id']}"], capsys) == latest
    assert main(["query", "fastest", "--db", url, "--run", "99"]) == 1
    assert "there is no run 99" in capsys.readouterr().err


def test_a_picture_before_the_first_cycle_names_it_in_utc(
    finished_run: FinishedRun, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["picture", "--db", finished_run.url, "--at", "2025-06-01T11:00:00Z"]) == 1
    said = "holds nothing up to 2025-06-01T11:00:00Z, its first kept cycle is at 2025-06-01T12:00:03Z\n"
    assert capsys.readouterr().err.endswith(said)


def test_an_instant_after_the_end_of_a_run_is_warned_of(
    finished_run: FinishedRun, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Within a period of the last cycle there is nothing to say; the answer itself is the same."""
    url = finished_run.url
    (last_s,) = {row["time_utc"] for row in json.loads(answer(["picture", "--db", url, "--json"], capsys))}
    near = last_s.replace("30.000Z", "32.000Z")
    assert near != last_s
    now = answer(["picture", "--db", url, "--json", "--at", near], capsys)
    said = f"run 1 holds nothing at 2031-01-01T00:00:00.000Z: its last cycle is at {last_s}, and this answer is of then\n"
    for command in (["picture", "--json"], ["sensors"], ["query", "fastest"], ["plot", "--output", str(tmp_path / "p.png")]):
        assert main([*command, "--db", url, "--at", "2031-01-01T00:00:00Z"]) == 0
        out, err = capsys.readouterr()
        assert err == f"coastwatch: warning: --at: {said}"
        assert command[0] != "picture" or out == now


def test_a_plot(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    for more in ([], ["--at", "2025-06-01T12:00:30Z"], ["--bbox=-23.1,-43.2,-23.0,-43.1"]):
        assert answer(["plot", "--db", finished_run.url, "--output", str(path), *more], capsys) == f"{path}\n"
        assert path.read_bytes()[:4] == b"\x89PNG"
        path.unlink()
    answer(["plot", "--db", finished_run.url, "--output", str(path), "--vessel", "1", "--coastline", "none"], capsys)
    assert main(["plot", "--db", finished_run.url, "--output", str(path), "--vessel", "99999"]) == 2
    assert "--vessel: got 99999, needed ids of vessels in this picture" in capsys.readouterr().err


def test_bash_completes_commands_options_scenarios_and_questions(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    script = tmp_path / "completion.bash"
    script.write_text(answer(["completion", "bash"], capsys))
    assert answer(["completion", "zsh"], capsys).startswith("#compdef coastwatch")
    for words, wanted in (
        ("pic", "picture"),
        ("run guan", "guanabara"),
        ("query dark", "dark_vessels"),
        ("picture --bb", "--bbox"),
    ):
        typed = ["coastwatch", *words.split()]
        line = f'COMP_WORDS=({" ".join(typed)}); COMP_CWORD={len(typed) - 1}; _shtab_coastwatch; echo "${{COMPREPLY[@]}}"'
        done = subprocess.run(["bash", "-c", f"source {script}; {line}"], capture_output=True, text=True, check=False)
        assert wanted in done.stdout.split(), (words, done)


def test_a_database_is_checked_and_made(finished_run: FinishedRun, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert finished_run.url in answer(["db", "check", "--db", finished_run.url], capsys)
    url = f"sqlite:///{tmp_path / 'new.db'}"
    assert main(["db", "check", "--db", url]) == 1
    capsys.readouterr()
    assert answer(["db", "upgrade", "--db", url], capsys) == f"{url}: made with schema {REVISION}\n"
    said = answer(["db", "upgrade", "--db", finished_run.url], capsys)
    assert said == f"{finished_run.url}: up to date at schema {REVISION}, 1 run kept\n"
    old = f"sqlite:///{tmp_path / 'old.db'}"
    migrate.upgrade(old, "0004")
    assert answer(["db", "upgrade", "--db", old], capsys) == f"{old}: upgraded from schema 0004 to {REVISION}, 0 runs kept\n"
    answer(["db", "check", "--db", url], capsys)
    answer(["db", "check", "--db", str(tmp_path / "new.db")], capsys)  # a path names the same database
    assert main(["picture", "--db", url]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_tracks_as_csv_are_metres_from_the_centre(finished_run: FinishedRun) -> None:
    rows = list(csv.DictReader(finished_run.tracks_csv.open()))
    assert {"time", "track_id", "north", "east", "vn", "ve"} <= set(rows[0])
    assert len({row["time"] for row in rows}) == finished_run.printed["cycles"]
    metre_deg = 1.0 / 110_700.0  # of latitude, there
    for row in rows:
        assert abs(float(row["latitude_deg"]) - (-22.95 + float(row["north"]) * metre_deg)) <= 2e-4
        assert abs(float(row["east"])) < 20_000.0


def test_flags_are_words() -> None:
    assert presentation.flag_words(0) == ""
    assert presentation.flag_words(int(Flag.DARK | Flag.COASTING)) == "dark coasting"
    made = presentation.in_operator_units(
        store.Rows(("mmsi", "flags", "time_s", "silent_s"), [(2320001, 4, 0.0, 12.34567), (None, 0, 1.5, None)])
    )
    assert made.columns == ("mmsi", "flags", "time_utc", "silent_s")
    assert made.rows[0] == ("002320001", "ais_contradicted", "1970-01-01T00:00:00.000Z", 12.346)
    assert made.rows[1] == (None, "", "1970-01-01T00:00:01.500Z", None)


def test_a_course_is_never_360() -> None:
    made = presentation.in_operator_units(
        store.Rows(("cog_deg", "latitude_deg"), [(359.9999, 3.0), (359.99, 3.0), (None, 3.0)])
    )
    assert [row[0] for row in made.rows] == [0.0, 359.99, None]


def test_ctrl_c_ends_a_run_after_a_whole_cycle(start: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = f"sqlite:///{tmp_path / 'x.db'}"
    line = ["run", "context-driven-100", "--db", url, "--json", "--set", "input.count=14", "--set", "cycles=1000"]
    started = start(*line)
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and started.poll() is None and cycles_in(url) < 3:
        time.sleep(0.2)
    started.send_signal(signal.SIGINT)
    out, err = started.communicate(timeout=PATIENCE_S)
    assert started.returncode == 130, err
    assert "--resume" in err
    made = json.loads(out)
    assert made["interrupted"] is True
    assert cycles_in(url) == made["cycles"] >= 3
    answer(["db", "check", "--db", url], capsys)


def test_a_second_ctrl_c_ends_a_server_in_order_and_without_a_traceback(start: Start, finished_run: FinishedRun) -> None:
    served = start("serve", "--db", finished_run.url, "--port", "0")
    assert served.stderr is not None
    found = re.search(r"http://127\.0\.0\.1:(\d+)", served.stderr.readline())
    assert found
    with socket.create_connection(("127.0.0.1", int(found[1]))) as viewer:
        viewer.sendall(b"GET /api/v1/alarms/stream HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert viewer.recv(12) == b"HTTP/1.1 200"
        served.send_signal(signal.SIGINT)
        time.sleep(0.02)
        served.send_signal(signal.SIGINT)
        _, said = served.communicate(timeout=PATIENCE_S)
    assert served.returncode == 0, said
    assert said == "coastwatch: stopped\n"


def cycles_in(url: str) -> int:
    """Cycles stored of the newest run; 0 while there is no database."""
    try:
        with presentation.opened(url) as found:
            return int(store.runs(found).column("cycles_stored")[0])
    except (StoreError, IndexError):
        return 0
