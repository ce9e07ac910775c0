"""What a request may be: bodies, queries, heads, trailers and messages are bounded, and a large body holds up nobody."""

from __future__ import annotations

import asyncio
import json
import resource
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest
from fastapi.routing import APIRoute
from server_world import Served, code_of, listening
from starlette.routing import BaseRoute
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import ClientConnection, connect

from coastwatch.operators.api import bounds, guard, validation
from coastwatch.operators.api.application import application
from coastwatch.operators.api.bounds import LargeAnswerQueue, is_large
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.people import Limits, Tokens, add
from coastwatch.operators.api.streaming import take_messages

pytestmark = pytest.mark.whole

MOST_SENT = 16 << 20
"""A flood that is not ended after so many bytes has no bound."""

GROWTH = 24 << 20
"""Of the memory of this process while a flood comes: the tests and the server share it."""


class _Telling:
    """A socket whose other side says one text."""

    def __init__(self, text: str) -> None:
        self.text, self.closed = text, [0]

    async def receive_text(self) -> str:
        return self.text

    async def close(self, code: int, reason: str) -> None:
        self.closed = [code]


@pytest.mark.parametrize("text", ['{"run": "x", "seq": 1e999}', "[" * 60_000, '{"run": "x", "seq": NaN}', "null", "[]"])
def test_a_message_that_is_no_answer_closes_the_socket_with_a_code(text: str) -> None:
    def take(text: str) -> int:
        return int(json.loads(text)["seq"])

    told = _Telling(text)
    asyncio.run(take_messages(told, take, "needed a number"))  # type: ignore[arg-type]
    assert told.closed == [4400]


def memory() -> int:
    """Bytes of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def wrong_points(count: int) -> dict[str, Any]:
    return {"name": "x", "kind": "polygon", "points_deg": [[91, 0]] * count}


def test_errors_of_a_body_are_cut_at_ten_and_the_answer_says_how_many_more_there_are(served: Served) -> None:
    answer = httpx.post(f"http://{served.address}/api/v1/zones", json=wrong_points(900))
    said = answer.json()["detail"]
    assert answer.status_code == 422
    assert said.startswith("points_deg[0]: got latitude 91, needed less than 85; points_deg[1]: ")
    assert said.endswith("points_deg[9]: got latitude 91, needed less than 85; and 890 more")
    one = httpx.post(f"http://{served.address}/api/v1/zones", json=wrong_points(11)).json()["detail"]
    assert one.endswith("; and 1 more")
    none = httpx.post(f"http://{served.address}/api/v1/zones", json=wrong_points(10)).json()["detail"]
    assert none.endswith("points_deg[9]: got latitude 91, needed less than 85")
    assert "more" not in none


def test_one_error_is_no_longer_than_a_sentence(served: Served) -> None:
    body = {"name": "x", "kind": "circle", **{f"{'y' * 20_000}{k}": 1 for k in range(5)}}
    answer = httpx.post(f"http://{served.address}/api/v1/zones", json=body)
    assert answer.status_code == 422
    assert len(answer.content) < 5_000


@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_is_bounded_in_bytes_and_values_before_it_is_validated(
    served: Served, chunked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> None:
        raise AssertionError("it was validated")

    monkeypatch.setattr(validation, "_check", never)

    def refused(data: bytes) -> httpx.Response:
        content = iter([data[k : k + 4096] for k in range(0, len(data), 4096)]) if chunked else data
        return httpx.post(
            f"http://{served.address}/api/v1/zones", content=content, headers={"Content-Type": "application/json"}
        )

    large = refused(b" " * bounds.LARGEST_BODY + b"{}")
    assert (large.status_code, large.json()["detail"].endswith(f"needed at most {bounds.LARGEST_BODY}")) == (413, True)
    many = refused(b'{"points_deg": [' + b"0," * bounds.MOST_VALUES + b"0]}")
    assert (many.status_code, many.json()["detail"].startswith("body: got more than ")) == (413, True)


def test_every_route_with_a_body_checks_it_so(served: Served) -> None:
    def routes(of: list[BaseRoute]) -> Iterator[APIRoute]:
        for route in of:
            if isinstance(route, APIRoute):
                yield route
            yield from routes(getattr(getattr(route, "original_router", route), "routes", None) or [])

    found = [route for route in routes(application(served.service, Guard()).routes) if route.body_field is not None]
    assert {route.path.rpartition("/")[2] for route in found} >= {"session", "zones", "acknowledge"}
    assert all(isinstance(route, validation.CheckedRoute) for route in found)


def test_while_a_large_body_is_validated_other_requests_are_answered(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    checking, go_on, threads = threading.Event(), threading.Event(), []
    check = validation._check

    def held(*given: Any) -> None:
        threads.append(threading.current_thread().name)
        checking.set()
        assert go_on.wait(20.0)
        check(*given)

    monkeypatch.setattr(validation, "_check", held)
    answers: list[httpx.Response] = []
    url = f"http://{served.address}/api/v1/zones"
    sender = threading.Thread(target=lambda: answers.append(httpx.post(url, json=wrong_points(2000), timeout=30.0)))
    sender.start()
    try:
        assert checking.wait(10.0)
        assert served.get("/healthz", timeout=10.0).status_code == 200
        assert not answers
    finally:
        go_on.set()
        sender.join()
    assert answers[0].status_code == 422
    assert answers[0].json()["detail"].endswith("and 1990 more")
    assert len(threads) == 1


def test_a_query_is_bounded_before_it_is_validated(served: Served) -> None:
    many = "&".join(f"x{k}=1" for k in range(bounds.MOST_PARAMETERS + 1))
    answer = served.get(f"/api/v1/picture?{many}")
    assert (answer.status_code, answer.json()["detail"]) == (
        400, f"query: got {bounds.MOST_PARAMETERS + 1} parameters, needed at most {bounds.MOST_PARAMETERS}",
    )  # fmt: skip
    few = served.get("/api/v1/picture?" + "&".join(f"x{k}=1" for k in range(40)))
    assert (few.status_code, few.json()["detail"].endswith("; and 30 more")) == (422, True)
    for path in (f"/api/v1/picture?q={'x' * bounds.LARGEST_TARGET}", f"/{'x' * bounds.LARGEST_TARGET}"):
        long = served.get(path)
        assert (long.status_code, long.json()["detail"].endswith(f"needed at most {bounds.LARGEST_TARGET}")) == (414, True)
    for query, status in ((f"?{many}", 400), (f"?run={'1' * bounds.LARGEST_TARGET}", 414)):
        with pytest.raises(InvalidStatus) as refused, served.stream(query):
            pass
        assert refused.value.response.status_code == status


def test_a_head_of_a_socket_that_is_refused_ends_its_connection_and_no_server(served: Served) -> None:
    for name in ("X-Long", "Cookie"):
        with pytest.raises(InvalidStatus) as refused, served.stream(additional_headers={name: "x" * 9000}):
            pass
        assert refused.value.response.status_code in (400, 431)


def test_headers_are_bounded_together(served: Served) -> None:
    answer = served.get("/healthz", headers={f"x-{k}": "y" * 7000 for k in range(11)})
    assert answer.status_code in (400, 431)


def address_of(served: Served) -> tuple[str, int]:
    host, _, port = served.address.rpartition(":")
    return host, int(port)


def sent_until_closed(out: socket.socket, piece: bytes) -> int:
    """Send a piece again and again until the other end closes the connection. Returns: bytes sent, at most MOST_SENT."""
    sent, piece = 0, piece * (65_536 // len(piece) or 1)
    out.settimeout(0.01)
    while sent < MOST_SENT:
        try:
            sent += out.send(piece)
        except TimeoutError:
            pass
        except OSError:
            return sent
        try:
            if not out.recv(65_536):
                return sent
        except TimeoutError:
            continue
        except OSError:
            return sent
    return sent


HEAD = b"POST /api/v1/zones HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
CHUNKED = HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
FLOODS: dict[str, tuple[bytes, bytes]] = {
    "a header": (b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: ", b"a" * 8192),
    "headers": (b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"a: b\r\n" * 2000),
    "a request line": (b"GET /", b"a" * 8192),
    "trailers": (CHUNKED + b"2\r\n{}\r\n0\r\n", b"a: b\r\n" * 2000),
    "a trailer": (CHUNKED + b"2\r\n{}\r\n0\r\nX-Long: ", b"a" * 8192),
    "chunks": (CHUNKED, b"2000\r\n" + b" " * 8192 + b"\r\n"),
    "small chunks": (CHUNKED, b"1;" + b"x" * 4000 + b"\r\n \r\n"),
    "chunks that nobody asked for": (
        b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n", b"2000\r\n" + b" " * 8192 + b"\r\n",
    ),
    "chunks beside a stream": (
        b"GET /api/v1/alarms/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n",
        b"2000\r\n" + b" " * 8192 + b"\r\n",
    ),
    "a length that is more than a body may have": (HEAD + b"Content-Length: 9999999999\r\n\r\n", b" " * 8192),
}  # fmt: skip


@pytest.mark.parametrize("name", FLOODS)
def test_what_has_no_end_is_cut_after_a_bound_and_takes_no_memory(served: Served, name: str) -> None:
    first, piece = FLOODS[name]
    before = memory()
    with socket.create_connection(address_of(served)) as out:
        out.sendall(first)
        sent = sent_until_closed(out, piece)
    assert sent < MOST_SENT, "it was not cut"
    assert memory() - before < GROWTH
    assert served.get("/healthz").status_code == 200


def test_requests_that_come_before_their_answers_are_read_wait_outside(served: Served) -> None:
    """Pipelined requests: what is read ahead of the answers is bounded."""
    before = memory()
    with socket.create_connection(address_of(served)) as out:
        out.settimeout(0.2)
        sent, piece = 0, b"GET /api/v1/picture HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 500
        try:
            while sent < MOST_SENT:
                sent += out.send(piece)
        except OSError:
            pass
    assert sent < MOST_SENT
    assert memory() - before < GROWTH


def test_whoever_reads_no_answer_is_closed(served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.operators.api.slow_requests.UNREAD_S", 0.3)
    (tmp_path / "large").write_bytes(bytes(32 << 20))
    (tmp_path / "index.html").write_text("")
    with listening(served.service, web=tmp_path) as address:
        host, _, port = address.rpartition(":")
        with socket.create_connection((host, int(port))) as out:
            out.sendall(b"GET /large HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            time.sleep(2.0)
            out.settimeout(5.0)
            assert taken_until_closed(out) < 32 << 20
        with httpx.stream(
            "GET", f"http://{address}/large", headers={"Accept-Encoding": "identity"}
        ) as slow:  # slow, but it reads
            taken = 0
            for data in slow.iter_raw(1 << 20):
                taken += len(data)
                time.sleep(0.02)
            assert taken == 32 << 20


def taken_until_closed(out: socket.socket) -> int:
    taken = 0
    try:
        while data := out.recv(1 << 20):
            taken += len(data)
    except OSError:
        pass
    return taken


def test_a_message_of_a_socket_is_bounded_in_bytes_and_fragments(served: Served) -> None:
    with served.stream() as viewer:
        viewer.recv(timeout=10)
        viewer.send(" " * 70_000)
        assert code_of(viewer) == 1009
    before = memory()
    with served.stream() as viewer:
        viewer.recv(timeout=10)
        fragment = Frame(Opcode.CONT, b"", fin=False).serialize(mask=True, extensions=[])
        first = Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True, extensions=[])
        viewer.socket.sendall(first)
        assert flood(viewer, fragment * 1000) < MOST_SENT // 2
    assert memory() - before < GROWTH


def test_pings_of_a_viewer_that_does_not_read_are_bounded(served: Served) -> None:
    """Each ping has a pong, which waits until the viewer reads."""
    before = memory()
    host, port = address_of(served)
    with socket.create_connection((host, port)) as out:
        out.sendall(
            b"GET /api/v1/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        ping = Frame(Opcode.PING, b"x" * 120).serialize(mask=True, extensions=[])
        out.settimeout(1.0)
        sent = 0
        try:
            while sent < 4 * MOST_SENT:
                sent += out.send(ping * 100)
        except OSError:
            pass
    assert sent < 4 * MOST_SENT
    assert memory() - before < GROWTH


def flood(viewer: ClientConnection, piece: bytes) -> int:
    sent = 0
    try:
        while sent < MOST_SENT:
            viewer.socket.sendall(piece)
            sent += len(piece)
    except OSError:
        pass
    return sent


@pytest.fixture
def guarded(served: Served, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Makes a server with tokens. Returns: its address, and a token of a viewer."""
    with ExitStack() as stack:

        def made(**given: Any) -> tuple[str, str]:
            path = tmp_path / "tokens.toml"
            token = add(path, "watch", "viewer", None)
            return stack.enter_context(listening(served.service, Guard(tokens=Tokens(path), **given), tmp_path)), token

        yield made


def test_tokens_are_guessed_over_sockets_as_seldom_as_over_requests(guarded: Callable[..., Any]) -> None:
    address, token = guarded(limits=lambda: Limits(0.001, 5.0))

    def guess() -> int:
        try:
            with connect(f"ws://{address}/api/v1/stream", subprotocols=["bearer.wrong"]) as tried:  # type: ignore[list-item]
                return code_of(tried)
        except InvalidStatus as refused:
            return refused.response.status_code

    assert [guess() for _ in range(3)] == [4401] * 3
    answers = [httpx.get(f"http://{address}/api/v1/status", headers={"Authorization": "Bearer x"}) for _ in range(3)]
    assert [answer.status_code for answer in answers] == [401, 401, 429]
    assert guess() == 429
    right = httpx.get(f"http://{address}/api/v1/status", headers={"Authorization": f"Bearer {token}"})
    assert right.status_code == 200, "a token has a limit of its own"


def test_files_of_the_page_take_nothing_from_the_limit_of_other_requests(guarded: Callable[..., Any]) -> None:
    address, token = guarded(limits=lambda: Limits(0.001, 4.0), file_limits=lambda: Limits(0.001, 12.0))
    with httpx.Client(base_url=f"http://{address}", headers={"Authorization": f"Bearer {token}"}) as client:
        assert [client.get("/land/0/0/0").status_code for _ in range(9)] == [200] * 9
        assert [client.get("/api/v1/status").status_code for _ in range(5)] == [*[200] * 4, 429]
        assert client.post("/session", json={"token": token}).status_code == 429, "a sign-in is no file"
        assert [client.get("/land/0/0/0").status_code for _ in range(4)] == [*[200] * 3, 429]


def test_streams_of_alarms_are_limited_for_each_token_and_in_all(
    guarded: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "MOST_STREAMS", 3)
    address, token = guarded(most_open=4)
    url, headers = f"http://{address}/api/v1/alarms/stream", {"Authorization": f"Bearer {token}"}
    with httpx.Client(headers=headers, timeout=10.0) as client, ExitStack() as stack:
        open_now = [stack.enter_context(client.stream("GET", url)) for _ in range(3)]
        assert [answer.status_code for answer in open_now] == [200] * 3
        refused = client.get(url)
        assert (refused.status_code, "needed at most 3" in refused.json()["detail"]) == (429, True)
        assert int(refused.headers["retry-after"]) > 0
        with connect(f"ws://{address}/api/v1/stream", subprotocols=[f"bearer.{token}"], max_size=2**26) as socket_of_4:  # type: ignore[list-item]
            assert socket_of_4.recv(timeout=10)
            monkeypatch.setattr(guard, "MOST_STREAMS", 30)
            full = client.get(url)
            assert (full.status_code, "all" in full.json()["detail"]) == (503, True)
            assert int(full.headers["retry-after"]) > 0
            with connect(f"ws://{address}/api/v1/stream", subprotocols=[f"bearer.{token}"]) as fifth:  # type: ignore[list-item]
                assert code_of(fifth) == guard.TOO_MANY_SOCKETS
        assert client.get(f"http://{address}/api/v1/status").status_code == 200
        open_now[0].close()
        for _ in range(100):
            with client.stream("GET", url) as again:
                if again.status_code == 200:
                    break
            time.sleep(0.05)
        else:
            raise AssertionError("a stream that ended has left no room")


def test_sockets_and_streams_together_leave_half_of_the_files_that_may_be_open(served: Served, tmp_path: Path) -> None:
    with listening(served.service, Guard(most_open=2), tmp_path) as address, ExitStack() as stack:
        for _ in range(2):
            stack.enter_context(httpx.stream("GET", f"http://{address}/api/v1/alarms/stream", timeout=10.0))
        assert httpx.get(f"http://{address}/api/v1/alarms/stream").status_code == 503
    assert 0 < guard.room(1024) == 512
    assert guard.room(1 << 20) == guard.MOST_OPEN


def test_openapi_still_has_the_bodies(served: Served) -> None:
    paths = json.loads(served.get("/api/v1/openapi.json").text)["paths"]
    assert "requestBody" in paths["/api/v1/zones"]["post"]


class _Counted:
    """An application whose large answers take a while; how many are computed at a time, and which answers were given."""

    def __init__(self, takes_s: float) -> None:
        self.takes_s, self.now, self.most, self.given = takes_s, 0, 0, list[str]()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.now += is_large(scope)
        self.most = max(self.most, self.now)
        await asyncio.sleep(self.takes_s if is_large(scope) else 0.0)
        self.now -= is_large(scope)
        self.given.append(scope["state"]["who"])
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await asyncio.sleep(self.takes_s)  # a slow reader
        await send({"type": "http.response.body", "body": b""})


async def _asked(app: LargeAnswerQueue, *asked: tuple[str, str]) -> list[tuple[int, dict[bytes, bytes]]]:
    """The answers, statuses and headers, to requests that come at once. Args: asked: who and path."""

    async def ask(who: str, target: str) -> tuple[int, dict[bytes, bytes]]:
        path, _, query = target.partition("?")
        sent: list[Any] = []
        scope = {"type": "http", "method": "GET", "path": path, "query_string": query.encode(), "state": {"who": who}}

        async def send(message: Any) -> None:
            sent.append(message)

        await app(scope, None, send)  # type: ignore[arg-type]
        return sent[0]["status"], dict(sent[0]["headers"])

    return await asyncio.gather(*(ask(*one) for one in asked))


PICTURE = "/api/v1/picture"


def test_large_answers_wait_for_their_turn_and_one_name_does_not_keep_out_another() -> None:
    app = _Counted(0.01)
    answers = asyncio.run(
        _asked(LargeAnswerQueue(app), *[("many", PICTURE)] * 8, ("one", PICTURE), ("small", "/api/v1/status"))
    )
    assert [status for status, _ in answers] == [200] * 10
    assert app.most == bounds.AT_A_TIME
    assert app.given[0] == "small"
    assert app.given.index("one") <= 2


def test_a_large_answer_whose_turn_does_not_come_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "WAIT_S", 0.02)
    app = _Counted(0.1)
    answers = asyncio.run(_asked(LargeAnswerQueue(app), *[("many", PICTURE)] * 3, ("other", "/api/v1/vessels/3/history")))
    assert sorted(status for status, _ in answers) == [200, 429, 429, 429]
    assert all(b"retry-after" in headers for status, headers in answers if status == 429)


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("/api/v1/picture?limit=10000", True), ("/api/v1/frame", True), ("/api/v1/vessels/7/decided", True),
        ("/api/v1/vessels?ids=1&at=2026-07-01", True), ("/api/v1/vessels?ids=1", False), ("/api/v1/vessels/7?at=x", False),
        ("/api/v1/status", False), ("/api/v1/alarms", False), ("/api/v1/stream", False),
    ],
)  # fmt: skip
def test_which_answers_are_large(target: str, expected: bool) -> None:
    path, _, query = target.partition("?")
    assert is_large({"path": path, "query_string": query.encode()}) == expected
