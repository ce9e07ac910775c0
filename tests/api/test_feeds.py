"""Live feeds over real sockets: what came is what was sent, whatever the order, the transport and the noise on the line."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from server_world import wait_for

from coastwatch.batches import AisReports, AisStatics, BearingReports, RadarReports, Reports
from coastwatch.scenario import load_scenario
from coastwatch.server.feeds.address import AddressError, parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import encoded, send

START_S, SPAN_S = 1_750_000_000.0, 30.0
SCENARIO = load_scenario("guanabara")
SENSORS = SCENARIO.sensors()
NAMES = {"plot": SENSORS.radars.name, "bearing": SENSORS.sonars.name}


def sea(vessels: int = 40, seed: int = 1) -> Reports:
    """Half a minute of positions, names, plots and bearings."""
    g = np.random.default_rng(seed)
    n = 3 * vessels
    when = np.sort(START_S + 1.0 + np.round(g.uniform(0, SPAN_S - 1.0, n), 3))
    vessel = g.integers(0, vessels, n)
    none = np.full(n, -1, np.int64)
    place = np.round(np.stack([g.uniform(-23, -22.9, n), g.uniform(-43.2, -43, n)], 1), 5)
    class_b, speed, course = vessel % 3 == 0, np.round(g.uniform(0, 20, n), 1), np.round(g.uniform(0, 359, n), 1)
    ais = AisReports(
        np.floor(when), when, 257_000_000 + vessel, place, speed, course, class_b, none, np.where(class_b, -1, 0),
        np.zeros(n, np.int64), feed=np.zeros(n, np.int64),
    )  # fmt: skip
    name = AisStatics(
        when[:5], ais.mmsi[:5], np.array(["ANA", "BIA", "CAI", "DUO", "EVA"]), np.full(5, "LA1B"), np.full(5, 70),
        np.full(5, 90.0), np.full(5, 14.0),
    )  # fmt: skip
    radar = RadarReports(
        sensor=g.integers(0, len(SENSORS.radars), n), time_s=when, received_s=when, range_m=g.uniform(1e3, 2e4, n),
        azimuth_deg=g.uniform(0, 360, n), site_deg=SENSORS.radars.site_deg[np.zeros(n, np.int64)], origin=none,
    )  # fmt: skip
    bearing = BearingReports(
        sensor=np.zeros(9, np.int64), time_s=when[:9], received_s=when[:9], bearing_deg=g.uniform(0, 360, 9), contact=np.arange(9),
        site_deg=SENSORS.sonars.site_deg[np.zeros(9, np.int64)], signature=none[:9], origin=none[:9],
    )  # fmt: skip
    return Reports(radar, ais, name, bearing)


SEA = sea()


def items(address: str) -> list[bytes]:
    return encoded(SEA, parsed(address), NAMES)


@contextmanager
def receiving(*addresses: str, **given: Any) -> Iterator[LiveInput]:
    with LiveInput([parsed(text) for text in addresses], SENSORS, clock="feeds", **given) as made:
        yield made


def deliver(made: LiveInput, received: int, feed: int = 0) -> None:
    """Wait until a feed has received so many lines or datagrams."""
    wait_for(lambda: made.feeds()[feed]["received"] >= received)


def cycles(made: LiveInput, period_s: float = 5.0) -> list[Reports]:
    edges = np.arange(START_S, START_S + SPAN_S + 2 * period_s, period_s)
    return [made.between(a, b) for a, b in pairwise(edges.tolist())]


def same(one: Any, other: Any) -> bool:
    return all(
        np.array_equal(getattr(one, f), getattr(other, f), equal_nan=getattr(one, f).dtype.kind == "f")
        for f in one.__dataclass_fields__
    )


def joined(parts: list[Reports], kind: str) -> Any:
    batches = [getattr(part, kind) for part in parts]
    return type(batches[0]).join(batches)


def put(port: int, lines: list[bytes]) -> None:
    with socket.create_connection(("127.0.0.1", port)) as out:
        out.sendall(b"\r\n".join([*lines, b""]))


def put_datagrams(port: int, found: list[bytes]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for datagram in found:
            out.sendto(datagram, ("127.0.0.1", port))


def by_tcp(lines: list[bytes]) -> list[Reports]:
    with receiving("ais+listen://127.0.0.1:0") as made:
        put(made.ports[0], lines)
        deliver(made, len(lines))
        return cycles(made)


def test_ais_over_tcp_is_what_was_sent() -> None:
    found = joined(by_tcp(items("ais+tcp://x:1")), "ais")
    order = np.lexsort((found.mmsi, found.received_s))
    want = SEA.ais.take(np.lexsort((SEA.ais.mmsi, SEA.ais.received_s)))
    found = found.take(order)
    for name in ("received_s", "time_s", "mmsi", "position_deg", "sog_kn", "cog_deg", "class_b", "nav_status"):
        assert np.allclose(getattr(found, name), getattr(want, name), atol=2e-6), name


def test_shuffled_and_repeated_input_gives_the_same_cycles_to_the_bit() -> None:
    lines = items("ais+tcp://x:1")
    mixed = lines + lines[::2]
    random.Random(1).shuffle(mixed)
    for one, other in zip(by_tcp(lines), by_tcp(mixed), strict=True):
        assert same(one.ais, other.ais)
        assert same(one.statics, other.statics)


def test_several_receivers_of_one_coast_are_one() -> None:
    lines = items("ais+tcp://x:1")
    with receiving("ais+listen://127.0.0.1:0?name=a", "ais+listen://127.0.0.1:0?name=b") as made:
        put(made.ports[1], lines[::-1][:60])
        put(made.ports[0], lines)
        deliver(made, len(lines))
        deliver(made, 60, 1)
        both = cycles(made)
        assert [feed["name"] for feed in made.feeds()] == ["a", "b"]
        assert made.feeds()[1]["faults"]["set aside: duplicate"] > 40
    alone = by_tcp(lines)
    for name in ("received_s", "time_s", "mmsi", "position_deg", "sog_kn"):
        assert np.array_equal(getattr(joined(both, "ais"), name), getattr(joined(alone, "ais"), name), equal_nan=True), name


def test_every_transport_delivers_the_same(tmp_path: Path) -> None:
    lines, path = items("ais+tcp://x:1"), tmp_path / "ais.nmea"
    path.write_bytes(b"")
    with socket.create_server(("127.0.0.1", 0)) as server:
        addresses = f"ais+tcp://127.0.0.1:{server.getsockname()[1]}", "ais+udp://127.0.0.1:0", f"ais+file://{path}"
        for number, address in enumerate(addresses):
            with receiving(address) as made:
                if number == 0:
                    for part in (lines[:70], lines[70:]):  # the sender goes away in between, and the feed connects again
                        out, _ = server.accept()
                        out.sendall(b"\r\n".join([*part, b""]))
                        out.close()
                elif number == 1:
                    put_datagrams(made.ports[0], [b"\r\n".join(lines[k : k + 5]) for k in range(0, len(lines), 5)])
                else:
                    wait_for(lambda made=made: made.feeds()[0]["connected"])
                    with path.open("ab") as out_file:
                        out_file.write(b"\r\n".join([*lines, b""]))
                deliver(made, len(lines))
                found = cycles(made)
                if number == 0:
                    assert made.feeds()[0]["connections"] == 2
            assert same(joined(found, "ais"), joined(by_tcp(lines), "ais")), address


def test_asterix_gives_plots_to_the_resolution_of_the_format_and_damaged_datagrams_stop_nothing() -> None:
    g = random.Random(3)
    good = items("asterix+udp://x:1")
    bad = [bytes(g.randrange(256) for _ in range(g.randrange(1, 80))) for _ in range(100)] + [d[: len(d) // 2] for d in good]
    mixed = good + bad
    g.shuffle(mixed)
    with receiving("asterix+udp://127.0.0.1:0", "ais+listen://127.0.0.1:0") as made:
        put(made.ports[1], items("ais+tcp://x:1")[:1])  # the date
        deliver(made, 1, 1)
        made.between(START_S - 10, START_S - 5)
        put_datagrams(made.ports[0], mixed)
        deliver(made, len(mixed))
        found = joined(cycles(made), "radar")
        assert made.feeds()[0]["refused"] >= 100
    want = SEA.radar
    at = [
        int(np.argmin(np.abs(found.time_s - t) + np.abs(found.range_m - r)))
        for t, r in zip(want.time_s, want.range_m, strict=True)
    ]
    found = found.take(np.array(at))
    assert (found.sensor == want.sensor).all()
    assert np.abs(found.time_s - want.time_s).max() <= 1 / 256 + 1e-6
    assert np.abs(found.range_m - want.range_m).max() <= 1852 / 512 + 1e-6
    assert np.abs((found.azimuth_deg - want.azimuth_deg + 180) % 360 - 180).max() <= 360 / 131072 + 1e-9


def test_json_lines_give_plots_bearings_and_tracks_exactly_and_say_what_is_wrong() -> None:
    lines = items("json+tcp://x:1")
    bad = [
        b"{",
        b"[]",
        b'{"type":"plot","radar":"moon","range_m":1,"azimuth_deg":1}',
        b'{"type":"plot","radar":"x","range_m":-1}',
        b"x" * 70_000,
    ]
    with receiving("json+listen://127.0.0.1:0") as made:
        put(made.ports[0], bad + lines)
        deliver(made, len(lines) + 4)
        found = cycles(made)
        feed = made.feeds()[0]
        assert (feed["refused"], feed["dropped"], feed["records"]) == (4, 1, len(lines))
    assert np.array_equal(np.sort(joined(found, "radar").range_m), np.sort(SEA.radar.range_m))
    assert np.array_equal(np.sort(joined(found, "bearing").bearing_deg), np.sort(SEA.bearing.bearing_deg))


def test_what_comes_after_its_cycle_is_counted_and_left_out() -> None:
    lines = items("json+tcp://x:1")
    with receiving("json+listen://127.0.0.1:0") as made:
        assert len(made.between(START_S - 5, START_S + 10)) == 0
        put(made.ports[0], lines)
        deliver(made, len(lines))
        later = made.between(START_S + 10, START_S + SPAN_S + 5)
        late = int((SEA.radar.time_s <= START_S + 10).sum() + (SEA.bearing.time_s <= START_S + 10).sum())
        assert late > 5
        assert (made.feeds()[0]["late"], len(later)) == (late, len(lines) - late)
        assert [fault.count for fault in made.faults() if "later" in fault.kind] == [late]


def test_a_cycle_waits_until_every_feed_that_sends_has_passed_its_end() -> None:
    stop = threading.Event()
    with receiving("json+listen://127.0.0.1:0?name=a", "json+listen://127.0.0.1:0?name=b", lateness_s=2.0) as made:
        line = b'{"type":"bearing","sonar":"%s","time":%f,"bearing_deg":1.0}'
        sonar = str(SENSORS.sonars.name[0]).encode()
        put(made.ports[0], [line % (sonar, START_S + 20)])
        waiting = threading.Thread(target=made.wait, args=(START_S + 10, stop))
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive()
        put(made.ports[1], [line % (sonar, START_S + 12.5)])
        waiting.join(4.0)
        assert not waiting.is_alive()


def test_the_generator_reaches_a_server_that_starts_later_and_counts_what_it_sent() -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
    address = parsed(f"json+tcp://127.0.0.1:{port}")
    sent: dict[str, int] = {}
    batches = iter([(START_S, lambda a: encoded(SEA, a, NAMES)), (START_S + 6.0, lambda a: [b"{}"])])
    sender = threading.Thread(target=lambda: sent.update(send(batches, [address], 60.0, threading.Event())))
    sender.start()
    with receiving(f"json+listen://127.0.0.1:{port}") as made:
        deliver(made, len(SEA.radar) + len(SEA.bearing) + 1)
        sender.join()
    assert sent == {address.text: len(SEA.radar) + len(SEA.bearing) + 1}


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
    ],
)
def test_an_address_of_no_feed_is_refused(text: str) -> None:
    with pytest.raises(AddressError, match="needed"):
        parsed(text)


def test_a_taken_port_and_an_unknown_radar_are_refused() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as held,
        pytest.raises(OSError, match="in use"),
        receiving(f"ais+listen://127.0.0.1:{held.getsockname()[1]}"),
    ):
        pass
    with pytest.raises(AddressError, match="needed SAC/SIC=RADAR"), receiving("asterix+udp://127.0.0.1:0?25/1=moon"):
        pass
