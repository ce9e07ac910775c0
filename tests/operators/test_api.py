"""A server on a database that another process writes: every path, formats, refusals, and the stream."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from socket import create_connection
from typing import Any

import httpx2 as httpx
import numpy as np
import polars
import pytest
import store_world
from page import DELTA, FULL, Page
from server_world import Served, listening
from websockets.exceptions import ConnectionClosed, InvalidStatus

from coastwatch import store
from coastwatch.batches import DecidedPath
from coastwatch.operators import presentation
from coastwatch.operators.selection import selected
from coastwatch.store import Table
from coastwatch.store.bbox import inside

pytestmark = pytest.mark.whole


def test_the_picture_in_three_formats_has_the_same_vessels(served: Served) -> None:
    answer = served.get("/api/v1/picture")
    of = answer.json()
    assert (of["total"], of["run"], of["cycle"]) == (28, 1, 2)
    assert answer.headers["x-total-count"] == "28"
    second = of["vessels"][1]
    assert (second["mmsi"], second["name"], second["sources"], second["sog_kn"]) == (
        "710000001",
        "SHIP 1",
        "guanabara,ais",
        1.0,
    )
    found = served.get("/api/v1/picture", headers={"Accept": "application/geo+json"}).json()
    assert [f["id"] for f in found["features"]] == [row["vessel_id"] for row in of["vessels"]]
    assert found["features"][1]["geometry"]["coordinates"] == [second["longitude_deg"], second["latitude_deg"]]
    rows = list(csv.DictReader(io.StringIO(served.get("/api/v1/picture?format=csv").text)))
    assert [int(row["vessel_id"]) for row in rows] == [row["vessel_id"] for row in of["vessels"]]


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("bbox=-23,-43.21,-22,-43.185", [1, 2]),
        ("bbox=-23,-42,-22,-43.21", []),
        ("sources=ais&limit=2", [2, 4]),
        ("sources=bearing", [1]),
        ("sources=ilha&limit=2", [1, 3]),
        ("mmsi=710000003", [4]),
        ("q=ship 1", [2]),
        ("q=710000003", [4]),
        ("min_sog=17.5", [19]),
        ("sort=-sog_kn&limit=2&offset=1", [18, 17]),
        ("flags=dark", []),
    ],
)
def test_parameters_choose_vessels(served: Served, query: str, expected: list[int]) -> None:
    answer = served.get(f"/api/v1/picture?{query}")
    assert answer.status_code == 200, answer.text
    assert [row["vessel_id"] for row in answer.json()["vessels"]] == expected


def test_parquet_has_the_same_types_whatever_the_rows(served: Served) -> None:
    answer = served.get("/api/v1/picture", headers={"Accept": "application/vnd.apache.parquet"})
    found = polars.read_parquet(io.BytesIO(answer.content))
    assert found["vessel_id"].to_list() == [row["vessel_id"] for row in served.get("/api/v1/picture").json()["vessels"]]
    assert str(found.schema["time_utc"]) == "Datetime(time_unit='us', time_zone='UTC')"
    none = polars.read_parquet(io.BytesIO(served.get("/api/v1/picture?format=parquet&limit=0").content))
    assert (none.height, none.schema) == (0, found.schema)
    for path in ("alarms", "sensors", "runs", "audit", "vessels/2/history"):
        assert served.get(f"/api/v1/{path}?format=parquet").content.startswith(b"PAR1"), path


def test_pages_follow_each_other_and_an_unchanged_picture_is_not_sent_again(served: Served) -> None:
    found, path = [], "/api/v1/picture?limit=12&sort=-sog_kn"
    while path:
        answer = served.get(path)
        found += [row["vessel_id"] for row in answer.json()["vessels"]]
        path = httpx.Response(200, headers=answer.headers).links.get("next", {}).get("url", "")
    assert sorted(found) == [row["vessel_id"] for row in served.get("/api/v1/picture").json()["vessels"]]
    assert len(found) == 28
    tag = served.get("/api/v1/picture").headers["etag"]
    again = served.get("/api/v1/picture", headers={"If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
    assert served.get("/api/v1/picture?format=csv", headers={"If-None-Match": tag}).status_code == 200


@pytest.mark.parametrize("form", ["json", "csv", "geojson", "parquet"])
def test_pages_of_a_history_go_back_to_its_beginning_in_every_format(served: Served, form: str) -> None:
    whole = [row["time_utc"] for row in served.get("/api/v1/vessels/2/history").json()["history"]]
    assert len(whole) > 1
    path, totals, last = f"/api/v1/vessels/2/history?limit=1&format={form}", [], ""
    while path:
        answer = served.get(path)
        totals.append(int(answer.headers["x-total-count"]))
        last = answer.text
        path = httpx.Response(200, headers=answer.headers).links.get("next", {}).get("url", "")
    assert totals == list(range(len(whole), 0, -1))
    assert form == "parquet" or whole[0] in last
    for other in ("sensors", "runs", "audit", "alarms"):
        answer = served.get(f"/api/v1/{other}")
        assert int(answer.headers["x-total-count"]) == len(next(v for v in answer.json().values() if isinstance(v, list)))


def test_a_sorted_page_is_as_if_every_vessel_were_formatted_and_only_the_page_is(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = served.get("/api/v1/picture").json()["vessels"]
    formatted, made = [], presentation.in_operator_units

    def noting(rows: Any) -> Any:
        formatted.append(len(rows) if isinstance(rows, Table) else len(rows.rows))
        return made(rows)

    picture = served.service.picture()
    every_row = made(picture.rows(np.arange(len(picture))))
    monkeypatch.setattr(presentation, "in_operator_units", noting)
    keys = [*every[0], "nav_status,-sog_kn", "-flags,name", "sources,-mmsi,cog_deg"]
    for key in [*keys, *(f"-{key}" for key in every[0])]:
        expected = [row[0] for row in selected(every_row, key.split(","), None, ("vessel_id",)).rows]
        answer = served.get(f"/api/v1/picture?sort={key}&offset=5&limit=7").json()
        assert [row["vessel_id"] for row in answer["vessels"]] == expected[5:12], key
    assert max(formatted) == 7
    wrong = served.get("/api/v1/picture?sort=sog")
    assert (wrong.status_code, wrong.json()["detail"].startswith("sort: got 'sog', needed some of vessel_id, ")) == (400, True)


def test_the_past_is_answered_from_the_store(served: Served) -> None:
    now, then = (served.get(f"/api/v1/picture{at}").json() for at in ("", "?at=2025-06-15T15:06:43Z"))
    assert now["vessels"][1]["latitude_deg"] == pytest.approx(then["vessels"][1]["latitude_deg"] + 2e-5)
    assert (now["cycle"], then["cycle"], then["time_utc"], "warning" in then) == (2, 0, "2025-06-15T15:06:43.000Z", False)
    later = served.get("/api/v1/picture?at=2099-01-01")
    assert (later.json()["cycle"], later.json()["time_utc"]) == (2, now["time_utc"])
    assert later.json()["warning"] == later.headers["x-warning"]
    assert later.headers["x-warning"].startswith("at: run 1 holds nothing at 2099-01-01T00:00:00.000Z: its last cycle is at ")
    for path in ("picture", "frame"):
        early = served.get(f"/api/v1/{path}?at=2020-01-01")
        assert early.status_code == 404, "the database is there; it holds nothing of then"
        assert early.json()["detail"].startswith(
            "at: run 1 holds nothing up to 2020-01-01T00:00:00Z, its first kept cycle is at 20"
        )
    page = Page()
    assert page.take(served.get("/api/v1/frame?at=2025-06-15T15:06:43Z&bbox=-23,-43.21,-22,-43.185").content) == FULL
    assert page.ids.tolist() == [1, 2]


BOXES = [
    "-23,-43.21,-22,-43.185",
    "-23,-42,-22,-43.21",
    "-23,-43.191,-22,-43.195",
    "-23,-43.191,-22,-179",
    "-90,-180,90,180",
    "5,5,6,6",
]


@pytest.mark.parametrize("bbox", BOXES)
def test_a_box_of_the_past_is_asked_of_the_store_and_answers_as_the_whole_picture_does(
    served: Served, bbox: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    read = store.picture
    monkeypatch.setattr(store, "picture", lambda *arguments: asked.append(arguments[2:]) or read(*arguments))
    at, south_to_east = "at=2025-06-15T15:06:43Z", tuple(float(word) for word in bbox.split(","))
    whole = served.get(f"/api/v1/picture?{at}").json()
    places = np.array([[row["latitude_deg"], row["longitude_deg"]] for row in whole["vessels"]])
    here = [row for row, is_here in zip(whole["vessels"], inside(places, south_to_east), strict=True) if is_here]
    pages = [served.get(f"/api/v1/picture?{at}&bbox={bbox}&limit=3&offset={first}").json() for first in (0, 3, 6)]
    assert [row for page in pages for row in page["vessels"]] == here[:9]
    assert [page["total"] for page in pages] == [len(here)] * 3
    page = Page()
    page.take(served.get(f"/api/v1/frame?{at}&bbox={bbox}").content)
    assert page.ids.tolist() == [row["vessel_id"] for row in here]
    assert asked[-1][1] == south_to_east, "the store reads the box alone"
    assert len(asked) <= 2, "once for the whole picture, once for all pages and the frame of the box"
    by_source = served.get(f"/api/v1/picture?{at}&bbox={bbox}&sources=ilha")
    assert by_source.status_code == 200, "also where no vessel of the box has that source"


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("/api/v1/picture?bbox=1,2", 400, "bbox: got '1,2'"),
        ("/api/v1/picture?flags=drak", 400, "flags: got 'drak', needed some of dark"),
        ("/api/v1/picture?sources=moon", 400, "sources: got 'moon'"),
        ("/api/v1/picture?mmsi=abc", 400, "mmsi: got 'abc', needed nine digits"),
        (
            "/api/v1/vessels/1/history?from=2030-01-01T00:00:00Z&to=2020-01-01T00:00:00Z",
            400,
            "from: got '2030-01-01T00:00:00Z', which is after",
        ),
        (
            "/api/v1/alarms?from=2030-01-01T00:00:00Z&to=2020-01-01T00:00:00Z",
            400,
            "from: got '2030-01-01T00:00:00Z', which is after",
        ),
        ("/api/v1/picture?columns=moon", 400, "columns: got 'moon', needed some of "),
        ("/api/v1/picture?columns=mmsi,mmsi&format=parquet", 400, "columns: got 'mmsi' twice, needed each column once"),
        ("/api/v1/picture?colums=a", 422, "colums: got 'a' for an unknown parameter, needed one of "),
        ("/api/v1/picture?form=csv", 422, "min_sog, mmsi, offset, q, sort, sources; did you mean 'format'?"),
        ("/api/v1/sensors?x=1", 422, "x: got '1' for an unknown parameter, needed one of format"),
        ("/api/v1/cycles?at=x", 422, "at: got 'x' for an unknown parameter, needed none"),
        ("/api/v1/vessels/1/history?frm=x", 422, "needed one of at, format, from, limit, to; did you mean 'from'?"),
        ("/api/v1/picture?limit=10001", 422, "limit: got '10001', needed 10000 or less"),
        ("/api/v1/picture?min_sog=5&max_sog=2", 400, "min_sog: got 5, needed at most max_sog = 2"),
        ("/api/v1/runs?format=geojson", 422, "format: got 'geojson', needed 'json', 'csv' or 'parquet'"),
        ("/api/v1/picture?at=noon", 400, "at: got 'noon'"),
        ("/api/v1/picture?at=9999-12-31T23:59:59-14:00", 400, "at: got '9999-12-31T23:59:59-14:00', needed an instant"),
        ("/api/v1/picture?at=0001-01-01T00:00:00%2B14:00", 400, "at: got '0001-01-01T00:00:00+14:00', needed an instant"),
        ("/api/v1/vessels?ids=1,x", 400, "ids:"),
        ("/api/v1/vessels", 400, "ids and q"),
        ("/api/v1/vessels/9999", 404, "never had a vessel 9999"),
        ("/api/v1/vessels/x", 422, "vessel_id: got 'x', needed a whole number"),
        ("/api/v1/alarms?kind=moon", 400, "moon"),
        ("/api/v1/coastline", 404, "no coastline"),
        ("/api/v1/sensors/7/cover", 404, "got radar 7, needed one of 0, 1"),
        ("/api/v1/nothing", 404, "there is no path /api/v1/nothing"),
        ("/api/v1/frame?at=" + 201 * "0", 422, "needed at most 200 characters"),
    ],
)
def test_a_wrong_request_is_refused_in_one_sentence(served: Served, path: str, status: int, said: str) -> None:
    answer = served.get(path)
    assert (answer.status_code, said in answer.json()["detail"]) == (status, True), answer.text


def test_the_description_has_the_formats_that_are_answered_and_a_wrong_one_is_named_once(served: Served) -> None:
    wrong = served.get("/api/v1/picture?format=xml")
    assert (wrong.status_code, wrong.json()["detail"].count("'xml'")) == (422, 1)
    paths = served.get("/api/v1/openapi.json").json()["paths"]
    content = {
        path: set(paths[f"/api/v1/{path}"]["get"]["responses"]["200"]["content"]) for path in ("runs", "audit", "coastline")
    }
    rows = {"application/json", "text/csv", "application/vnd.apache.parquet"}
    assert content == {"runs": rows, "audit": rows, "coastline": {"application/geo+json"}}
    for path in ("runs", "audit"):
        answer = served.get(f"/api/v1/{path}", headers={"Accept": "application/geo+json, text/csv"})
        assert (answer.status_code, answer.headers["content-type"].partition(";")[0]) == (200, "text/csv")


def test_a_method_that_a_path_does_not_have_is_refused_and_what_is_no_path_is_none(served: Served, tmp_path: Path) -> None:
    (tmp_path / "index.html").touch()  # the files of the page are asked for whatever no route has
    with listening(served.service, web=tmp_path) as address:
        for path in ("zones/abc", "zones/1.5", "nothing"):
            answer = httpx.delete(f"http://{address}/api/v1/{path}")
            assert (answer.status_code, answer.json()) == (404, {"detail": f"there is no path /api/v1/{path}"})
        for path, allowed in (("/api/v1/zones", "GET, HEAD, POST"), ("/index.html", "GET, HEAD")):
            answer = httpx.delete(f"http://{address}{path}")
            assert (answer.status_code, answer.headers["allow"]) == (405, allowed), path
            assert answer.json() == {"detail": f"got DELETE, needed {allowed.replace(', ', ' or ')}"}


@pytest.mark.parametrize(
    "path", ["healthz", "readyz", "metrics", "api/v1/picture", "api/v1/alarms/stream", "api/v1/runs?format=csv", "", "api/v1/x"]
)
def test_head_is_get_without_the_body(served: Served, tmp_path: Path, path: str) -> None:
    with listening(served.service, web=tmp_path) as address, httpx.stream("GET", f"http://{address}/{path}") as got:
        again = httpx.head(f"http://{address}/{path}")
        assert (again.status_code, again.content) == (got.status_code, b"")
        assert again.status_code == (404 if path.endswith("x") else got.status_code)
        changing = ("date", *["content-length"] * (path in ("metrics", "readyz")))  # they say ages
        of_head, of_get = ({k: v for k, v in one.headers.items() if k not in changing} for one in (again, got))
        assert of_head == of_get


def test_details_have_a_tag_and_one_vessel_says_why(served: Served) -> None:
    answer = served.get("/api/v1/vessels?ids=2,4,77777")
    assert [row["vessel_id"] for row in answer.json()["vessels"]] == [2, 4]
    again = served.get("/api/v1/vessels?ids=2,4,77777", headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    one = served.get("/api/v1/vessels/2").json()
    assert [m["source"] for m in one["members"]] == ["guanabara", "ais"]
    assert len(one["associations"]) == len(one["history"]) == 3
    path = served.get("/api/v1/vessels/2/history?from=2025-06-15T15:06:44Z").json()
    assert [row["cycle"] for row in path["history"]] == [1, 2]
    assert served.get("/api/v1/vessels/2/history?to=1970-01-01T00:00:00Z").json()["history"] == []
    assert one["decided"] == []
    assert served.get("/api/v1/vessels/2/decided?limit=5").json() == {"run": 1, "vessel_id": 2, "total": 0, "decided": []}
    assert served.get("/api/v1/vessels/77777/decided").status_code == 404


def test_pages_of_a_past_end_between_two_instants(changing: Served) -> None:
    """Three states of one instant are one page, whatever the limit, and each state is on one page."""
    of = np.array([0, 1, 1, 1, 2])  # cycle of each state of vessel 2
    place, still, spread = np.tile([-22.9, -43.1], (5, 1)), np.zeros((5, 2)), np.tile(np.eye(4), (5, 1, 1))
    decided = DecidedPath(np.full(5, 1002), store_world.instant_s(of), place, still, spread, np.array([-1, -1, 0, 1, -1]))
    cycle = replace(store_world.cycle_of(3, 30), decided=decided)
    store_world.write(changing.store, 1, 3, cycle=cycle)
    for limit, sizes in ((1, [1, 3, 1]), (2, [4, 1]), (3, [4, 1]), (4, [4, 1]), (5, [5])):
        path, found, got = f"/api/v1/vessels/2/decided?limit={limit}", [], []
        while path:
            answer = changing.get(path)
            page = answer.json()["decided"]
            found, got = [*page, *found], [*got, len(page)]
            path = answer.links["next"]["url"] if answer.links else ""
            assert len(got) <= 5
        assert (got, answer.headers["x-total-count"]) == (sizes, str(sizes[-1]))
        assert [row["time_utc"] for row in found] == sorted(row["time_utc"] for row in found)
        assert len(found) == 5


def test_the_status_says_whether_the_scenario_has_a_coastline(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.operators.api.answers.scenarios_folder", lambda: tmp_path)
    assert served.get("/api/v1/status").json()["coastline"] is False
    folder = tmp_path / served.get("/api/v1/status").json()["scenario"]
    folder.mkdir()
    (folder / "coastline.geojson").write_text("{}", "utf-8")
    assert served.get("/api/v1/status").json()["coastline"] is True
    assert served.get("/api/v1/coastline").text == "{}"


def test_health_metrics_and_lists(served: Served) -> None:
    assert served.get("/healthz").json() == {"status": "alive"}
    assert served.get("/readyz").json()["status"] == "ready"
    assert "coastwatch_vessels 28.0" in served.get("/metrics").text
    status = served.get("/api/v1/status").json()
    assert (status["vessels"], status["live"], status["by_kind"]["3"]) == (28, False, 14)
    assert status["run_status"] == "running"
    sensors = {row["name"]: row for row in served.get("/api/v1/sensors").json()["sensors"]}
    assert {row["kind"] for row in sensors.values()} == {"radar", "ais", "bearing"}
    assert {name: row["health"] for name, row in sensors.items()} == {
        "hill": "never heard", "mouth": "never heard", "fort": "never heard", "island": "never heard"
    }  # fmt: skip
    cover = served.get(f"/api/v1/sensors/{sensors['fort']['number']}/cover").json()
    assert (cover["radar"], cover["grid"]) == ("fort", "detection")
    assert [(cell["from_deg"], cell["from_nm"], cell["ais_detection"]) for cell in cover["cells"]] == [(35.0, 1.875, 0.5)]
    clutter = served.get(f"/api/v1/sensors/{sensors['island']['number']}/cover?grid=clutter").json()["cells"]
    assert {cell["name"] for cell in clutter} == {"island"}
    assert served.get("/api/v1/runs").json()["runs"][0]["scenario"] == "sea"
    assert served.get("/api/v1/alarms").json() == {"run": 1, "total": 0, "alarms": []}
    assert served.get("/api/v1/cycles").json()["last_utc"] == status["time_utc"]
    paths = served.get("/api/v1/openapi.json").json()["paths"]
    assert "/api/v1/picture" in paths


def test_the_stream_sends_a_full_frame_then_a_delta_of_each_new_cycle_and_goes_on_after_a_break(changing: Served) -> None:
    import store_world

    page = Page()
    with changing.stream() as socket:
        assert socket.subprotocol == "coastwatch.picture.v1"
        assert page.take(socket.recv()) == FULL
        store_world.write(changing.store, 1, 3)
        assert page.take(socket.recv(timeout=10)) == DELTA
        assert page.seq == 2
    store_world.write(changing.store, 1, 4)
    with changing.stream(f"?run={page.run}&seq={page.seq}") as socket:
        assert page.take(socket.recv(timeout=10)) == DELTA
        assert len(page.positions_deg(page.time_s)) == len(changing.get("/api/v1/picture").json()["vessels"])
        socket.send(json.dumps({"bbox": [-23, -43.21, -22, -43.185]}))
        assert page.take(socket.recv(timeout=10)) == DELTA
        assert sorted(page.ids[page.ids != 0].tolist()) == [1, 2]
        socket.send("{}")
        assert page.take(socket.recv(timeout=10)) == FULL
        socket.send('{"bbox": "everywhere"}')
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=10)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4400
    assert changing.get("/api/v1/status").json()["viewers"] == 0


def test_a_new_run_begins_with_a_full_frame(changing: Served) -> None:
    import store_world

    page = Page()
    with changing.stream() as socket:
        page.take(socket.recv())
        first = page.run
        run_id = store_world.begin(changing.store)
        store_world.write(changing.store, run_id, 0, vessels=5)
        assert page.take(socket.recv(timeout=10)) == FULL
    assert (page.run != first, len(page.ids), changing.get("/api/v1/status").json()["run"]) == (True, 5, run_id)


def test_foreign_hosts_and_origins_are_refused_for_http_and_for_sockets(served: Served) -> None:
    assert served.get("/api/v1/status", headers={"Host": "evil.example"}).status_code == 403
    assert (
        served.get("/api/v1/status", headers={"Origin": "http://evil.example"}).status_code == 200
    )  # it cannot read the answer
    answer = httpx.post(f"http://{served.address}/api/v1/alarms", headers={"Origin": "http://evil.example"})
    assert answer.status_code == 403
    with pytest.raises(InvalidStatus) as refused, served.stream(origin="http://evil.example"):
        pass
    assert refused.value.response.status_code == 403
    with pytest.raises(InvalidStatus) as refused, served.stream("?run=x&seq=-1"):
        pass
    said = json.loads(refused.value.response.body or b"")["detail"]
    assert (refused.value.response.status_code, said) == (
        422,
        "run: got 'x', needed a whole number; seq: got '-1', needed 0 or more",
    )
    with served.stream(origin=f"http://{served.address}") as socket:
        assert socket.recv()
    host, port = served.address.split(":")
    for name, status in (("evil.example", b"403"), (served.address, b"101")):
        asked = f"GET /api/v1/stream HTTP/1.1\r\nHost: {name}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        asked += "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
        with create_connection((host, int(port)), timeout=10.0) as raw:
            raw.sendall(asked.encode())
            assert raw.recv(12).split()[1] == status, name


def test_the_page_is_served_where_it_is_built_and_a_plain_one_says_so_where_not(served: Served, tmp_path: object) -> None:
    from pathlib import Path

    plain = served.get("/")
    assert "not built" in plain.text
    assert "default-src 'self'" in plain.headers["content-security-policy"]
    web = Path(str(tmp_path)) / "web"
    web.mkdir()
    (web / "index.html").write_text("<title>map</title>", "utf-8")
    (web / "worker.mjs").write_text("//", "utf-8")
    with listening(served.service, web=web) as address:
        assert "map" in httpx.get(f"http://{address}/").text
        assert httpx.get(f"http://{address}/worker.mjs").headers["content-type"].startswith("text/javascript")


def test_a_defect_is_answered_with_a_sentence_and_counted(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """The alert on errors of the server counts them here: they were counted nowhere."""

    def broken(*_: object) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(served.service, "run_row", broken)
    answer = served.get("/api/v1/vessels/2/history")
    assert (answer.status_code, answer.json()) == (500, {"detail": "the server has a defect: its log says more"})
    assert 'coastwatch_requests_total{status="500"} 1.0' in served.service.metrics.text().decode()
