"""Zones over the API: added, changed and deleted by operators, each change kept with who made it, and watched by a live run."""

from __future__ import annotations

import json
import threading
from itertools import pairwise
from pathlib import Path

import httpx2 as httpx
import pytest
from server_world import Served, listening, wait_for

from coastwatch import store
from coastwatch.operators.api import people
from coastwatch.operators.api.guard import Guard
from coastwatch.scenario import load_scenario
from coastwatch.server import watched_zones
from coastwatch.server.watched_zones import WatchedZones

pytestmark = pytest.mark.whole

BAY = {"name": "bay", "kind": "polygon", "points_deg": [[-22.9, -43.2], [-22.9, -43.1], [-22.8, -43.1]], "enter": True}
RING = {"name": "ring", "kind": "circle", "centre_deg": [0.0, 180.0], "radius_nm": 2.0, "max_speed_kn": 5.0}


@pytest.mark.parametrize(("kind", "size"), [(None, 0), ("text/plain", 0), ("application/x-www-form-urlencoded", 9000)])
def test_a_body_that_is_not_said_to_be_json_is_refused_with_the_reason(served: Served, kind: str | None, size: int) -> None:
    headers = {} if kind is None else {"Content-Type": kind}
    body = json.dumps(BAY).encode() + b" " * size
    answer = httpx.post(f"http://{served.address}/api/v1/zones", content=body, headers=headers)
    said = f"Content-Type: got {kind or ''!r}, needed application/json"
    assert (answer.status_code, answer.json()) == (422, {"detail": said})


def test_a_name_with_half_a_character_is_refused(served: Served) -> None:
    body, headers = json.dumps({**BAY, "name": "\ud800"}), {"Content-Type": "application/json"}
    answer = httpx.post(f"http://{served.address}/api/v1/zones", content=body, headers=headers)
    assert (answer.status_code, answer.json()["detail"]) == (422, r"name: got '\ud800', needed text without lone surrogates")


@pytest.mark.parametrize(("method", "path"), [("POST", ""), ("PUT", "/1000"), ("DELETE", "/1000")])
def test_a_change_with_an_unknown_parameter_is_refused(served: Served, method: str, path: str) -> None:
    answer = httpx.request(method, f"http://{served.address}/api/v1/zones{path}?version=1", json=BAY)
    said = "version: got '1' for an unknown parameter, needed none"
    assert (answer.status_code, answer.json()) == (422, {"detail": said})


def test_zones_are_added_changed_and_deleted_and_a_live_run_watches_them(changing: Served) -> None:
    path = f"http://{changing.address}/api/v1/zones"
    scenario = load_scenario("guanabara").model_copy(update={"name": "sea", "zones": ()})
    watched = WatchedZones(changing.store, scenario)
    assert watched.now() == ()
    made = httpx.post(path, json=BAY)
    assert made.status_code == 201
    first = made.json()["properties"]["number"]
    assert [(number, zone.name) for number, zone in watched.now()] == [(first, "bay")]
    ring = httpx.post(path, json=RING).json()
    assert ring["properties"]["number"] == first + 1
    corners = ring["geometry"]["coordinates"][0]
    assert max(abs(a[0] - b[0]) for a, b in pairwise(corners)) < 0.01  # no jump at the antimeridian
    for body, status, said in (
        (BAY, 409, "name: got 'bay', which another zone has"),
        (
            {**BAY, "name": "x", "points_deg": BAY["points_deg"][:2]},
            400,
            "got a polygon with 2 points_deg, needed 3 or more points_deg",
        ),
        (
            {**BAY, "name": "x", "points_deg": [*BAY["points_deg"], [91, 0]]},
            422,
            "points_deg[3]: got latitude 91, needed less than 85",
        ),
        ({**BAY, "points_deg": [[1, 2], [3, 4], [5, 181.5]]}, 422, "points_deg[2]: got longitude 181.5, needed 180 or less"),
        ({**BAY, "points_deg": [[1, 2], [3, 4], [5]]}, 422, "points_deg[2]: got nothing, needed a longitude"),
        ({**BAY, "points_deg": [[1, 2], [3, 4], [5, 6, 7]]}, 422, "points_deg[2]: got [5, 6, 7], needed at most 2"),
        ({**RING, "centre_deg": [0, "east"]}, 422, "centre_deg: got longitude 'east', needed a number"),
        ({**RING, "min_speed_kn": 7}, 400, "min_speed_kn: got 7, needed less than max_speed_kn = 5"),
        ({"kind": "ring"}, 422, "name: got nothing, needed a value; kind: got 'ring', needed 'polygon', 'circle' or 'line'"),
        ({**BAY, "name": "x", "speed": 3}, 422, "speed: got 3 for an unknown key, needed one of name, kind, points_deg"),
        ([BAY], 422, "body: got "),
        (
            {"name": "x", "kind": "line", "points_deg": [[1, 2], [1, 2], [1, 2]], "crossing": "both"},
            400,
            "points_deg: got a line of points at one place, needed points at least 1 m apart",
        ),
        (
            {"name": "x", "kind": "line", "points_deg": [[1, 2], [1, 2.000001]]},
            400,
            "points_deg: got a line of points at one place",
        ),
        (
            {"name": "x", "kind": "polygon", "points_deg": [[0, 0], [0, 1e-9], [1e-9, 0]]},
            400,
            "points_deg: got corners around less than 1 m2, needed a larger area",
        ),
        (
            {"name": "x", "kind": "circle", "centre_deg": [84.99, 180], "radius_nm": 500},
            400,
            "radius_nm: got a circle that reaches latitude 93.32, needed less than 85",
        ),
        (
            {"name": "x", "kind": "circle", "centre_deg": [-84.9, 0], "radius_nm": 10},
            400,
            "radius_nm: got a circle that reaches latitude -85.07, needed more than -85",
        ),
        ({**RING, "name": "a\0b"}, 422, r"name: got 'a\x00b', needed text without control characters"),
        ({**RING, "name": "  "}, 400, "name: got '  ', needed one with more than blanks"),
        ({**RING, "name": "a\x1b[2J"}, 422, "name: got "),
        ({**RING, "name": "a\nb"}, 422, "name: got "),
    ):
        answer = httpx.post(path, json=body)
        assert (answer.status_code, answer.json()["detail"].startswith(said)) == (status, True), answer.text
    damaged = httpx.post(path, content='{"name": ', headers={"Content-Type": "application/json"})
    assert (damaged.status_code, damaged.json()["detail"]) == (422, "body: got no JSON from character 9 on, needed JSON")
    assert httpx.put(f"{path}/{first}", json={**BAY, "name": "ring"}).status_code == 409
    changed = httpx.put(f"{path}/{first}", json={**BAY, "leave": True}).json()["properties"]
    assert (changed["version"], changed["leave"], changed["dwell_s"]) == (2, True, None)
    assert httpx.delete(f"{path}/{first}").json()["properties"]["name"] == "bay"
    assert [httpx.delete(f"{path}/{number}").status_code for number in (first, 1, 999_999)] == [404, 404, 404]
    assert [f["properties"]["name"] for f in changing.get("/api/v1/zones").json()["features"]] == ["ring"]
    assert [zone.name for _, zone in watched.now()] == ["ring"]
    changes = changing.get("/api/v1/zones/changes").json()["changes"]
    done = [(row["number"] - first, row["version"], row["definition"] is None, row["changed_by"]) for row in changes]
    assert done == [(0, 3, True, "loopback"), (0, 2, False, "loopback"), (1, 1, False, "loopback"), (0, 1, False, "loopback")]


def test_a_change_of_a_version_that_another_has_changed_is_refused(changing: Served) -> None:
    path = f"http://{changing.address}/api/v1/zones"
    made = httpx.post(path, json=BAY)
    number, tag = made.json()["id"], made.headers["etag"]
    one = f"{path}/{number}"
    assert tag == httpx.get(one).headers["etag"] == '"1"'
    first = httpx.put(one, json={**BAY, "leave": True}, headers={"If-Match": tag})
    assert (first.status_code, first.headers["etag"]) == (200, '"2"')
    for stale in (tag, 'W/"2"', '"3", "x"'):
        for method, body in (("PUT", {**BAY, "dwell_s": 9.0}), ("DELETE", None)):
            answer = httpx.request(method, one, json=body, headers={"If-Match": stale})
            said = "zone 'bay': somebody has changed it meanwhile, needed version 2, the newest"
            assert (answer.status_code, answer.json()["detail"].startswith(said)) == (412, True), answer.text
    assert httpx.get(one).json()["properties"]["leave"] is True
    wrong = httpx.put(one, json=BAY, headers={"If-Match": "2"})
    assert (wrong.status_code, wrong.json()["detail"]) == (
        400,
        "If-Match: got '2', needed the ETag of a zone, such as \"2\", or *",
    )
    for headers in ({"If-Match": '"7", "2"'}, {"If-Match": "*"}, {}):  # without it the last one wins, as ever
        assert httpx.put(one, json=BAY, headers=headers).status_code == 200
    assert httpx.delete(one, headers={"If-Match": '"5"'}).status_code == 200
    assert [httpx.delete(one, headers={"If-Match": '"5"'}).status_code, httpx.get(one).status_code] == [404, 404]


def test_a_stored_zone_that_is_refused_today_is_shown_and_deleted_and_ends_no_run(changing: Served) -> None:
    old = {"name": "old", "kind": "line", "points_deg": [[1.0, 2.0], [1.0, 2.0]], "crossing": "both"}
    other = {"name": "other", "kind": "star", "corners": 5}
    numbers = [store.add_zone(changing.store, "sea", made, at_s=1.0, who="ana").number for made in (old, other, BAY)]  # type: ignore[union-attr]
    scenario, said = load_scenario("guanabara").model_copy(update={"name": "sea", "zones": ()}), list[tuple[str, str]]()
    watched = WatchedZones(changing.store, scenario, said.extend)
    for _ in range(2):
        assert [zone.name for _, zone in watched.now()] == ["bay"]
    assert [name for name, _ in said] == ["old", "other"]
    assert "is not watched: points_deg: got" in said[0][1]
    assert "is not watched: kind: got 'star'" in said[1][1]
    features = changing.get("/api/v1/zones").json()["features"]
    assert [f["id"] for f in features] == numbers
    refused = [f["properties"].get("refused") for f in features]
    assert refused[0].startswith("points_deg: got a line of points at one place")
    assert refused[1].startswith("kind: got 'star'")
    assert refused[2] is None
    assert (features[0]["geometry"]["type"], features[1]["geometry"]) == ("LineString", None)
    for number, name in zip(numbers, ("old", "other", "bay"), strict=True):
        answer = httpx.delete(f"http://{changing.address}/api/v1/zones/{number}")
        assert (answer.status_code, answer.json()["properties"]["name"]) == (200, name)


def test_a_viewer_may_look_at_zones_and_not_change_them(served: Served, tmp_path: Path) -> None:
    file = tmp_path / "tokens.toml"
    viewer, operator = (people.add(file, role, role, None) for role in ("viewer", "operator"))
    with listening(served.service, Guard(tokens=people.Tokens(file))) as address:
        path = f"http://{address}/api/v1/zones"
        as_viewer, as_operator = ({"Authorization": f"Bearer {token}"} for token in (viewer, operator))
        assert httpx.get(path, headers=as_viewer).status_code == 200
        assert httpx.post(path, json=RING, headers=as_viewer).status_code == 403
        assert httpx.post(path, json=RING, headers=as_operator).status_code == 201
        changes = httpx.get(f"{path}/changes", headers=as_viewer).json()["changes"]
        assert [row["changed_by"] for row in changes] == ["operator"]


@pytest.mark.parametrize("name", ["guanabara"])
def test_the_zones_of_a_shipped_scenario_are_numbered_in_their_order(name: str, served: Served) -> None:
    zones = WatchedZones(served.store, load_scenario(name)).now()
    assert [(number, zone.name) for number, zone in zones] == [(1, "fort"), (2, "channel"), (3, "bar")]


def test_a_database_that_does_not_answer_holds_up_no_cycle(changing: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("guanabara").model_copy(update={"name": "sea", "zones": ()})
    watched, answers = WatchedZones(changing.store, scenario), threading.Event()
    store.add_zone(changing.store, "sea", BAY, at_s=1.0, who="Ana")
    true = store.zone_version
    monkeypatch.setattr(watched_zones, "WAIT_S", 0.01)
    monkeypatch.setattr(store, "zone_version", lambda *given: answers.wait(20.0) and true(*given))
    assert watched.now() == ()
    assert watched.now() == ()
    answers.set()
    wait_for(lambda: [zone.name for _, zone in watched.now()] == ["bay"])
