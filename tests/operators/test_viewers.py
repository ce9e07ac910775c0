"""Viewers of the stream that do not behave: one that reads nothing costs little and is closed, and the others go on."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from pathlib import Path

import pytest
from page import Page
from server_world import listening, wait_for
from websockets.sync.client import connect

from coastwatch.operators.api import streaming
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.wire import RING
from coastwatch.store import open_store
from scaling.page.fleet import Fleet, Simulated

pytestmark = pytest.mark.whole

PERIOD_S = 3.0
MOST_MB = 10.0  # of memory for a viewer that reads nothing
CLOSED = "coastwatch_viewers_slow_closed_total"
UNREAD = 4
CLOSED_S = 1.0  # instead of 30: nobody waits for a test


def resident_mb() -> float:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def unread(address: str) -> socket.socket:
    """A viewer that asks for the stream and then reads nothing."""
    host, _, port = address.partition(":")
    made = socket.create_connection((host, int(port)))
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.sendall(
        f"GET /api/v1/stream HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    return made


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize("vessels", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_viewers_that_read_nothing_are_closed_and_counted_and_cost_the_others_nothing(
    vessels: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert streaming.NOT_READ_S == 30.0
    monkeypatch.setattr(streaming, "NOT_READ_S", CLOSED_S)
    fleet, page = Fleet.of(vessels, 1), Page()
    with open_store(str(tmp_path / "sea.db")) as opened, ExitStack() as stack:
        service = Service(opened)
        service.source = Simulated()
        address = stack.enter_context(listening(service, web=tmp_path))
        service.receive(fleet.picture(1, 0, 0.0))
        reader = stack.enter_context(connect(f"ws://{address}/api/v1/stream", max_size=2**26))

        def publish() -> None:
            """Every vessel is elsewhere, so a delta is as large as a full frame. The viewer that reads takes it."""
            fleet.latitude_deg = fleet.latitude_deg + 0.01
            service.receive(fleet.picture(1, page.seq, page.seq * PERIOD_S))
            before = page.seq
            while page.seq <= before:
                page.take(reader.recv(timeout=20))

        for _ in range(RING + 2):  # until as many frames are kept as ever
            publish()
        before_mb = most_mb = resident_mb()
        for _ in range(UNREAD):
            stack.enter_context(unread(address))
        wait_for(lambda: len(service.hub.viewers) == 1 + UNREAD)
        while f"{CLOSED} {UNREAD:.1f}" not in service.metrics.text().decode():
            publish()
            most_mb = max(most_mb, resident_mb())
        wait_for(lambda: len(service.hub.viewers) == 1)
        publish()
        assert (most_mb - before_mb) / UNREAD < MOST_MB
        assert page.refused == 0
