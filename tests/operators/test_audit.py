"""Who changed what: a row for each change through the API, read by admins only."""

from __future__ import annotations

import json
import logging
import time
from pathlib import Path

import httpx2 as httpx
import pytest
from server_world import Served, listening, raise_alarm, wait_for
from starlette.datastructures import Headers

from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.operators.api import logs
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.people import Tokens, add, trusted

pytestmark = pytest.mark.whole


def test_a_change_is_noted_with_who_made_it_and_a_refused_one_is_not(changing: Served, tmp_path: Path) -> None:
    path = tmp_path / "tokens.toml"
    made = {role: {"Authorization": f"Bearer {add(path, role, role, None)}"} for role in ("viewer", "operator", "admin")}
    raise_alarm(changing, 3, 4)
    wait_for(lambda: changing.service.picture().cycle == 3)
    alarm = changing.get("/api/v1/alarms").json()["alarms"][0]["alarm_id"]
    before_s = time.time()
    with (
        listening(changing.service, Guard(tokens=Tokens(path)), tmp_path) as address,
        httpx.Client(base_url=f"http://{address}") as client,
    ):
        asked = f"/api/v1/alarms/{alarm}/acknowledge"
        said = [client.post(asked, json={"name": "Ana"}, headers=made[who]).status_code for who in ("viewer", "operator")]
        assert said == [403, 200]
        assert client.post(asked, json={"name": ""}, headers=made["admin"]).status_code == 422
        found = client.get("/api/v1/audit", headers=made["admin"]).json()
        assert client.get("/api/v1/audit", headers=made["operator"]).status_code == 403
    (change,) = found["changes"]
    assert (change["who"], change["role"], change["method"], change["path"]) == ("operator", "operator", "POST", asked)
    assert (change["http_status"], change["client"], change["body"]) == (200, "127.0.0.1", '{"name":"Ana"}')
    assert change["time_utc"] >= time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(before_s))


PROXY = trusted(["10.1.0.0/16", "::1"])
SAID = {"X-Forwarded-User": "ana", "X-Forwarded-Groups": "staff, coastwatch-viewer,coastwatch-operator"}


@pytest.mark.parametrize(
    ("client", "headers", "role"),
    [
        ("10.1.2.3", SAID, "operator"),
        ("::ffff:10.1.2.3", SAID, "operator"),
        ("::1", SAID | {"X-Forwarded-Groups": "coastwatch-admin"}, "admin"),
        ("10.2.0.1", SAID, None),
        ("unknown", SAID, None),
        ("10.1.2.3", SAID | {"X-Forwarded-Groups": "coastwatch-king,admin"}, None),
        ("10.1.2.3", SAID | {"X-Forwarded-User": " "}, None),
        ("10.1.2.3", {"X-Forwarded-Groups": "coastwatch-admin"}, None),
    ],
)
def test_only_the_trusted_proxy_says_who_asks(client: str, headers: dict[str, str], role: str | None) -> None:
    found = PROXY.person(client, Headers(headers))
    assert (None if found is None else found.role) == role


def test_a_header_that_comes_twice_is_not_believed() -> None:
    raw = [(name.lower().encode(), value.encode()) for name, value in SAID.items()]
    assert PROXY.person("10.1.2.3", Headers(raw=raw)) is not None
    assert PROXY.person("10.1.2.3", Headers(raw=[*raw, (b"x-forwarded-groups", b"coastwatch-admin")])) is None


def test_a_proxy_that_is_everybody_is_refused() -> None:
    for wrong in ("0.0.0.0/0", "10.0.0.300", "10.0.0.1/8"):
        with pytest.raises(InputError, match="--trusted-proxy"):
            trusted([wrong])


def test_behind_a_proxy_nobody_else_is_answered(served: Served, tmp_path: Path) -> None:
    for networks, status in (("127.0.0.1", 200), ("10.0.0.1", 401)):
        with listening(served.service, Guard(proxy=trusted([networks])), tmp_path) as address:
            assert httpx.get(f"http://{address}/api/v1/status").status_code == 401
            answer = httpx.get(f"http://{address}/api/v1/status", headers=SAID)
            assert answer.status_code == status
            if status == 200:
                assert (answer.json()["name"], answer.json()["role"]) == ("ana", "operator")


@pytest.mark.parametrize("form", ["text", "json"])
def test_no_text_of_others_makes_a_line_of_the_log_or_moves_a_cursor(form: str) -> None:
    path = "/api/v1/x\ncoastwatch: stopped\n\x1b[2J\u202e"
    error = ValueError("\x1b[2J\u202e")
    record = logging.makeLogRecord(
        {"name": "coastwatch.serve", "levelno": logging.WARNING, "levelname": "WARNING", "msg": "refused: %s", "args": (path,)}
    )
    record.exc_info = type(error), error, None
    record.fields = {"path": path}
    said = logs._Lines(form == "json").format(record)
    assert all(line.isprintable() for line in said.split("\n"))
    assert not any(line.startswith("coastwatch: stopped") for line in said.split("\n"))
    if form == "json":
        assert json.loads(said)["path"] == path


def test_examples_of_faults_are_printable() -> None:
    tally = Tally()
    tally.add("unknown radar", "feed\x1b:3", "north\x1b[2J\n\u202e")
    tally.add("bytes", "feed:4", b"\x1b" * 100)
    first, second = tally.faults()
    assert (first.where, first.example) == (r"feed\x1b:3", r"north\x1b[2J\n\u202e")
    assert second.example == r"\x1b" * 20
