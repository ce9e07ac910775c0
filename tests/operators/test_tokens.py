"""Tokens: who may ask what, and what is refused before it is read."""

from __future__ import annotations

import logging
import logging.handlers
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx2 as httpx
import pytest
from fastapi.routing import APIRoute
from server_world import Served, code_of, listening, wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from coastwatch.errors import InputError
from coastwatch.operators.api.answers import router
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.people import Limits, Tokens, add, read
from coastwatch.operators.cli import main, make_parser
from coastwatch.operators.cli.serving import serve

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory, served: Served) -> Iterator[dict[str, str]]:
    """A server with tokens: its address, and a token of each role."""
    folder = tmp_path_factory.mktemp("tokens")
    path = folder / "tokens.toml"
    made = {role: add(path, f"a {role}", role, None) for role in ("viewer", "operator", "admin")}
    made["old"] = add(path, "old", "admin", 1.0)
    assert path.stat().st_mode & 0o077 == 0
    assert not any(token in path.read_text("utf-8") for token in made.values())
    with listening(served.service, Guard(tokens=Tokens(path)), web=folder) as address:
        yield {**made, "address": address, "path": str(path)}


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_every_path_of_the_api_needs_a_token(given: dict[str, str]) -> None:
    paths = [(route.path, method) for route in router.routes if isinstance(route, APIRoute) for method in route.methods]
    assert len(paths) > 10
    with httpx.Client(base_url=f"http://{given['address']}") as client:
        for path, method in [*paths, ("/metrics", "GET"), ("/readyz", "GET"), ("/api/v1/openapi.json", "GET")]:
            asked = path.replace("{vessel_id}", "2").replace("{number}", "0")
            assert client.request(method, asked).status_code == 401, path
        for wrong in ("x", "x" * 43, given["old"], given["viewer"][:-1]):
            assert client.get("/api/v1/status", headers=bearer(wrong)).status_code == 401
        assert client.get("/api/v1/status", headers=bearer(given["viewer"])).json()["role"] == "viewer"
        assert client.get("/healthz").status_code == client.get("/").status_code == 200


def test_a_viewer_may_read_and_change_nothing(given: dict[str, str]) -> None:
    with httpx.Client(base_url=f"http://{given['address']}") as client:
        path, body = "/api/v1/alarms/4-dark-1/acknowledge", {"name": "Ana"}
        assert client.post(path, json=body, headers=bearer(given["viewer"])).status_code == 403
        wait_for(lambda: client.post(path, json=body, headers=bearer(given["operator"])).status_code != 503)  # a busy machine
        assert client.post(path, json=body, headers=bearer(given["operator"])).status_code == 404
        assert client.get("/api/v1/audit", headers=bearer(given["operator"])).status_code == 403
        assert client.put("/api/v1/status", headers=bearer(given["viewer"])).status_code == 405


def test_a_person_types_a_token_once_and_has_a_cookie_that_scripts_cannot_read(given: dict[str, str]) -> None:
    with httpx.Client(base_url=f"http://{given['address']}") as client:
        assert client.post("/session", json={"token": "wrong"}).status_code == 401
        answer = client.post("/session", json={"token": given["operator"]})
        assert answer.json() == {"name": "a operator", "role": "operator"}
        assert {"HttpOnly", "SameSite=strict"} <= set(answer.headers["set-cookie"].split("; "))
        assert client.get("/api/v1/status").json()["role"] == "operator"
        assert client.post("/session", json={"token": "x"}, headers={"Origin": "http://evil.example"}).status_code == 403
        client.delete("/session")
        assert client.get("/api/v1/status").status_code == 401


def test_a_socket_needs_a_token_and_says_so(given: dict[str, str]) -> None:
    url, protocol = f"ws://{given['address']}/api/v1/stream", "coastwatch.picture.v1"
    with connect(url, subprotocols=[protocol, f"bearer.{given['viewer']}"]) as socket:
        assert socket.subprotocol == protocol
        assert socket.recv(timeout=10)
    with connect(url, subprotocols=[protocol]) as socket, pytest.raises(ConnectionClosed) as closed:
        socket.recv(timeout=10)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4401


def test_an_open_socket_and_the_stream_of_alarms_end_when_their_token_is_taken_away(served: Served, tmp_path: Path) -> None:
    path = tmp_path / "tokens.toml"
    add(path, "other", "admin", None)
    kept = path.read_text("utf-8")
    given = add(path, "watch", "viewer", None)
    guard = Guard(tokens=Tokens(path), recheck_s=0.2)
    with (
        listening(served.service, guard, tmp_path) as address,
        connect(f"ws://{address}/api/v1/stream", subprotocols=[f"bearer.{given}"], max_size=2**26) as socket,
        httpx.stream("GET", f"http://{address}/api/v1/alarms/stream", headers=bearer(given), timeout=20.0) as alarms,
    ):
        assert socket.recv(timeout=10)
        path.write_text(kept, "utf-8")
        os.utime(path, (1, 1))
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=10)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4401
        assert [line for line in alarms.iter_lines() if line.startswith("data")] in ([], ['data: {"run": 1}'])


def test_a_page_before_its_sign_in_is_not_warned_of_but_a_wrong_token_is(
    given: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    handler = logging.handlers.BufferingHandler(1000)  # of its own: caplog's is called twice after a server's begin()
    monkeypatch.setattr(logging.getLogger("coastwatch.serve"), "handlers", [handler])

    def refused() -> list[str]:  # a busy machine also warns of late cycles
        return [record.getMessage() for record in handler.buffer if "refused" in record.getMessage()]

    with httpx.Client(base_url=f"http://{given['address']}") as client:
        assert client.get("/api/v1/status").status_code == 401
        assert refused() == []
        client.get("/api/v1/status", headers=bearer("x"))
        client.get("/api/v1/status", headers={"Cookie": "coastwatch=x"})
        client.post("/session", json={"token": "x"})
    url = f"ws://{given['address']}/api/v1/stream"
    for offered in ([], ["bearer.x"]):
        with connect(url, subprotocols=["coastwatch.picture.v1", *offered]) as socket, pytest.raises(ConnectionClosed):
            socket.recv(timeout=10)
    assert refused() == [*3 * ["request refused"], "socket refused"]


def test_a_large_body_is_refused_and_a_token_may_ask_so_often(given: dict[str, str]) -> None:
    with httpx.Client(base_url=f"http://{given['address']}") as client:
        assert client.post("/session", content=b"x" * (1 << 20) + b"x").status_code == 413
    limits = Limits()
    assert [limits.wait_s("a") for _ in range(60)] == [0.0] * 60
    assert 0.0 < limits.wait_s("a") <= 0.05
    assert limits.wait_s("b") == 0.0


def test_a_token_that_asks_on_keeps_its_limit_beside_many_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.operators.api.people.MOST_BUCKETS", 3)
    limits = Limits(0.001, 5.0)
    assert [limits.wait_s("busy") > 0.0 for _ in range(7)] == 5 * [False] + 2 * [True]
    for number in range(9):
        assert limits.wait_s(f"address {number}") == 0.0
        assert limits.wait_s("busy") > 0.0


def test_a_token_that_is_deleted_from_the_file_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "tokens.toml"
    first, second = add(path, "first", "viewer", None), add(path, "second", "viewer", None)
    tokens = Tokens(path)
    assert tokens.person(first) is not None
    text = path.read_text("utf-8")
    path.write_text(text[text.index("[[tokens]]", 20) :], "utf-8")
    os.utime(path, (1, 1))
    assert (tokens.person(first), tokens.person(second).name) == (None, "second")  # type: ignore[union-attr]


def test_a_typo_in_the_file_keeps_the_tokens_of_before_and_is_a_trouble_until_it_is_mended(
    served: Served, tmp_path: Path
) -> None:
    path = tmp_path / "tokens.toml"
    other = add(path, "other", "viewer", None)
    kept = path.read_text("utf-8")
    given = add(path, "watch", "viewer", None)
    good = path.read_text("utf-8")
    guard = Guard(tokens=Tokens(path), recheck_s=0.1)

    def put(text: str) -> None:
        """At once: half a file would be a right one without tokens."""
        new = tmp_path / "new.toml"
        new.write_text(text, "utf-8")
        new.replace(path)

    def troubles(client: httpx.Client) -> list[dict[str, str]]:
        both = [client.get(asked, headers=bearer(other)).json()["troubles"] for asked in ("/readyz", "/api/v1/status")]
        assert both[0] == both[1]
        return [one for one in both[0] if one["kind"] == "tokens"]

    with (
        listening(served.service, guard, tmp_path) as address,
        httpx.Client(base_url=f"http://{address}") as client,
        connect(f"ws://{address}/api/v1/stream", subprotocols=[f"bearer.{given}"], max_size=2**26) as socket,
    ):
        assert troubles(client) == []
        for wrong in (good + "[[tokens]\n", good + "[[tokens]]\nname = 'x'\nrole = 'king'\ntoken = 's3cret'\n", "\0", None):
            path.unlink() if wrong is None else put(wrong)
            (trouble,) = troubles(client)
            assert (trouble["name"], trouble["serious"]) == ("tokens.toml", False)
            assert trouble["text"].startswith("the tokens of before hold: ")
            assert "s3cret" not in trouble["text"]
            assert client.get("/api/v1/status", headers=bearer(given)).status_code == 200
            assert client.get("/api/v1/status", headers=bearer("x")).status_code == 401
        put(kept)
        assert code_of(socket) == 4401
        assert client.get("/api/v1/status", headers=bearer(given)).status_code == 401
        assert troubles(client) == []
        put("")  # a right file without tokens: nobody
        assert client.get("/api/v1/status", headers=bearer(other)).status_code == 401
    assert guard.troubles()[0].text == "there is no token in it, so nobody may ask"


def test_what_ends_the_recheck_of_a_socket_or_stream_ends_it_too(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tokens.toml"
    given = add(path, "watch", "viewer", None)
    guard = Guard(tokens=Tokens(path), recheck_s=0.1)
    with (
        listening(served.service, guard, tmp_path) as address,
        connect(f"ws://{address}/api/v1/stream", subprotocols=[f"bearer.{given}"], max_size=2**26) as socket,
        httpx.stream("GET", f"http://{address}/api/v1/alarms/stream", headers=bearer(given), timeout=20.0) as alarms,
    ):
        assert socket.recv(timeout=10)
        monkeypatch.setattr(Tokens, "person", lambda *_: 1 / 0)
        assert code_of(socket) == 4401
        list(alarms.iter_lines())  # it ends in order


KING = f"[[tokens]]\nname = 'a'\nrole = 'king'\nsha256 = '{'0' * 64}'"


@pytest.mark.parametrize("text", ["[[tokens]]\nname = 'a'", "tokens = 3", "[[tokens", KING])
def test_a_wrong_file_of_tokens_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokens.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"tokens\.toml"):
        read(path)


@pytest.mark.parametrize("name", ["", 65 * "a", "a\nb", "a\x1b[2Jb", "a\x7f", "\udc80"])
def test_a_name_that_the_file_cannot_hold_is_refused_and_not_written(tmp_path: Path, name: str) -> None:
    path = tmp_path / "tokens.toml"
    with pytest.raises(InputError, match=r"name: got .*, needed "):
        add(path, name, "viewer", None)
    assert not path.exists()
    add(path, 'Zo\xeb "\U0001f600" \\', "viewer", None)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"name: got .*, needed "):
        add(path, name, "viewer", None)
    assert path.read_bytes() == before
    assert [token.name for token in read(path)] == ['Zo\xeb "\U0001f600" \\']


def test_a_used_port_is_refused_before_anything_starts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        assert main(["serve", "guanabara", "--db", str(tmp_path / "x.db"), "--port", str(port)]) == 1
    said = capsys.readouterr().err
    assert said == (
        f"coastwatch: error: 127.0.0.1:{port}: Address already in use: is another server running there? --port chooses another one\n"
    )
    assert not (tmp_path / "x.db").exists()


def test_another_address_than_loopback_is_not_opened_without_tokens() -> None:
    options = make_parser().parse_args(["serve", "--host", "0.0.0.0"])
    with pytest.raises(InputError, match="without --tokens"):
        serve(options)
