"""Alarms: as events while they come, acknowledged with a name in one place and seen in another."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime

import httpx2 as httpx
import numpy as np
import pytest
from server_world import Served, events, listening, raise_alarm, wait_for

from coastwatch.batches import AlarmKind, Flag, VesselAlarms
from coastwatch.batches.kinds import PRIORITIES
from coastwatch.operators.api import alarms
from coastwatch.server.alarm_book import Alarm
from coastwatch.store import Rows

pytestmark = pytest.mark.whole


def test_an_acknowledgement_is_told_at_once_and_the_stream_ends_with_the_server(
    changing: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    raise_alarm(changing, 3, 4)
    wait_for(lambda: changing.service.picture().cycle == 3)
    wait_for(lambda: len(changing.service.book.alarms()) == 1)
    monkeypatch.setattr(alarms, "STOP_S", 60.0)  # nothing is found by looking again
    with httpx.Client(timeout=20.0) as client, ExitStack() as opened:
        with listening(changing.service) as address:
            path = f"http://{address}/api/v1/alarms"
            seen = events(opened.enter_context(client.stream("GET", f"{path}/stream")))
            alarm = next(seen)
            time.sleep(0.2)  # now it waits
            monkeypatch.setattr(alarms, "STOP_S", 0.05)  # of the next wait
            httpx.post(f"{path}/{alarm['alarm_id']}/acknowledge", json={"name": "Ana"}).raise_for_status()
            assert next(seen)["acknowledged_by"] == "Ana"
        assert list(seen) == []  # a stream that is cut off is an error


def test_an_alarm_is_seen_acknowledged_and_seen_as_such_by_others(changing: Served) -> None:
    base = f"http://{changing.address}"
    with httpx.Client(base_url=base, timeout=20.0) as client, client.stream("GET", "/api/v1/alarms/stream") as first:
        assert first.headers["content-type"].startswith("text/event-stream")
        seen = events(first)
        raise_alarm(changing, 3, 4)
        alarm = next(seen)
        assert (alarm["vessel_id"], alarm["kind"], alarm["end_utc"], alarm["acknowledged_by"]) == (4, "dark", None, None)
        path = f"{base}/api/v1/alarms/{alarm['alarm_id']}/acknowledge"
        wrong = httpx.post(path, json={"name": " "}), httpx.post(path, json={"nam": "Ana"})
        assert [answer.status_code for answer in wrong] == [422, 422]
        for said in ({"name": "A\0"}, {"name": "A\x1b[1m"}, {"name": "Ana", "note": "a\0b"}, {"name": "Ana", "note": "a\x85b"}):
            refused = httpx.post(path, json=said)
            assert (refused.status_code, refused.json()["detail"].endswith("needed text without control characters")) == (
                422,
                True,
            )
            together = {**said, "from": "2020-01-01T00:00:00Z", "to": "2020-01-02T00:00:00Z"}
            assert httpx.post(f"{base}/api/v1/alarms/acknowledge", json=together).status_code == 422
        assert httpx.post(f"{base}/api/v1/alarms/4-dark-1/acknowledge", json={"name": "Ana"}).status_code == 404
        assert httpx.post(f"{base}/api/v1/alarms/nothing/acknowledge", json={"name": "Ana"}).status_code == 404
        done = httpx.post(path, json={"name": "Ana", "note": "called on 16"}).json()
        assert (done["acknowledged_by"], done["note"]) == ("Ana", "called on 16")
        assert abs(datetime.fromisoformat(done["acknowledged_utc"]).timestamp() - time.time()) < 60.0
        assert httpx.post(path, json={"name": "Bia"}).json()["acknowledged_by"] == "Ana"
        assert next(seen)["acknowledged_by"] == "Ana"
        raise_alarm(changing, 4, None)
        ended = next(seen)
        assert ended["end_utc"] is not None
    raise_alarm(changing, 5, 7)
    wait_for(lambda: changing.service.picture().cycle == 5)
    headers = {"Last-Event-ID": ended["id"]}
    with (
        httpx.Client(base_url=base, timeout=20.0, headers=headers) as client,
        client.stream("GET", "/api/v1/alarms/stream") as again,
    ):
        assert next(events(again))["vessel_id"] == 7
    unacknowledged = changing.get("/api/v1/alarms?state=unacknowledged").json()
    assert [row["vessel_id"] for row in unacknowledged["alarms"]] == [7]
    assert changing.get("/api/v1/alarms?state=lasting").json()["total"] == 1


def test_an_id_of_another_process_is_answered_with_all_alarms_and_each_has_its_priority(
    changing: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server that was started again counts from 1: the number of an event of the one before means nothing to it."""
    raise_alarm(changing, 3, 4)
    wait_for(lambda: len(changing.service.book.alarms()) == 1)
    seen: list[tuple[str, int]] = []
    last = ""
    for process in ("one", "two"):
        monkeypatch.setattr(alarms, "PROCESS", process)
        with listening(changing.service) as address, ExitStack() as opened:
            client = opened.enter_context(httpx.Client(timeout=20.0, headers={"Last-Event-ID": last}))
            alarm = next(events(opened.enter_context(client.stream("GET", f"http://{address}/api/v1/alarms/stream"))))
            seen.append((alarm["alarm_id"], alarm["priority"]))
            last = alarm["id"]
            status = httpx.get(f"http://{address}/api/v1/status").json()
            assert last == "{run}-{change}-{0}".format(process, **status["alarms"])
    assert seen[0] == seen[1]
    assert seen[0][1] == PRIORITIES["dark"]
    assert changing.get("/api/v1/alarms").json()["alarms"][0]["priority"] == PRIORITIES["dark"]


def test_of_hundreds_of_alarms_distress_is_told_first_and_only_the_last_has_the_number_of_all(changing: Served) -> None:
    none = (None,) * 3
    rows = [
        Alarm(k, "man_overboard" if k == 200 else "dark", 0, 1000.0 + k, None, 0, *none, 0.0, 0.0, "why", *none)
        for k in range(1, 251)
    ]
    path = f"http://{changing.address}/api/v1/alarms/stream"
    with httpx.Client(timeout=20.0) as client, client.stream("GET", path) as opened:
        seen = events(opened)
        changing.service.book.compare(Rows(Alarm._fields, rows[:1]))
        before = next(seen)["id"]
        changing.service.book.compare(Rows(Alarm._fields, rows[1:]))
        found = [next(seen) for _ in rows[1:]]
    assert [alarm["vessel_id"] for alarm in found] == [200, *(k for k in range(250, 1, -1) if k != 200)]
    ids = [alarm["id"] for alarm in found]
    assert set(ids[:-1]) == {before}
    assert ids[-1].split("-")[1] == "250"


def test_alarms_are_acknowledged_together_by_kind_and_zone_with_one_row_of_audit(changing: Served) -> None:
    """Vessels 4, 5 and 6 enter zone 1, vessel 7 enters zone 2, vessel 12 is dark; vessel 9 enters zone 1 later."""
    import store_world

    def enter(number: int, vessels: list[int], zones: list[int]) -> None:
        picture = store_world.picture_of(number, 30)
        flags = np.where(picture.vessel_id == 12, int(Flag.DARK), 0)
        n, none = len(vessels), np.full(len(vessels), np.nan)
        raised = VesselAlarms(
            np.array(vessels), np.full(n, int(AlarmKind.ZONE_ENTER)), np.array(zones), np.full(n, "bay", "U64"),
            np.zeros((n, 2)), np.zeros((n, 2)), np.full(n, -1), none, none, none, none,
        )  # fmt: skip
        cycle = store_world.cycle_of(number, 30, replace(picture, flags=flags))
        store_world.write(changing.store, 1, number, cycle=replace(cycle, vessel_alarms=raised))

    enter(3, [4, 5, 6, 7], [1, 1, 1, 2])
    wait_for(lambda: changing.service.picture().cycle == 3)
    shown = changing.get("/api/v1/alarms").json()["alarms"]
    began = {"from": min(row["start_utc"] for row in shown), "to": max(row["start_utc"] for row in shown)}
    enter(4, [4, 5, 6, 7, 9], [1, 1, 1, 2, 1])
    with listening(changing.service) as address:
        path = f"http://{address}/api/v1/alarms/acknowledge"
        said = {"name": "Ana", "note": "regatta", **began}
        assert httpx.post(path, json={**said, "kind": "nothing"}).status_code == 400
        assert httpx.post(path, json={**said, "from": "yesterday"}).status_code == 400
        assert httpx.post(path, json={**said, "kind": "zone_enter", "zone": 1}).json() == {"acknowledged": 3}
        assert httpx.post(path, json={**said, "kind": "zone_enter", "zone": 1}).json() == {"acknowledged": 0}
        rows = httpx.get(f"http://{address}/api/v1/alarms").json()["alarms"]
        assert {row["vessel_id"] for row in rows if row["acknowledged_by"] is None} == {7, 12, 9}
        assert {(row["acknowledged_by"], row["note"]) for row in rows if row["vessel_id"] in (4, 5, 6)} == {("Ana", "regatta")}
        assert httpx.post(path, json=said).json() == {"acknowledged": 2}, "without a filter: vessels 7 and 12"
        audit = httpx.get(f"http://{address}/api/v1/audit").json()["changes"]
        assert [row["path"] for row in audit].count("/api/v1/alarms/acknowledge") == 3, "one row a request that was done"
