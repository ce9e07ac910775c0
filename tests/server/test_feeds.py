"""Live feeds over real sockets: what came is what was sent, whatever the order, the transport and the noise on the line."""

from __future__ import annotations

import asyncio
import random
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from asterix import generated
from feed_world import (
    SCENARIO,
    SEA,
    SENSORS,
    SPAN_S,
    START_S,
    cycles,
    deliver,
    items,
    joined,
    put,
    put_datagrams,
    receiving,
    same,
)
from nmea_sentences import with_sum
from run_world import Start
from server_world import wait_for
from video_world import captured

from coastwatch.batches import Reports
from coastwatch.errors import AddressError, InputError
from coastwatch.formats.decoding import JUMP
from coastwatch.formats.nmea.ais import AisDecoder
from coastwatch.scenario import load_scenario
from coastwatch.server.deployment import with_track_sources
from coastwatch.server.feeds import live_input
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import Batch, encoded, of_file, of_scenario, send
from coastwatch.server.feeds.transport import Item
from coastwatch.server.run import run_scenario
from scaling.load import replayed

pytestmark = pytest.mark.whole

MESSAGE = b"!AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0*23"


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


def test_radars_that_are_heard_before_ais_take_its_date(monkeypatch: pytest.MonkeyPatch) -> None:
    plots, lines = items("asterix+udp://x:1"), items("ais+tcp://x:1")
    with receiving("asterix+udp://127.0.0.1:0", "ais+listen://127.0.0.1:0") as made:
        put_datagrams(made.ports[0], plots)
        deliver(made, len(plots))
        made.between(START_S - 10, START_S - 5)  # the recording is old: the clock of this machine has another date
        assert made.feeds()[0]["newest_s"] is None
        put(made.ports[1], lines)
        deliver(made, len(lines), 1)
        assert len(joined(cycles(made), "radar")) == len(SEA.radar)
    with receiving("asterix+udp://127.0.0.1:0", "ais+listen://127.0.0.1:0") as made:
        put_datagrams(made.ports[0], plots)
        deliver(made, len(plots))
        monkeypatch.setattr("coastwatch.server.feeds.live_input.SILENT_S", 0.0)
        made.between(START_S - 10, START_S - 5)
        assert made.feeds()[0]["newest_s"] is not None  # AIS was silent for too long


def test_radars_alone_take_the_date_of_their_address_and_go_on_over_midnight() -> None:
    address = "asterix+udp://127.0.0.1:0?date=2024-02-29"
    day_s, kind = 1_709_164_800.0, generated.Cat_048_1_32
    seconds = [86_398.0, 86_399.5, 1.0, 86_399.0, 2.5]

    def plot(of_day_s: float) -> Any:
        said = {"010": (("SAC", 25), ("SIC", 1)), "140": (of_day_s, "s"), "020": ((("TYP", 1), 0, 0, 0, 0, 0, None),)}
        return kind.cv_record.create({**said, "040": (("RHO", (3.0, "NM")), ("THETA", (40.0, "°")))})  # type: ignore[attr-defined]

    with receiving(address) as made:
        put_datagrams(made.ports[0], [kind.create([plot(of_day_s)]).unparse().to_bytes() for of_day_s in seconds])  # type: ignore[attr-defined]
        deliver(made, len(seconds))
        found = made.between(day_s, day_s + 2 * 86_400.0).radar
        assert made.dateless == []
    assert (found.time_s - day_s).tolist() == [86_398.0, 86_399.0, 86_399.5, 86_401.0, 86_402.5]
    for text, said in (("2024-2-30", "YYYY-MM-DD"), ("", "needed")):
        with pytest.raises(AddressError, match=said), receiving(f"asterix+udp://127.0.0.1:0?date={text or 'x'}"):
            pass
    with pytest.raises(AddressError, match="needed --clock feeds"):
        LiveInput([parsed(address)], SENSORS)
    with receiving("asterix+udp://127.0.0.1:0") as made:
        assert made.dateless == ["asterix+udp://127.0.0.1:0"]
    with receiving("asterix+udp://127.0.0.1:0", "ais+listen://127.0.0.1:0") as made:
        assert made.dateless == []


WITH_SOURCES = with_track_sources(SCENARIO, ["vts", "tower"]).sensors()


def test_targets_of_a_radar_are_where_it_says_and_a_lost_one_is_set_aside() -> None:
    lines = [
        with_sum(
            "RATTM,01,1.0,90.0,T,10.0,180.0,T,,,N,,T,,150640.00,A"
        ),  # before any clock: near its arrival, far ahead of the rest
        with_sum("GPZDA,150641.00,15,06,2025,00,00"),
        with_sum("RATTM,07,1.0,90.0,T,10.0,180.0,T,,,N,,T,,150641.00,A"),
        with_sum("RATTM,08,2.0,0.0,R,5.0,90.0,T,,,N,,L,,150641.00,A"),
        with_sum("RATTM,09,2.0,0.0,R,5.0,90.0,T,,,N,,T,,150641.00,A"),
        with_sum("RATLL,11,5030.000,N,00106.000,W,X,150642.00,T,"),
        b"$RATTM,07,1.0,90.0,T,10.0,180.0,T,,,N,,T,,150641.00,A*00",
    ]
    with receiving("ttm+listen://127.0.0.1:0?source=vts&site=50.7,-1.1", sensors=WITH_SOURCES) as made:
        put(made.ports[0], lines)
        deliver(made, len(lines))
        found = joined(cycles(made), "tracks")
        assert made.feeds()[0]["faults"] == {"set aside: target lost": 1, "checksum": 1, JUMP: 1}
    assert found.number.tolist() == [7, 9, 11]
    assert found.time_s.tolist() == 3 * [START_S + 1]  # none is later than the newest clock sentence
    assert (found.sensor == 0).all()
    east_deg = 1852 / (111_320 * np.cos(np.radians(50.7)))
    assert np.allclose(found.position_deg, [[50.7, -1.1 + east_deg], [50.7 + 2 / 60, -1.1], [50.5, -1.1]], atol=1e-4)
    assert np.allclose(found.velocity_m_s[0], [0.0, -5.144444], atol=1e-5)


def test_asterix_tracks_of_062_and_010_have_place_velocity_and_accuracy() -> None:
    identity = ("SAC", 25), ("SIC", 7)
    of_day = START_S % 86_400.0
    accuracy = {
        "APC": (("X", (12.0, "m")), ("Y", (10.0, "m"))),
        "COV": (-4.0, "m"),
        "ATV": (("X", (0.5, "m/s")), ("Y", (1.0, "m/s"))),
    }
    of_062 = {
        "010": identity, "040": 77, "070": (of_day + 3.0, "s"), "105": (("LAT", (50.7, "°")), ("LON", (-1.1, "°"))),
        "185": (("VX", (3.25, "m/s")), ("VY", (-1.5, "m/s"))), "500": accuracy,
    }  # fmt: skip
    ended = {**of_062, "080": ((0, 0, 0, 0, 0, None), (0, 1, 0, 0, 0, 0, 0, None))}
    of_010 = {
        "010": (("SAC", 25), ("SIC", 8)), "000": 1, "140": (of_day + 4.0, "s"), "161": (0, ("TRK", 5)),
        "040": (("RHO", (5000.0, "m")), ("TH", (90.0, "°"))), "041": (("LAT", (50.6, "°")), ("LON", (-1.2, "°"))),
        "202": (("VX", (1.0, "m/s")), ("VY", (2.0, "m/s"))),
    }  # fmt: skip
    plot = {**of_010, "010": (("SAC", 25), ("SIC", 9))}
    sent = [
        (generated.Cat_062_1_20, of_062),
        (generated.Cat_062_1_20, ended),
        (generated.Cat_010_1_1, of_010),
        (generated.Cat_010_1_1, plot),
    ]
    data = [kind.create([kind.cv_record.create(one)]).unparse().to_bytes() for kind, one in sent]  # type: ignore[attr-defined]
    radar = str(SENSORS.radars.name[0])
    address = f"asterix+udp://127.0.0.1:0?25/7=tower&25/8=vts&25/9={radar}"
    with receiving(address, "ais+listen://127.0.0.1:0", sensors=WITH_SOURCES) as made:
        put(made.ports[1], items("ais+tcp://x:1")[:1])  # the date
        deliver(made, 1, 1)
        made.between(START_S - 10, START_S - 5)
        put_datagrams(made.ports[0], data)
        deliver(made, len(data))
        parts = cycles(made)
        assert made.feeds()[0]["faults"] == {"set aside: last report of a track": 1}
    found, plots = joined(parts, "tracks"), joined(parts, "radar")
    assert (found.sensor.tolist(), found.number.tolist()) == ([1, 0], [77, 5])
    assert np.allclose(found.time_s, [START_S + 3.0, START_S + 4.0], atol=1 / 128)
    assert np.allclose(found.position_deg, [[50.7, -1.1], [50.6, -1.2]], atol=1e-5)
    assert np.allclose(found.velocity_m_s, [[3.25, -1.5], [1.0, 2.0]], atol=0.13)
    want = np.diag([144.0, 100.0, 0.25, 1.0])
    want[0, 1] = want[1, 0] = -16.0
    assert np.allclose(found.covariance[0], want, atol=1e-6)
    assert np.isnan(found.covariance[1]).all()
    assert np.allclose([plots.range_m[0], plots.azimuth_deg[0]], [5000.0, 90.0], atol=1.0)


def test_messages_of_a_broker_are_what_was_sent_also_after_it_was_away(tmp_path: Path) -> None:
    if shutil.which("mosquitto") is None or find_spec("aiomqtt") is None:
        pytest.skip("needs the broker mosquitto and the package aiomqtt")
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
    lines, settings = items("ais+tcp://x:1"), tmp_path / "mosquitto.conf"
    settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")

    async def publish(some: list[bytes]) -> None:
        from aiomqtt import Client

        async with Client("127.0.0.1", port) as client:
            for k in range(0, len(some), 10):
                await client.publish("coast/ais", b"\r\n".join(some[k : k + 10]), qos=1)

    with receiving(f"ais+mqtt://127.0.0.1:{port}/coast/ais") as made:
        for number, part in enumerate((lines[:70], lines[70:]), 1):
            with subprocess.Popen(["mosquitto", "-c", str(settings)], stderr=subprocess.DEVNULL) as broker:
                wait_for(lambda number=number: made.feeds()[0]["connections"] == number and made.feeds()[0]["connected"], 20.0)
                asyncio.run(publish(part))
                deliver(made, len(lines) if number == 2 else 70)
                broker.terminate()
        assert same(joined(cycles(made), "ais"), joined(by_tcp(lines), "ais"))


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


def test_what_was_made_before_the_run_began_is_not_called_late() -> None:
    lines = items("json+tcp://x:1")
    with receiving("json+listen://127.0.0.1:0") as made:
        put(made.ports[0], lines)
        deliver(made, len(lines))
        found = made.between(START_S + 10, START_S + SPAN_S)  # the first cycle
        before = int((SEA.radar.time_s <= START_S + 10).sum() + (SEA.bearing.time_s <= START_S + 10).sum())
        assert before > 5
        feed = made.feeds()[0]
        assert (feed["before_run"], feed["late"], len(found)) == (before, 0, len(lines) - before)
        assert [(fault.kind, fault.count) for fault in made.faults()] == [("report from before the run began", before)]


def test_the_generator_begins_now_although_its_simulation_took_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([START_S - 0.5, START_S + 7.25])
    monkeypatch.setattr("coastwatch.server.feeds.sending.time", SimpleNamespace(time=lambda: next(clock)))
    scenario = load_scenario("guanabara", {"cycles": "4", "warmup_s": "0"})
    batches = of_scenario(scenario, scenario.sensors(), ("ais", "asterix", "json"), now=True)
    (names_s, names), (first_s, first), *_ = batches
    assert (names_s, first_s) == (START_S + 7.0, START_S + 7.2)
    ais = parsed("ais+tcp://x:1")
    assert names(parsed("asterix+udp://x:1")) == []
    assert {line.rpartition(b"\\")[2].split(b",")[1] for line in names(ais)} == {b"2"}  # names alone: two sentences each
    assert all(float(re.findall(rb"c:(\d+)", line)[0]) / 1000 > START_S + 7.0 for line in first(ais))


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
    batches = iter([(START_S, lambda a: encoded(SEA, a, SENSORS)), (START_S + 6.0, lambda a: [b"{}"])])
    sender = threading.Thread(target=lambda: sent.update(send(batches, [address], 60.0, threading.Event())))
    sender.start()
    with receiving(f"json+listen://127.0.0.1:{port}") as made:
        deliver(made, len(SEA.radar) + len(SEA.bearing) + 1)
        sender.join()
    assert sent == {address.text: len(SEA.radar) + len(SEA.bearing) + 1}


def test_the_generator_connects_again_to_a_server_that_was_away() -> None:
    taken: list[bytes] = []

    def batches() -> Iterator[Batch]:
        for number in range(200):
            if len(taken) == 2:
                return
            yield START_S + number, lambda _: [b"{}"]

    def serve(server: socket.socket) -> None:
        for _ in range(2):
            with server.accept()[0] as sender:  # closed after its first lines
                taken.append(sender.recv(100))

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(20.0)
        receiver = threading.Thread(target=serve, args=(server,))
        receiver.start()
        send(batches(), [parsed(f"json+tcp://127.0.0.1:{server.getsockname()[1]}")], 20.0, threading.Event())
        receiver.join()
    assert [data[:2] for data in taken] == [b"{}", b"{}"]


@pytest.mark.parametrize(("transport", "ended"), [("tcp", signal.SIGINT), ("listen", signal.SIGTERM)])
def test_the_generator_says_that_it_waits_and_is_ended_by_a_signal(
    transport: str, ended: signal.Signals, start: Start, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
    (tmp_path / "one.nmea").write_bytes(b"\\c:1700000000*5D\\" + MESSAGE + b"\r\n")
    sender = start("feed", str(tmp_path / "one.nmea"), "--to", f"ais+{transport}://127.0.0.1:{port}")
    assert sender.stderr is not None
    assert "it is tried again for 20 s" in sender.stderr.readline()
    sender.send_signal(ended)
    _, err = sender.communicate(timeout=10.0)  # long before it would give up
    assert (sender.returncode, err) == (130, "coastwatch: interrupted\n")


def test_sentences_behind_tag_blocks_and_times_are_sent_with_the_lines_between(tmp_path: Path) -> None:
    lines = [b"# a receiver", b"\\c:1700000000*5D\\" + MESSAGE, b"12:00:00 " + MESSAGE]
    (tmp_path / "some.nmea").write_bytes(b"\r\n".join(lines))
    to = parsed(f"ais+file://{tmp_path}/out.nmea")
    assert send(of_file(tmp_path / "some.nmea", ["ais"]), [to], 100.0, threading.Event()) == {to.text: 3}


def test_a_capture_is_sent_as_ais_where_it_has_some(tmp_path: Path) -> None:
    to = parsed(f"ais+file://{tmp_path}/out.nmea")
    other = captured(tmp_path / "other.pcap", [(START_S, b"\x30\x00\x04\xff", 0)])
    with pytest.raises(InputError, match=r"other\.pcap: got no AIS sentence in its packets, needed !AIVDM or !AIVDO"):
        of_file(other, ["ais"])
    assert len(list(of_file(other, ["asterix"]))) == len(list(of_file(other, ["ais", "asterix"]))) == 1
    some = captured(tmp_path / "some.pcap", [(START_S, b"# a receiver", 0), (START_S, MESSAGE, 0)])
    assert send(of_file(some, ["ais"]), [to], 100.0, threading.Event()) == {to.text: 2}


@pytest.mark.slow
def test_a_recording_over_sockets_gives_the_pictures_of_its_files(tmp_path: Path) -> None:
    try:
        scenario, reports, cycles = replayed.recorded("solent", 2)
    except FileNotFoundError as error:
        pytest.skip(str(error))
    sent = replayed.batches(scenario, reports)
    urls = [f"sqlite:///{tmp_path}/{name}.db" for name in ("files", "live")]
    run_scenario(replayed.files(scenario, sent, tmp_path), database=urls[0])
    replayed.live(scenario, sent, cycles, 60.0, urls[1])
    found = replayed.differences(*urls, cycles)
    assert (found["cycles"], found["equal_cycles"]) == (cycles, cycles), found


def test_a_feed_that_is_flooded_holds_up_no_cycle_and_no_other_feed(monkeypatch: pytest.MonkeyPatch) -> None:
    period_s, each_s, lines = 2.0, 0.02, items("ais+tcp://x:1")
    decode, parts = AisDecoder.decode, [0, 0]

    def slow(decoder: AisDecoder, found: list[Item], reference_s: float | None) -> None:
        parts[decoder.name == "honest"] += 1
        time.sleep(each_s)
        decode(decoder, found, reference_s)

    monkeypatch.setattr(AisDecoder, "decode", slow)
    monkeypatch.setattr(live_input, "PART", 10)
    flooded, honest = parsed("ais+listen://127.0.0.1:0?name=flooded"), parsed("ais+listen://127.0.0.1:0?name=honest")
    scenario = load_scenario("guanabara", {"period_s": str(period_s)})
    with LiveInput([flooded, honest], SENSORS) as made:
        _, plan = made.begin(scenario, SENSORS, 0, threading.Event(), {})
        put(made.ports[0], [b"!AIVDM,1,1,,A,damaged*00"] * 20_000)  # 40 s of decoding
        put(made.ports[1], lines[:50])
        for feed, count in enumerate((20_000, 50)):
            deliver(made, count, feed)
        begun_s = time.monotonic()
        made.between(plan.start_s, plan.start_s + 1e-3)
        took_s = time.monotonic() - begun_s
    assert 2 <= parts[0] < 1_000
    assert parts[1] == 5
    assert took_s < 20.0  # at least half a period, at most as long as passed since the input was made
    assert made.feeds()[1]["refused"] == 0
