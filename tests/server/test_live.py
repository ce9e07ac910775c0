"""A live run: pictures as time passes, stored as they were served, and an end after a whole cycle."""

from __future__ import annotations

import sqlite3
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx2 as httpx
import numpy as np
import pytest
from run_world import Start, column, stored
from server_world import events, listening, wait_for

from coastwatch import store
from coastwatch.batches import Flag
from coastwatch.errors import StoreError
from coastwatch.operators.api.service import Service
from coastwatch.operators.cli import main
from coastwatch.operators.typed import utc
from coastwatch.scenario import load_scenario
from coastwatch.server import clock
from coastwatch.server.alarm_book import Alarm
from coastwatch.server.input import Paced
from coastwatch.server.link import Backoff
from coastwatch.server.live import LiveRun
from coastwatch.server.live_picture import stored_statics
from coastwatch.store import AlarmKey
from coastwatch.store.schema import database
from coastwatch.store.schema.database import writing

pytestmark = pytest.mark.whole


def test_a_simulation_runs_with_the_clock_and_ends_after_a_whole_cycle_with_what_was_served(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'live.db'}"
    scenario = load_scenario("context-driven-100", {"period_s": "0.5", "warmup_s": "0", "cycles": "100", "input.count": "10"})
    with store.open_store(url) as opened:
        service = Service(opened)
        run = LiveRun(scenario, Paced(), service.receive, database=url, workers=1, resume=False)
        service.source = run
        with listening(service, web=tmp_path) as address:
            assert httpx.get(f"http://{address}/readyz").status_code == 503
            with run:
                wait_for(lambda: run.cycles >= 4, 300.0)  # kernels may be compiled first
                status = httpx.get(f"http://{address}/api/v1/status").json()
                assert (status["live"], status["error"]) == (True, None)
                assert 0 < status["vessels"] <= 10
                assert abs(status["age_s"]) < 30.0
            last = service.picture()
            assert httpx.get(f"http://{address}/api/v1/picture").json()["total"] == len(last)
        assert not run.failed
        assert store.newest_picture(opened, last.run_id) == (last.run_id, last.cycle, last.time_s)
        found = store.run(opened, last.run_id)
        assert (found["status"], found["cycles_stored"]) == ("interrupted", run.cycles)
        now = store.picture(opened, last.run_id)
        for name in ("vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "mmsi", "flags", "sources", "name"):
            assert last.rows(last.at(now.array("vessel_id"))).column(name) == now.column(name), name


def test_a_zone_that_is_drawn_raises_an_alarm_that_is_sent_acknowledged_and_noted(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'live.db'}"
    scenario = load_scenario("context-driven-100", {"period_s": "0.5", "warmup_s": "0", "cycles": "1000", "input.count": "10"})
    centre_deg = scenario.area.latitude_deg, scenario.area.longitude_deg
    with store.open_store(url) as opened:
        service = Service(opened)
        run = LiveRun(scenario, Paced(), service.receive, database=url, workers=1, resume=False)
        service.source = run
        with listening(service, web=tmp_path) as address, run:
            base = f"http://{address}/api/v1"
            wait_for(
                lambda: service.hub.picture is not None and (service.picture().array("sog_kn") > 1.0).any(), 300.0
            )  # kernels may be compiled first; a picture reaches the server after its cycle
            with httpx.stream("GET", f"{base}/alarms/stream", timeout=60.0) as stream:
                seen = events(stream)
                zone = {"name": "all", "kind": "circle", "centre_deg": centre_deg, "radius_nm": 100.0, "max_speed_kn": 0.5}
                drawn = httpx.post(f"{base}/zones", json=zone, timeout=60.0).json()["properties"]["number"]
                then_s = service.picture().time_s
                alarm = next(one for one in seen if one["kind"] == "zone_speed")
                said = {"name": "Ana", "note": "called on 16"}
                path = f"{base}/alarms/{alarm['alarm_id']}/acknowledge"
                assert httpx.post(path, json=said, timeout=60.0).status_code == 200
                again = next(one for one in seen if one["alarm_id"] == alarm["alarm_id"] and one["acknowledged_by"])
            assert (alarm["subject"], alarm["acknowledged_by"]) == (drawn, None)
            assert (again["acknowledged_by"], again["note"]) == ("Ana", "called on 16")
            wait_s = scenario.alarms.open_s + 30.0  # cycles of a machine that compiles kernels are late
            assert utc(alarm["start_utc"]) <= then_s + wait_s
            found = httpx.get(f"{base}/audit", timeout=60.0).json()["changes"]
            run_id = service.run_id()
    assert [(row["who"], row["path"].split("/")[3]) for row in found] == [("loopback", "alarms"), ("loopback", "zones")]
    assert found[0]["body"] == '{"name":"Ana","note":"called on 16"}'
    with store.open_store(url) as opened:
        rows, _ = store.alarms(opened, run_id, store.Asked())
        (kept,) = [row for row in rows.rows if row[rows.columns.index("acknowledged_s")] is not None]
        names = "vessel_id", "kind", "subject", "acknowledged_by", "note"
        said = [kept[rows.columns.index(name)] for name in names]
        assert said == [alarm["vessel_id"], "zone_speed", drawn, "Ana", "called on 16"]


def test_an_alarm_that_another_server_on_the_database_acknowledged_waits_here_no_longer(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'live.db'}"
    scenario = load_scenario("context-driven-100", {"period_s": "0.5", "warmup_s": "0", "cycles": "1000", "input.count": "10"})
    centre_deg = scenario.area.latitude_deg, scenario.area.longitude_deg
    with store.open_store(url) as opened, store.open_store(url) as other:
        service = Service(opened)
        run = LiveRun(scenario, Paced(), service.receive, database=url, workers=1, resume=False)
        service.source = run
        with listening(service, web=tmp_path) as address, run:
            wait_for(lambda: service.hub.picture is not None, 300.0)  # kernels may be compiled first
            zone = {"name": "all", "kind": "circle", "centre_deg": centre_deg, "radius_nm": 100.0, "max_speed_kn": 0.5}
            assert httpx.post(f"http://{address}/api/v1/zones", json=zone, timeout=60.0).status_code == 201
            waiting = "unacknowledged"
            wait_for(lambda: run.alarms.alarms(waiting))
            alarm, by = run.alarms.alarms(waiting)[0], store.Acknowledgement(time.time(), "Ana", "seen", "other")
            wait_for(lambda: store.acknowledge(other, service.run_id(), AlarmKey(*alarm[:4]), by))
            wait_for(lambda: alarm.alarm_id not in {one.alarm_id for one in run.alarms.alarms(waiting)}, 20.0)
            (found,) = [one for one in run.alarms.alarms() if one.alarm_id == alarm.alarm_id]
    assert (found.acknowledged_by, found.note) == ("Ana", "seen")


def test_a_log_that_a_reader_holds_is_said_and_a_run_that_is_deleted_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "LOG_BYTES", 20 * database.PAGE_BYTES)
    path = tmp_path / "live.db"
    scenario = load_scenario("context-driven-100", {"period_s": "0.5", "warmup_s": "0", "cycles": "1000", "input.count": "10"})
    with store.open_store(str(path)) as opened:
        service = Service(opened)
        given = {"database": f"sqlite:///{path}", "workers": 1, "resume": False, "restart": Backoff(0.05, 0.05)}
        run = LiveRun(scenario, Paced(), service.receive, **given)
        service.source = run
        with listening(service, web=tmp_path) as address, run:
            wait_for(lambda: run.cycles >= 2, 300.0)  # kernels may be compiled first
            reader = sqlite3.connect(path, isolation_level=None)
            reader.execute("BEGIN")
            reader.execute("SELECT count(*) FROM cycle").fetchone()
            wait_for(lambda: any(trouble.kind == "log" for trouble in run.troubles()), 120.0)
            troubles = httpx.get(f"http://{address}/readyz").json()["troubles"]
            assert ["another process reads in one transaction" in one["text"] for one in troubles if one["kind"] == "log"] == [
                True
            ]
            metrics = httpx.get(f"http://{address}/metrics").text
            found = next(line for line in metrics.splitlines() if line.startswith("coastwatch_log_bytes"))
            assert float(found.split()[1]) > database.LOG_BYTES
            assert 'coastwatch_trouble{kind="log",name="",serious="false"} 1.0' in metrics
            reader.close()
            wait_for(lambda: not any(trouble.kind == "log" for trouble in run.troubles()), 60.0)
            first = service.run_id()
            assert store.run(opened, first)["settings"]["store"]["history_hours"] == 168.0, "a live run keeps a week"
            with pytest.raises(StoreError, match="is being written"):
                store.delete_run(opened, first)
            with writing(opened) as connection:  # as another machine would see it
                connection.exec_driver_sql("UPDATE run SET status = 'finished'")
            store.delete_run(opened, first)
            wait_for(lambda: service.run_id() > first and run.restarts, 60.0)
            assert any("there is no run" in trouble.text for trouble in run.troubles() if trouble.kind == "restart")
        assert not run.failed
        assert store.runs(opened).column("id") == [first + 1]


def test_a_run_that_goes_on_has_the_names_of_vessels_that_are_not_in_the_picture(tmp_path: Path) -> None:
    import store_world as world

    with store.open_store(str(tmp_path / "sea.db")) as opened:
        run_id = world.begin(opened)
        for number in range(12):
            world.write(opened, run_id, number)
        found = stored_statics(opened, run_id, 100)
        assert found[710_000_001] == ("SHIP 1", None, 70, 120.0, pytest.approx(float("nan"), nan_ok=True))
        assert 710_000_000 in found, "no vessel of the picture has this MMSI"
        assert sorted(stored_statics(opened, run_id, 2)) == [710_000_010, 710_000_011]


def test_a_second_server_on_a_database_is_refused_until_the_first_is_killed(
    tmp_path: Path, start: Start, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.db"
    words = ["serve", "context-driven-100", "--db", str(path), "--port", "0", "--workers", "1", "--set", "input.count=5"]
    first = start(*words)
    wait_for(lambda: path.exists() and stored(path) > 0, 300.0)  # kernels may be compiled first
    assert main(words) == 2
    refused = f"--db: got {path}, where a server, process {first.pid}, is writing run 1, needed another database"
    assert refused in capsys.readouterr().err
    assert column(path, "SELECT status FROM run") == ["running"]
    first.kill()
    first.wait()
    with store.open_store(str(path)) as opened:
        service, before = Service(opened), stored(path)
        run = LiveRun(load_scenario("context-driven-100", {"input.count": "5"}), Paced(), service.receive, database=str(path))
        service.source = run
        with run:
            wait_for(lambda: stored(path) > before + 1, 60.0)
        assert not run.restarts
    assert column(path, "SELECT id FROM run") == [1]


def test_a_server_whose_run_has_failed_for_good_ends_with_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """So systemd begins it again."""

    def step(*given: object, **more: object) -> None:
        raise ZeroDivisionError("a defect in each cycle")

    monkeypatch.setattr("coastwatch.server.run.run_cycle", step)
    monkeypatch.setattr("coastwatch.server.live.MOST_RESTARTS", 1)
    words = ["serve", "context-driven-100", "--db", str(tmp_path / "x.db"), "--port", "0", "--workers", "1"]
    assert main([*words, "--set", "period_s=0.5", "--set", "input.count=5"]) == 1
    err = capsys.readouterr().err
    assert "the run is begun again after: a defect in each cycle" in err
    assert err.rstrip().endswith("coastwatch: error: the run has failed: a defect in each cycle")


def test_a_run_that_fails_says_why_and_the_server_goes_on(tmp_path: Path) -> None:
    with store.open_store(str(tmp_path / "live.db")) as opened:
        service = Service(opened)
        scenario = load_scenario("context-driven-100", {"cycles": "1"})
        run = LiveRun(scenario, Paced(), service.receive, database=f"sqlite:///{tmp_path / 'nowhere' / 'x.db'}")
        service.source = run
        with run, listening(service, web=tmp_path) as address:
            wait_for(lambda: run.failed)
            answer = httpx.get(f"http://{address}/api/v1/picture")
            assert (answer.status_code, "there is no folder" in answer.json()["detail"]) == (503, True)


def test_a_server_that_is_stopped_while_kernels_are_compiled_ends_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiling, done = threading.Event(), threading.Event()

    def compile_for_minutes(*_: object, **__: object) -> None:
        compiling.set()
        done.wait(60.0)

    monkeypatch.setattr("coastwatch.server.run.warm_up", compile_for_minutes)
    url = f"sqlite:///{tmp_path / 'live.db'}"
    with store.open_store(url) as opened:
        run = LiveRun(load_scenario("context-driven-100"), Paced(), Service(opened).receive, database=url)
        with run:
            assert compiling.wait(60.0)
        assert not run.ended
        done.set()
        wait_for(lambda: run.ended)
        assert store.runs(opened).rows == []
    assert not run.failed


class Due:
    """An input whose cycles can begin at their end."""

    def due_s(self, until_s: float) -> float:
        return until_s


@pytest.mark.parametrize(
    ("late_s", "cycle_s", "merged"),
    [(5.0, 2.9, 0), (9.0, 0.1, 0), (60.0, 0.1, 0), (9.0, 2.9, 3), (9.0, 9.0, 3), (300.0, 2.0, 100)],
)
def test_cycles_are_merged_where_computing_each_leaves_the_picture_behind(
    late_s: float, cycle_s: float, merged: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = LiveRun(load_scenario("guanabara"), Due(), lambda _: None, database="")  # type: ignore[arg-type]
    vars(run)["_spacing_s"] = cycle_s
    monkeypatch.setattr(clock, "now_s", lambda: 1e9 + late_s)
    assert run.behind(1e9) == merged


def test_alarms_of_an_earlier_run_that_nobody_acknowledged_are_said_when_a_new_one_takes_its_place(tmp_path: Path) -> None:
    import store_world as world

    url = f"sqlite:///{tmp_path / 'sea.db'}"
    with store.open_store(url) as opened:
        first = world.begin(opened)
    run = LiveRun(load_scenario("guanabara"), Paced(), lambda _: None, database=url)
    point: Any = SimpleNamespace(cycle=0, memory=SimpleNamespace(centre=SimpleNamespace(events=None)))
    none = (None,) * 2
    alarms = [
        Alarm(k, "dark", 0, 1.0, 2.0, 0, *none, 0.0, 0.0, None, "why", *((by, 3.0, "") if by else (None,) * 3))
        for k, by in ((1, None), (2, None), (3, "Ana"))
    ]
    run.begun(first, point)
    assert run.left_alarms() == []
    with store.open_store(url) as opened:  # a new process, whose run takes the place of one before
        for number in range(3):
            picture = world.picture_of(number, 30)
            dark = replace(picture, flags=np.where(picture.vessel_id < 4, int(Flag.DARK), 0))
            world.write(opened, first, number, cycle=world.cycle_of(number, 30, dark))
        other, second = world.begin(opened, scenario="other"), world.begin(opened)
        waiting = store.left_unacknowledged(opened, second)
        assert store.left_unacknowledged(opened, other) is None
    assert waiting == (first, 3)
    restarted = LiveRun(load_scenario("guanabara"), Paced(), lambda _: None, database=url)
    restarted.begun(second, point)
    (said,) = restarted.left_alarms()
    assert said.text.startswith(f"run {first} had 3 alarms that nobody acknowledged: coastwatch query alarms")
    run.alarms.begin(first, alarms)
    run.begun(first, point)
    assert run.left_alarms() == [], "the run goes on"
    run.alarms.begin(first, alarms)
    run.begun(first + 7, point)
    (said,) = run.left_alarms()
    assert (said.kind, said.is_serious) == ("alarms", False)
    assert said.text == f"run {first} had 2 alarms that nobody acknowledged: coastwatch query alarms --run {first}"
    run.alarms.begin(first + 7, alarms[:1])
    run.begun(first + 8, point)
    assert run.left_alarms()[0] == said
    assert f"run {first + 7} had 1 alarms that nobody acknowledged" in run.left_alarms()[1].text
    assert f"no run {first + 7}" in run.left_alarms()[1].text, "it is not in the database"
