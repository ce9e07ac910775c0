"""Radar video to viewers over sockets: what is decoded is what the server has; resumed; refused; as a picture."""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import httpx2 as httpx
import numpy as np
import pytest
from PIL import Image
from server_world import Served, code_of, listening, wait_for
from websockets.sync.client import ClientConnection, connect

from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.people import Tokens, add
from coastwatch.operators.api.service import Service
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.live_video import LiveVideo
from coastwatch.store import open_store
from scaling.page.fleet import Simulated

pytestmark = pytest.mark.whole

PROTOCOL = "coastwatch.video.v1"
HEADER = struct.Struct("<4sBBHIIIBBHH6xdddf4x")  # written from INTERFACE.md
TURN_S = 2.4
SMALL = {"radars.0.range_nm": "3.0", "input.cells": "256", "input.spokes": "512"}


class Got(NamedTuple):
    number: int
    begun: int
    place: int
    levels: np.ndarray


def sector(message: bytes, run: int) -> Got:
    magic, version, kind, radar, of_run, number, begun, place, sectors, rows, ranges, *rest = HEADER.unpack_from(message)
    assert (magic, version, kind, radar, of_run, sectors, rows, ranges) == (b"CWV1", 1, 1, 0, run, 16, 64, 512)
    assert rest[1:3] == pytest.approx((54.3, 12.0))
    assert rest[3] == pytest.approx(3.0 * 1852.0)
    octets = np.frombuffer(zlib.decompress(message[HEADER.size :]), np.uint8).reshape(rows, ranges // 2)
    return Got(number, begun, place, np.stack([octets >> 4, octets & 15], axis=-1).reshape(rows, ranges))


class World:
    """A small scene of radar video that goes on by hand."""

    def __init__(self, scenario: Scenario) -> None:
        self.sensors, plan = scenario.sensors(), scenario.plan()
        self._stream, self._at_s = scenario.input.load(self.sensors, 1, plan).reports, plan.start_s
        self.video = LiveVideo(self.sensors.radars)

    def turn(self) -> None:
        """One turn more."""
        self.video.take_all(self._stream.between(self._at_s, self._at_s + TURN_S).video)
        self._at_s += TURN_S


@pytest.fixture
def world() -> World:
    return World(load_scenario("heymann-table-1", SMALL))


@pytest.fixture
def address(world: World, tmp_path: Path) -> Iterator[str]:
    with open_store(str(tmp_path / "sea.db")) as opened:
        service = Service(opened)
        service.source, service.video = Simulated(), world.video
        with listening(service, web=tmp_path) as where:
            yield where


def viewer(address: str, query: str = "") -> ClientConnection:
    return connect(f"ws://{address}/api/v1/video/stream{query}", subprotocols=[PROTOCOL])


def asked(socket: ClientConnection, world: World) -> int:
    """Ask for the radar of the scene. Returns: the run."""
    hello = json.loads(socket.recv(timeout=10))
    assert hello["radars"] == ["radar"]
    socket.send(json.dumps({"radars": ["radar"]}))
    wait_for(lambda: 0 in world.video._asked_s)
    return int(hello["run"])


def test_sectors_decode_to_the_levels_of_the_server_and_a_viewer_resumes(world: World, address: str) -> None:
    with viewer(address) as socket:
        assert socket.subprotocol == PROTOCOL
        run = asked(socket, world)
        world.turn()
        world.turn()
        got = [sector(socket.recv(timeout=10), run)]
        while got[-1].number < world.video.since({0: 0})[-1].number:
            got.append(sector(socket.recv(timeout=10), run))
        newest = {one.place: one for one in got}
        turn = world.video.turn(0)
        assert turn is not None
        for one in turn:
            assert (newest[one.place].levels == one.levels()).all()
        assert len({one.begun for one in got}) == 1
        assert 0.01 < np.mean([one.levels() > 0 for one in turn]) < 0.5
    world.turn()
    with viewer(address, f"?run={run}&seq={got[-1].number}") as socket:
        asked(socket, world)
        assert sector(socket.recv(timeout=10), run).number == got[-1].number + 1
    with viewer(address, f"?run={run + 1}&seq={got[-1].number}") as socket:  # of another process: the newest turn
        asked(socket, world)
        assert sector(socket.recv(timeout=10), run).number == world.video.since({0: 0})[0].number


def test_a_turn_as_a_picture_is_that_of_the_sectors(world: World, address: str) -> None:
    world.video.ask([0])
    world.turn()
    world.turn()
    answer = httpx.get(f"http://{address}/api/v1/video/radar.png")
    assert (answer.status_code, answer.headers["content-type"], answer.headers["x-range-m"]) == (200, "image/png", "5556.0")
    turn = world.video.turn(0)
    assert turn is not None
    assert (np.asarray(Image.open(io.BytesIO(answer.content))) == 17 * np.concatenate([one.levels() for one in turn])).all()
    unknown = httpx.get(f"http://{address}/api/v1/video/x.png")
    assert (unknown.status_code, unknown.json()["detail"]) == (404, "radar: got 'x', needed one of radar")


@pytest.mark.parametrize("text", ["{", '{"radars": ["x"]}', '{"radars": 1}'])
def test_a_wrong_message_closes_the_socket(world: World, address: str, text: str) -> None:
    with viewer(address) as socket:
        socket.send(text)
        assert code_of(socket) == 4400


def test_a_database_that_is_followed_has_no_video(served: Served) -> None:
    with viewer(served.address) as socket:
        assert code_of(socket) == 4404
    assert served.get("/api/v1/video/radar.png").status_code == 404


def test_a_token_is_needed(world: World, tmp_path: Path) -> None:
    given = add(tmp_path / "tokens.toml", "watch", "viewer", None)
    with open_store(str(tmp_path / "sea.db")) as opened:
        service = Service(opened)
        service.source, service.video = Simulated(), world.video
        with listening(service, Guard(tokens=Tokens(tmp_path / "tokens.toml")), tmp_path) as where:
            assert httpx.get(f"http://{where}/api/v1/video/radar.png").status_code == 401
            with viewer(where) as socket:
                assert (socket.subprotocol, code_of(socket)) == (PROTOCOL, 4401)
            with connect(f"ws://{where}/api/v1/video/stream", subprotocols=[PROTOCOL, f"bearer.{given}"]) as socket:
                asked(socket, world)
