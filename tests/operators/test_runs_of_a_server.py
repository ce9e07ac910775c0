"""A server that began a new run: times before it are answered from the old one, on the command line and by the API."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import store_world as world
from server_world import Served, listening, wait_for
from sqlalchemy import text

from coastwatch.batches import Flag
from coastwatch.operators.cli import main
from coastwatch.operators.cli.serving import following
from coastwatch.spelling import utc_text
from coastwatch.store import open_store, run_at, runs_between
from coastwatch.store.schema.database import writing

pytestmark = pytest.mark.contract

EARLIER_S = 7200.0
OLD_S, NEW_S = world.instant_s(2) - EARLIER_S, world.instant_s(2)


@pytest.fixture(scope="module")
def watch(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Served]]:
    """Database and server of a watch that had 30 vessels in run 1, and 20 in run 2 two hours later."""
    folder = tmp_path_factory.mktemp("watch")
    url = f"sqlite:///{folder / 'x.db'}"
    with open_store(url) as opened:
        for vessels in (30, 20):
            run = world.begin(opened, by_server=True)
            for number in range(3):
                picture = world.picture_of(number, vessels)
                dark = replace(picture, flags=np.where(picture.vessel_id == 4, int(Flag.DARK), 0))
                world.write(opened, run, number, cycle=world.cycle_of(number, vessels, dark))
        with writing(opened) as connection:
            for moved in ("cycle SET time_s = time_s - :s", "event SET start_s = start_s - :s, end_s = end_s - :s"):
                connection.execute(text(f"UPDATE {moved} WHERE run_id = 1").bindparams(s=EARLIER_S))
        with following(opened, None, poll_s=0.05) as service, listening(service, web=folder) as address:
            wait_for(lambda: service.hub.picture)
            yield url, Served(address, service, opened)


def test_the_run_that_holds_a_time_is_found(watch: tuple[str, Served]) -> None:
    opened = watch[1].store
    assert [run_at(opened, 2, at_s) for at_s in (OLD_S - 1e6, OLD_S, NEW_S - 3600.0, NEW_S, NEW_S + 1e6)] == [2, 1, 1, 2, 2]
    assert run_at(opened, 1, NEW_S) == 1
    assert runs_between(opened, 2, OLD_S, OLD_S) == [1]
    assert runs_between(opened, 2, NEW_S, None) == [2]
    assert runs_between(opened, 2, OLD_S, NEW_S) == runs_between(opened, 2, None, None) == [2, 1]
    assert runs_between(opened, 2, NEW_S + 1e6, None) == [2]


def test_runs_of_no_server_stand_for_themselves(tmp_path: Path) -> None:
    with open_store(f"sqlite:///{tmp_path / 'x.db'}") as opened:
        for _ in range(2):
            world.write(opened, world.begin(opened), 0)
        assert run_at(opened, 2, NEW_S - 1e6) == 2
        assert runs_between(opened, 2, None, None) == [2]


def test_the_command_line_answers_from_the_run_that_holds_the_time(
    watch: tuple[str, Served], capsys: pytest.CaptureFixture[str]
) -> None:
    url = watch[0]

    def said(*arguments: str) -> tuple[int, str]:
        assert main([arguments[0], *arguments[1:], "--db", url, "--format", "json"]) == 0
        out, err = capsys.readouterr()
        return len(json.loads(out)), "".join(line for line in err.splitlines(True) if "the run goes on" not in line)

    old, new = utc_text(OLD_S), utc_text(NEW_S)
    before = "coastwatch: warning: this answer is of run 1: run 2 began later\n"
    seen = (world.present(2, 30).sum(), world.present(2, 20).sum())
    assert said("picture", "--at", old) == (seen[0], before)
    assert said("picture", "--at", new) == (seen[1], "")
    assert said("picture", "--at", new, "--run", "2") == (seen[1], "")
    there, err = said("query", "alarms", "--from", old, "--to", old)
    assert err == before
    assert there == said("query", "alarms", "--from", old, "--to", old, "--run", "1")[0] > 0
    other = "coastwatch: warning: run 1 of the same server has some of that time too: ask for a run by its number\n"
    assert said("query", "alarms", "--from", old, "--to", new)[1] == other


def test_the_api_answers_from_the_run_that_holds_the_time(watch: tuple[str, Served]) -> None:
    served, old, new = watch[1], utc_text(OLD_S), utc_text(NEW_S)
    shown = served.get(f"/api/v1/picture?at={old}").json()
    assert (shown["run"], shown["total"]) == (1, world.present(2, 30).sum())
    assert served.get(f"/api/v1/picture?at={new}").json()["run"] == served.get("/api/v1/picture").json()["run"] == 2
    span = served.get("/api/v1/cycles").json()
    assert (span["first_utc"], span["last_utc"]) == (utc_text(world.instant_s(0) - EARLIER_S), new)
    assert served.get("/api/v1/vessels/30").status_code == 404
    assert served.get(f"/api/v1/vessels/30?at={old}").json()["vessel_id"] == 30
    assert served.get(f"/api/v1/vessels/30/history?from={old}").status_code == 404
    for name in ("history", "decided"):
        of_old, of_new = (served.get(f"/api/v1/vessels/{v}/{name}{at}").json() for v, at in ((30, f"?at={old}"), (4, "")))
        assert (of_old["run"], of_new["run"]) == (1, 2)
    assert served.get(f"/api/v1/vessels/30/history?at={old}&to={old}").json()["total"] > 0
    assert served.get(f"/api/v1/vessels/4/history?from={old}").json()["run"] == 2
    for at, run_id, known in (("", 2, []), (f"&at={old}", 1, [30])):
        found = served.get(f"/api/v1/vessels?ids=30{at}").json()
        assert (found["run"], [vessel["vessel_id"] for vessel in found["vessels"]]) == (run_id, known)
    alarms = served.get(f"/api/v1/alarms?from={old}&to={old}").json()
    assert (alarms["run"], alarms["warning"]) == (1, "this answer is of run 1: run 2 began later")
    assert alarms["alarms"] == served.get(f"/api/v1/alarms?from={old}&to={old}&run=1").json()["alarms"] != []
    both = served.get(f"/api/v1/alarms?from={old}&to={new}")
    assert both.headers["X-Warning"] == both.json()["warning"]
    assert both.json()["run"] == 2
    assert served.get("/api/v1/alarms?run=9").status_code == 404
