"""Requests that are sent in part: their connections are closed, and others go on."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest
from server_world import Served, listening, wait_for
from websockets.sync.client import connect

pytestmark = pytest.mark.whole

HEAD_S = 0.6
BEGUN = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "


@contextmanager
def impatient(served: Served, folder: Path, monkeypatch: pytest.MonkeyPatch, **limits: Any) -> Iterator[tuple[str, int]]:
    """A server that waits for a head for HEAD_S. Yields: host and port."""
    from coastwatch.operators.api.slow_requests import SlowRequestGuard

    given = {"head_s": HEAD_S, **limits}
    monkeypatch.setattr(
        "coastwatch.operators.cli.serving.SlowRequestGuard", lambda app, closed: SlowRequestGuard(app, closed, **given)
    )
    with listening(served.service, web=folder) as address:
        host, _, port = address.rpartition(":")
        yield host, int(port)


def closed_after_s(out: socket.socket, trickle: bytes = b"a", every_s: float = 0.05, longest_s: float = 5.0) -> float:
    """Send a byte at a time until the other end closes the connection. Returns: after how long; inf: it did not."""
    began_s = time.monotonic()
    out.settimeout(every_s)
    while time.monotonic() - began_s < longest_s:
        try:
            out.sendall(trickle)
            if not out.recv(4096):
                return time.monotonic() - began_s
        except TimeoutError:
            continue
        except OSError:
            return time.monotonic() - began_s
    return float("inf")


def counted(served: Served) -> float:
    return served.service.metrics.registry.get_sample_value("coastwatch_requests_total", {"status": "408"}) or 0.0


def test_a_head_that_comes_byte_by_byte_ends_its_connection_also_after_a_whole_request(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = counted(served)
    with impatient(served, tmp_path, monkeypatch) as where:
        with socket.create_connection(where) as out:
            out.sendall(BEGUN)
            assert HEAD_S * 0.8 < closed_after_s(out) < 5.0
        with socket.create_connection(where) as silent:
            silent.settimeout(5.0)
            assert silent.recv(1) == b""
        with socket.create_connection(where) as out:
            out.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            assert out.recv(4096).startswith(b"HTTP/1.1 200")
            out.sendall(BEGUN)
            assert HEAD_S * 0.8 < closed_after_s(out) < 5.0
        assert counted(served) == before + 3


def test_a_body_that_comes_byte_by_byte_is_answered_and_ends_its_connection(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.operators.api.guard.BODY_S", 0.5)
    with impatient(served, tmp_path, monkeypatch) as where, socket.create_connection(where) as out:
        out.sendall(
            b"POST /session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 900\r\n\r\n{"
        )
        assert closed_after_s(out) < 5.0


def test_requests_sockets_and_streams_of_alarms_outlast_it(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        impatient(served, tmp_path, monkeypatch) as (host, port),
        httpx.Client(base_url=f"http://{host}:{port}") as client,
        connect(f"ws://{host}:{port}/api/v1/stream", subprotocols=["coastwatch.picture.v1"], max_size=2**26) as viewer,
        httpx.stream("GET", f"http://{host}:{port}/api/v1/alarms/stream", timeout=5.0) as alarms,
    ):
        assert viewer.recv(timeout=5.0)
        assert client.get("/healthz").status_code == 200
        time.sleep(2.0 * HEAD_S)
        assert client.get("/healthz").status_code == 200
        viewer.send('{"kinds": 7}')
        assert viewer.recv(timeout=5.0)
        assert alarms.status_code == 200


def test_of_many_that_wait_the_first_makes_room(served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with impatient(served, tmp_path, monkeypatch, head_s=60.0, most=5) as where, ExitStack() as stack:
        held = [stack.enter_context(socket.create_connection(where)) for _ in range(8)]
        for one in held:
            one.settimeout(0.05)
        wait_for(lambda: all(_is_closed(one) for one in held[:3]))
        assert not any(_is_closed(one) for one in held[4:])
        assert httpx.get(f"http://{where[0]}:{where[1]}/healthz").status_code == 200


def _is_closed(one: socket.socket) -> bool:
    try:
        return one.recv(1) == b""
    except TimeoutError:
        return False
    except OSError:
        return True
