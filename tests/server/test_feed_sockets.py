"""Addresses and sockets of live feeds: refused, bounded, noticed when the other side is gone."""

from __future__ import annotations

import asyncio
import socket
import sys
import uuid
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import pytest
from feed_world import (
    SENSORS,
    deliver,
    items,
    put,
    put_datagrams,
    receiving,
)
from relay_world import relayed
from server_world import wait_for

from coastwatch.errors import AddressError
from coastwatch.operators.cli.serving import bound
from coastwatch.server.deployment import NamedFeed
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.sending import _Datagrams
from coastwatch.server.feeds.transport import LONGEST_LINE, Inbox, Receiver, _read_stream, _subscribed
from coastwatch.server.link import Backoff, notice_loss

pytestmark = pytest.mark.whole


@pytest.mark.parametrize(("failures", "wait_s"), [(1, 0.5), (2, 1.0), (5, 8.0), (6, 15.0), (5000, 15.0)])
def test_each_wait_is_twice_the_one_before_up_to_the_longest(failures: int, wait_s: float) -> None:
    assert Backoff(0.5, 15.0).wait_s(failures) == wait_s


@pytest.mark.parametrize(
    "text",
    [
        "ais",
        "moon+tcp://x:1",
        "ais+moon://x:1",
        "ais+tcp://x",
        "ais+tcp://:10",
        "asterix+tcp://x:1",
        "ais+file://",
        "ais+tcp://x:99999",
        "ais+mqtt://x",
        "asterix+mqtt://x/topic",
        "ais+mqtt://x/a/#/b",
        "ais+mqtt://x/a/b#",
        "ais+mqtt://x/a+/b",
        "ais+mqtt://x/a%00",
        "ais+tcp://x:1#y",
        "ais+udp://:1/y",
        "asterix+udp://239.192.0.1:8600?interface=north",
        "asterix+udp://127.0.0.1:8600?interface=127.0.0.1",
    ],
)
def test_an_address_of_no_feed_is_refused(text: str) -> None:
    with pytest.raises(AddressError, match="needed"):
        parsed(text)


@pytest.mark.parametrize(
    ("path", "topic"),
    [
        ("coast/#", "coast/#"),
        ("#", "#"),
        ("/coast/#", "/coast/#"),
        ("+/ais/", "+/ais"),
        ("a%23", ""),
        ("coast%2F%23?user=me", "coast/#"),
    ],
)
def test_a_topic_has_the_wildcards_of_its_address(path: str, topic: str) -> None:
    if topic:
        assert parsed(f"ais+mqtt://x/{path}").path == topic
        assert parsed(NamedFeed(name="n", url=f"ais+mqtt://x/{path}").address(Path())).path == topic
    else:
        with pytest.raises(AddressError, match="'#' alone at the end"):
            parsed(f"ais+mqtt://x/{path}")
    assert parsed("ais+file:///logs/a#1.nmea").path == "/logs/a#1.nmea"


@pytest.mark.parametrize("end", [b"", b"\n"])
@pytest.mark.parametrize(("length", "is_kept"), [(LONGEST_LINE, True), (LONGEST_LINE + 1, False), (3 * LONGEST_LINE, False)])
def test_a_last_line_that_is_too_long_is_dropped_and_counted_with_and_without_its_end(
    end: bytes, length: int, is_kept: bool
) -> None:
    async def read(inbox: Inbox) -> None:
        reader = asyncio.StreamReader()
        reader.feed_data(b"#\n" + b"x" * length + end)
        reader.feed_eof()
        await _read_stream(inbox, reader, 0)

    inbox = Inbox(parsed("ais+tcp://x:1"))
    asyncio.run(read(inbox))
    assert [len(line) for _, line, _ in inbox.pop_first(9)] == [1, *[length] * is_kept]
    assert inbox.dropped == (not is_kept)


def test_the_password_of_a_broker_is_the_first_line_without_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passwords: list[str | None] = []

    def client(*unused: object, password: str | None, **more: object) -> NoReturn:
        passwords.append(password)
        raise OSError("no broker")

    monkeypatch.setitem(
        sys.modules, "aiomqtt", SimpleNamespace(Client=client, Message=str, MqttError=OSError, TLSParameters=None)
    )
    file = tmp_path / "password"
    for content in (b"s3cret", b"s3cret\nmore\n", b"s3cret\r\nmore\r\n"):
        file.write_bytes(content)
        with pytest.raises(OSError, match="no broker"):
            asyncio.run(_subscribed(Inbox(parsed(f"ais+mqtt://x/ais?user=me&password-file={file}"))))
    assert passwords == 3 * ["s3cret"]


@pytest.fixture
def topic() -> str:
    """A topic of a broker on this machine."""
    if find_spec("aiomqtt") is None:
        pytest.skip("needs the package aiomqtt")
    try:
        socket.create_connection(("127.0.0.1", 1883), timeout=1.0).close()
    except OSError as error:
        pytest.skip(f"needs an MQTT broker at 127.0.0.1:1883: {error}")
    return f"test/{uuid.uuid4().hex[:12]}"


def publish(topic: str, messages: list[bytes]) -> None:
    async def send() -> None:
        from aiomqtt import Client

        async with Client("127.0.0.1", 1883) as client:
            for message in messages:
                await client.publish(topic, message, qos=1)

    asyncio.run(send())


def test_of_messages_of_a_broker_that_have_no_room_the_oldest_are_dropped_and_counted(
    topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.MOST_ITEMS", 20)
    with Receiver([parsed(f"ais+mqtt://127.0.0.1:1883/{topic}")]) as receiver:
        (inbox,) = receiver.inboxes
        wait_for(lambda: inbox.connected)
        publish(topic, [b"%d a\r\n%d b" % (number, number) for number in range(60)])
        wait_for(lambda: inbox.received == 120, 10.0)
        kept = [line for _, line, _ in inbox.pop_first(1000)]
        assert len(kept) <= 22
        assert (kept[-1].rstrip(), inbox.dropped) == (b"59 b", 120 - len(kept))


def test_a_broker_that_is_silent_is_noticed(topic: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.LOST_S", 2)
    with relayed(1883) as relay, Receiver([parsed(f"ais+mqtt://127.0.0.1:{relay.port}/{topic}")]) as receiver:
        (inbox,) = receiver.inboxes
        wait_for(lambda: inbox.connected)
        relay.lose()
        wait_for(lambda: inbox.connections == 2 and inbox.connected, 10.0)
        publish(topic, [b"again"])
        wait_for(lambda: inbox.received == 1, 10.0)


def test_a_taken_port_and_an_unknown_radar_are_refused() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as held,
        pytest.raises(OSError, match=r"feed ais\+listen://127\.0\.0\.1:\d+: Address already in use: is another program"),
        receiving(f"ais+listen://127.0.0.1:{held.getsockname()[1]}"),
    ):
        pass
    with pytest.raises(AddressError, match="needed SAC/SIC=NAME"), receiving("asterix+udp://127.0.0.1:0?25/1=moon"):
        pass


def test_a_feed_that_listens_takes_so_many_senders_and_room_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.MOST_SENDERS", 2)
    with receiving("ais+listen://127.0.0.1:0") as made:
        held = []
        for number in range(2):
            held.append(socket.create_connection(("127.0.0.1", made.ports[0])))
            wait_for(lambda number=number: made.feeds()[0]["connections"] == number + 1)
        held[0].sendall(b"#\r\n")  # the second one is silent longest
        deliver(made, 1)
        held.append(socket.create_connection(("127.0.0.1", made.ports[0])))
        held[1].settimeout(10.0)
        assert held[1].recv(1) == b""
        assert "silent longest" in str(made.feeds()[0]["error"])
        held[2].sendall(b"#\r\n")
        held[0].sendall(b"#\r\n")
        deliver(made, 3)
        for one in held:
            one.close()
        wait_for(lambda: not made.feeds()[0]["connected"])
        put(made.ports[0], items("ais+tcp://x:1"))
        deliver(made, 4)


def test_a_name_that_no_machine_can_have_is_refused_and_stops_no_start() -> None:
    with pytest.raises(OSError, match="no name of a machine"), receiving("ais+listen://north..example:1"):
        pass
    with receiving("ais+tcp://north..example:1") as made:
        wait_for(lambda: "no name of a machine" in str(made.feeds()[0]["error"]))


def test_an_inbox_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.MOST_BYTES", 1 << 20)
    inbox = Inbox(parsed("ais+udp://:1"))
    inbox.put([b"x" * 60_000] * 17, 17 * 60_000, 0)
    assert not inbox.is_full
    inbox.put([b"x" * 60_000], 60_000, 0)
    assert inbox.is_full
    assert len(inbox.pop_first(100)) == 18
    assert not inbox.is_full


def test_each_datagram_that_is_taken_makes_room_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.MOST_BYTES", 12)
    inbox, full = Inbox(parsed("ais+udp://:1")), []

    class Line(bytes):
        def __len__(self) -> int:
            full.append(inbox.is_full)  # as the thread that receives may ask while others are taken
            return super().__len__()

    inbox.put([Line(b"1234")] * 3, 12, 0)
    full.clear()
    inbox.pop_first(3)
    assert full == [True, False, False]


def test_of_datagrams_without_room_the_oldest_go_and_are_counted_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.MOST_BYTES", 10_000)
    with receiving("asterix+udp://127.0.0.1:0") as made:
        put_datagrams(made.ports[0], [bytes([number]) * 1000 for number in range(12)])
        deliver(made, 12)
        inbox = made._receiver.inboxes[0]
        made._feeds[0].look()
        assert [data[0] for _, data, _ in inbox.pop_first(100)] == list(range(2, 12))
        assert made.feeds()[0]["dropped"] == 2
        put_datagrams(made.ports[0], [bytes(1000)] * 11)
        deliver(made, 23)
        made._feeds[0].look()
        assert "1 lines, datagrams or reports were dropped in the last minute" in made.feeds()[0]["troubles"][0]


def test_a_feed_joins_a_multicast_group_and_is_sent_to_it() -> None:
    group = "asterix+udp://239.192.7.31:{}?interface=127.0.0.1&25/1=" + str(SENSORS.radars.name[0])
    with receiving(group.format(0)) as made, ExitStack() as stack:
        _Datagrams(parsed(group.format(made.ports[0])), stack).send([b"x" * 20] * 3)
        deliver(made, 3)
        assert made.feeds()[0]["bytes"] == 60


def test_a_receive_buffer_that_is_smaller_than_asked_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("coastwatch.server.feeds.transport.DATAGRAM_BUFFER", 1 << 30)
    with receiving("asterix+udp://127.0.0.1:0") as made:
        assert 0 < made._receiver.inboxes[0].buffer < 1 << 30
    assert "wanted 1048576: datagrams are lost while this machine is busy" in caplog.text


def test_a_sender_whose_machine_is_gone_is_noticed() -> None:
    with socket.socket() as found:
        notice_loss(found)
        assert found.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        assert found.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) <= 30


def test_a_viewer_whose_network_is_lost_is_noticed_by_the_socket_that_the_server_accepts() -> None:
    with bound("127.0.0.1", 0) as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) <= 30
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 30_000  # ms, on Linux
