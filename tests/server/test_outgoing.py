"""The picture to other systems: what arrives is what is in the picture, however fast pictures come and whoever listens."""

from __future__ import annotations

import socket
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import reduce
from operator import xor
from typing import Any

import numpy as np
import pytest
from server_world import Served, wait_for

from coastwatch.errors import AddressError
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.targets import TargetSentences
from coastwatch.operators.api import logs
from coastwatch.server.feeds.outgoing import OutFeed, parsed_out
from coastwatch.server.troubles import SILENT_S

pytestmark = pytest.mark.whole

SITE = "-22.9,-43.2"


@contextmanager
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(5.0)
        yield made


def datagrams(served: Served, address: str) -> list[bytes]:
    """What a feed sends of one picture over UDP."""
    picture = served.service.picture()
    with listener() as made:
        out = parsed_out(address.replace("PORT", str(made.getsockname()[1])))
        with OutFeed(out) as feed:
            feed.receive(picture)
            return [made.recv(65_536) for _ in range(len(picture))]


def test_cursor_on_target_has_each_vessel_once_and_is_stale_after_three_cycles(served: Served) -> None:
    picture = served.service.picture()
    events = [ElementTree.fromstring(data) for data in datagrams(served, "cot+udp://127.0.0.1:PORT")]
    ids = [int((event.get("uid") or "").rpartition("-")[2]) for event in events]
    assert ids == picture.array("vessel_id").tolist()
    points = [event.find("point") for event in events]
    found = np.array([[float(point.get(name) or "") for name in ("lat", "lon")] for point in points if point is not None])
    assert np.allclose(found, picture.positions_deg(), atol=1e-6)
    stale, start = (datetime.fromisoformat(events[0].get(name) or "") for name in ("stale", "start"))
    assert (stale - start).total_seconds() == 30.0  # ten seconds until the period is known
    names = {str(contact.get("callsign")) for event in events if (contact := event.find("detail/contact")) is not None}
    assert any(name.startswith("SHIP") for name in names)


@pytest.mark.parametrize("address", [f"ttm+udp://127.0.0.1:PORT?site={SITE}", "tll+udp://127.0.0.1:PORT"])
def test_targets_are_read_back_where_they_are(served: Served, address: str) -> None:
    picture, tally = served.service.picture(), Tally()
    reader = TargetSentences(np.array([-22.9, -43.2]), 0.0, picture.time_s, tally)
    sentences = [data.strip() for data in datagrams(served, address)]
    assert all(int(line[-2:], 16) == reduce(xor, line[1:-3]) for line in sentences)
    states = [reader.state(line, picture.time_s, "here") for line in sentences]
    table = np.array([state for state in states if state is not None])
    assert tally.faults() == ()
    assert len(np.unique(table[:, 0])) == len(picture)
    miles = np.hypot(*(table[:, 3:5] - picture.positions_deg()).T) * 60.0
    assert miles.max() < (0.02 if address.startswith("ttm") else 1e-4)


def test_a_slow_feed_keeps_only_the_newest_picture_and_gives_each_vessel_its_turn(served: Served) -> None:
    picture = served.service.picture()
    with listener() as made, OutFeed(parsed_out(f"cot+udp://127.0.0.1:{made.getsockname()[1]}?rate=20")) as feed:
        seen: list[str] = []
        while len(set(seen)) < len(picture):
            feed.receive(picture)
            seen += [str(ElementTree.fromstring(made.recv(65_536)).get("uid")) for _ in range(4)]
        assert len(seen) < 2 * len(picture)
        wait_for(lambda: feed.counters()["dropped"] > 0)


def test_a_listener_that_comes_later_and_goes_is_found_again(served: Served) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with OutFeed(parsed_out(f"cot+tcp://127.0.0.1:{port}")) as feed:
        wait_for(lambda: feed.error and "refused" in feed.error)
        for number in (1, 2):
            with socket.create_server(("127.0.0.1", port)) as server:
                taken, _ = server.accept()
                with taken:
                    feed.receive(served.service.picture())
                    assert taken.recv(7) == b"<event "
                wait_for(lambda number=number: feed.connections == number)
            if number == 1:
                wait_for(lambda: (feed.receive(served.service.picture()), not feed.connected)[1])


def test_a_feed_without_listener_is_said_logged_once_and_counts_what_it_loses(
    changing: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "coastwatch.serve")
    service, watch = changing.service, logs.Watch(changing.service)
    picture = service.picture()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with OutFeed(parsed_out(f"cot+tcp://127.0.0.1:{port}")) as feed:
        service.outs = (feed,)
        name = feed.counters()["name"]
        assert feed.counters()["state"] == "not connected"
        wait_for(lambda: feed.error and "refused" in feed.error)
        for _ in range(3):
            feed.receive(picture)
            watch.look()
        assert feed.counters()["dropped"] == 2 * len(picture)  # the newest still waits
        feed.began_s -= SILENT_S + 1.0
        (said,) = (row for row in changing.get("/readyz").json()["troubles"] if row["name"] == name)
        assert (said["kind"], said["serious"]) == ("feed", False)
        assert said["text"].endswith("refused")
        with socket.create_server(("127.0.0.1", port)) as server:
            taken, _ = server.accept()
            with taken:
                assert taken.recv(7) == b"<event "
                watch.look()
                assert not [trouble for trouble in service.troubles() if trouble.name == name]
            wait_for(lambda: (feed.receive(picture), not feed.connected)[1])
        watch.look()
        watch.look()
        assert feed.counters()["dropped"] > 2 * len(picture)
    words = [record.message for record in caplog.records if getattr(record, "fields", {}).get("feed") == name]
    assert words[:3] == ["Connection refused", "feed connected", "feed lost"]
    assert words.count("feed connected") == words.count("feed lost") == 1


@pytest.mark.parametrize(
    "text",
    [
        "cot",
        "cot+udp://x",
        "ais+udp://x:1",
        "cot+file:///x",
        "ttm+udp://x:1",
        "ttm+udp://x:1?site=91,0",
        "ttm+udp://x:1?site=50.7",
        "ttm+udp://x:1?site=north,0",
        "cot+udp://x:1?site=north,0",
        "cot+udp://x:1?rate=0",
        "cot+udp://x:1?a=b",
        "cot+udp://x:1#y",
    ],
)
def test_an_address_to_which_nothing_can_be_sent_is_refused(text: str) -> None:
    with pytest.raises(AddressError, match="needed"):
        parsed_out(text)


def test_the_server_counts_what_it_sends(changing: Any) -> None:
    service = changing.service
    with listener() as made, OutFeed(parsed_out(f"cot+udp://127.0.0.1:{made.getsockname()[1]}")) as feed:
        service.outs = (feed,)
        service.receive(service.picture())
        wait_for(lambda: changing.get("/api/v1/feeds").json()["feeds"][-1]["records"] == len(service.picture()))
        assert changing.get("/api/v1/feeds").json()["feeds"][-1]["state"] == "sending"  # nobody says that it arrives
        assert f'feed="out {feed.address.text}"'.encode() in changing.get("/metrics").content
