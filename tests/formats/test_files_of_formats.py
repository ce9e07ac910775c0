"""Files of wire formats: each format of the table, as a file, gives the reports of its live decoder, wherever the file ends."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Callable
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import dpkt
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from coastwatch.batches import (
    AisReports,
    BearingReports,
    HeadingReports,
    RadarReports,
    Reports,
    Sensors,
)
from coastwatch.batches.struct import Batch
from coastwatch.batches.video import Videos
from coastwatch.errors import InputError
from coastwatch.formats import decoding
from coastwatch.formats.asterix.decoder import ASTERIX
from coastwatch.formats.format import OutSettings, Vessels
from coastwatch.formats.intake.accounts import accounts
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.json_lines import JSON
from coastwatch.formats.nmea import ais
from coastwatch.formats.registry import DECODED, FORMATS, decoders_of
from coastwatch.operators.cli import main
from coastwatch.scenario.sites import Radar, Sonar, TrackSource, sensors_of
from coastwatch.sensors.recorded.wire import stream as wire_stream
from coastwatch.sensors.recorded.wire.stream import CUT_FILE, DAMAGED_FILE, TOO_LONG, WireStream, items_of, wire_file

START_S = 1_782_907_200.0
DAY = datetime.fromtimestamp(START_S, UTC).date().isoformat()
SITE = (50.795, -1.105)
SECONDS = 90
PORT = 8600
REPORTS = [name for name in DECODED if name != "video"]
"""Formats of which each message has its own reports; video has tests of its own."""

HEADER_BYTES = 24 + 16 + 14 + 20 + 8  # of a capture, a packet, Ethernet, IP and UDP


def sensors() -> Sensors:
    """A radar on land, one on a ship, one sonar and one track source."""
    where = {"latitude_deg": SITE[0], "longitude_deg": SITE[1]}
    radar = Radar(name="north", **where, range_nm=12.0, rpm=24.0, range_noise_m=10.0, azimuth_noise_deg=0.3)
    ship = Radar(name="ship", **where, range_nm=12.0, rpm=24.0, azimuth_reference="heading")
    sonar = Sonar(name="mouth", **where, range_nm=10.0, bearing_noise_deg=0.5)
    return sensors_of((radar, ship), (), (sonar,), (TrackSource(name="vts"),))


def reports() -> Reports:
    """A plot, a bearing and a position each second."""
    n, none = SECONDS, np.full(SECONDS, -1, np.int64)
    time_s, zeros = START_S + np.arange(n) + 0.25, np.zeros(n, np.int64)
    site = np.tile(SITE, (n, 1))
    radar = RadarReports(zeros, time_s, time_s, 4000.0 + 5.0 * np.arange(n), np.linspace(80.0, 100.0, n), site, none)
    bearing = BearingReports(zeros, time_s, time_s, np.linspace(170.0, 190.0, n), zeros + 7, site, none, none)
    position = np.array(SITE) + np.stack([np.arange(n) * 1e-4, np.zeros(n)], 1)
    speed, course = np.full(n, 21.6), np.zeros(n)
    ais = AisReports(time_s, time_s, 235_000_000 + np.arange(n) % 3, position, speed, course, np.zeros(n, np.bool_), none)
    headings = HeadingReports(zeros + 1, time_s, time_s, np.linspace(350.0, 370.0, n) % 360.0)
    return Reports(radar=radar, ais=ais, bearing=bearing, headings=headings)


def messages(name: str) -> list[bytes]:
    """What another system would send in a format: reports, or else pictures."""
    one = FORMATS[name]
    if one.encode is not None:
        encoded = one.encode(reports(), sensors())
        return sorted(encoded, key=lambda line: json.loads(line)["time"]) if name == JSON.name else encoded
    assert one.pictures is not None
    encoder, out = one.pictures(OutSettings(SITE)), []
    for k in range(SECONDS):
        clock = datetime.fromtimestamp(START_S + k, UTC)
        zda = f"GPZDA,{clock:%H%M%S}.00,{clock:%d,%m,%Y},00,00"
        out += [f"${zda}*{np.bitwise_xor.reduce(np.frombuffer(zda.encode(), np.uint8)):02X}".encode()]
        out += [line.rstrip(b"\r\n") for line in encoder.messages(vessel(START_S + k, k))]
    return out


def vessel(time_s: float, k: int) -> Vessels:
    value = {name: np.array([10.0]) for name in ("sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg")}
    where = np.array([[SITE[0] + 0.01 + 1e-4 * k, SITE[1]]])
    return Vessels(1, time_s, 1.0, np.array([3]), np.array([3]), where, **value, mmsi=np.array([-1]), name=["SHIP"])


def address(name: str, path: Path, *, dated: bool = True) -> str:
    """The address of a file. A format whose times have no date gets one."""
    options = {"ttm": f"?source=vts&site={SITE[0]},{SITE[1]}"}.get(name, f"?date={DAY}" if dated and name == "asterix" else "")
    return f"{name}+file:{path}{options}"


def as_file(name: str, path: Path, found: list[bytes]) -> Path:
    end = b"" if FORMATS[name].in_datagrams else b"\r\n"
    path.write_bytes(b"".join(one + end for one in found))
    return path


def as_capture(path: Path, found: list[bytes], writer: Callable[..., Any] = dpkt.pcap.Writer) -> Path:
    """The messages as datagrams in a capture, each when it was sent, with others between them."""
    with path.open("wb") as file:
        made = writer(file)
        for k, data in enumerate(found):
            for port, payload in ((PORT, data), (53, b"a question of another kind")):
                udp = dpkt.udp.UDP(sport=4000, dport=port, data=payload, ulen=8 + len(payload))
                ip = dpkt.ip.IP(src=b"\x0a\0\0\1", dst=b"\x0a\0\0\2", p=dpkt.ip.IP_PROTO_UDP, data=udp)
                ip.len = 28 + len(payload)
                frame = dpkt.ethernet.Ethernet(src=b"\0" * 6, dst=b"\1" * 6, type=dpkt.ethernet.ETH_TYPE_IP, data=ip)
                made.writepkt(bytes(frame), ts=START_S + SECONDS * k / len(found))
    return path


def stream(text: str) -> WireStream:
    return WireStream([wire_file(text)], sensors(), 60.0)


def live(text: str, found: list[bytes], arrived_s: float = math.nan) -> Reports:
    """The reports of the live decoder of the format, which is told the same."""
    file = wire_file(text)
    (decoder,), (cut,) = decoders_of([(file.format, file.settings())], sensors())
    decoder.decode([(arrived_s, one, 0) for one in found], None)
    return cut(-math.inf, math.inf)


def assert_same(got: Reports, wanted: Reports) -> None:
    for part in fields(wanted):
        a, b = getattr(got, part.name), getattr(wanted, part.name)
        if part.name == "video":
            assert a == b == Videos()
            continue
        assert isinstance(a, Batch)
        for column in fields(b):
            assert np.array_equal(
                getattr(a, column.name), getattr(b, column.name), equal_nan=column.name not in ("name", "call_sign")
            )


def test_what_two_captures_of_a_radar_both_have_is_one_plot(tmp_path: Path) -> None:
    """They overlap by a datagram of 40 plots. Two plots of one place at two times, or of two radars, are two."""
    found = messages("asterix")
    paths = as_capture(tmp_path / "a.pcap", found[:2]), as_capture(tmp_path / "b.pcap", found[1:])
    files = [wire_file(address("asterix", path, dated=False)) for path in paths]
    plots = WireStream(files, sensors(), 10.0).between(-math.inf, math.inf).radar
    np.testing.assert_array_equal(plots.time_s, reports().radar.time_s)
    other = replace(plots, sensor=plots.sensor + 1)
    later = replace(plots, time_s=plots.time_s + 0.5, received_s=plots.received_s + 0.5)
    assert len(Reports.merged([Reports(radar=one) for one in (plots, other, later, plots)]).radar) == 3 * SECONDS


@pytest.mark.parametrize("name", REPORTS)
def test_a_file_gives_the_reports_of_the_live_decoder(name: str, tmp_path: Path) -> None:
    found = messages(name)
    text = address(name, as_file(name, tmp_path / "x.bin", found))
    wanted = live(text, found)
    assert len(wanted) >= SECONDS
    read = stream(text)
    assert_same(read.between(-math.inf, math.inf), wanted)
    assert read.faults() == ()
    (content,) = read.contents()
    assert content.records == len(wanted)
    assert content.read == len([line for line in found if line]) or name == ASTERIX.name  # a datagram has many records
    assert accounts(read.contents(), read.faults()).unaccounted == 0
    packed = tmp_path / "x.gz"
    packed.write_bytes(gzip.compress((tmp_path / "x.bin").read_bytes()))
    assert_same(stream(address(name, packed)).between(-math.inf, math.inf), wanted)


@pytest.mark.parametrize("name", REPORTS)
def test_a_file_in_parts_of_time_gives_every_report_once(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire_stream, "BATCH", 7)
    found = messages(name)
    text = address(name, as_file(name, tmp_path / "x.bin", found))
    wanted, read = live(text, found), stream(text)
    cycles = [read.between(START_S + 3.0 * k - 3.0, START_S + 3.0 * k) for k in range(SECONDS // 3 + 2)]
    assert_same(Reports.merged(cycles), wanted)
    assert stream(text).rest(-math.inf) == len(wanted)
    assert stream(text).span() == pytest.approx((START_S, START_S + SECONDS), abs=1.3)


@pytest.mark.parametrize("writer", [dpkt.pcap.Writer, dpkt.pcapng.Writer])
@pytest.mark.parametrize("name", REPORTS)
def test_a_capture_gives_the_reports_of_the_live_decoder(name: str, writer: Callable[..., Any], tmp_path: Path) -> None:
    found = messages(name)
    plain = address(name, as_file(name, tmp_path / "x.bin", found))
    path = as_capture(tmp_path / "x.pcap", found, writer)
    text = address(name, path, dated=False)
    read = stream(f"{text}{'&' if '?' in text else '?'}port={PORT}")
    assert_same(read.between(-math.inf, math.inf), live(plain, found))
    assert [fault.kind for fault in read.faults()] == ["set aside: packet without a datagram of the feed"]


@pytest.mark.parametrize("name", ["asterix", "ais"])
def test_a_packed_capture_gives_the_reports_of_the_capture(name: str, tmp_path: Path) -> None:
    """Times of day without a date are of its packets, as Wireshark packs them."""
    plain = as_capture(tmp_path / "x.pcap", messages(name))
    packed = tmp_path / "x.pcap.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    one, other = (stream(address(name, path, dated=False)).between(-math.inf, math.inf) for path in (plain, packed))
    assert_same(one, other)


DAMAGED = {
    "ais": [b"!AIVDM,1,1,,A,damaged*00", b"!AIVDM,2,1,3,A,55P5TL01VIaAL@7WKO@mBplU@<PDhh000000001S;AJ::4A80?4i@E53,0*3E", b"x"],
    "asterix": [b"\x30\x00\x09\xff\xff\xff\xff\xff\xff", b"\x01\x00\x04\x00"],
    "json": [b"no object", b'{"type": "bearing", "sonar": "mouth", "bearing_deg": 1}'],
    "heading": [b"$HEHDT,damaged*00", b"$HETHS,12.0,V*1B", b"x"],
    "ttm": [b"$RATTM,01,damaged*00", b"$GPRMC,120000.00,A,damaged*00", b"x"],
}


def unaccounted(text: str) -> int:
    """Records of a file that are nowhere, after a run by cycles."""
    read = stream(text)
    for k in range(SECONDS // 3 + 2):
        read.between(START_S + 3.0 * k - 3.0, START_S + 3.0 * k)
    assert read.contents()[0].records >= SECONDS - 1
    return accounts(read.contents(), read.faults()).unaccounted


@pytest.mark.parametrize("name", REPORTS)
def test_every_record_of_a_damaged_file_is_somewhere_and_a_lost_one_is_noticed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire_stream, "BATCH", 7)
    found = messages(name)
    text = address(name, as_file(name, tmp_path / "x.bin", [*found[:9], *DAMAGED[name], *found[5:9], *found[9:]]))
    assert unaccounted(text) == 0
    losses = []
    add, decoded = decoding.Waiting.add, ais.decoded

    def add_but_one(waiting: decoding.Waiting, kind: str, batch: Any) -> None:
        losses.append(1)
        add(waiting, kind, batch.take(np.arange(len(batch)) > 0) if len(losses) == 1 else batch)

    def decoded_but_one(*given: Any) -> Any:
        losses.append(1)
        rows, *rest = decoded(*given)
        return rows.take(np.arange(len(rows)) > 0) if len(losses) == 1 else rows, *rest

    monkeypatch.setattr(decoding.Waiting, "add", add_but_one)
    monkeypatch.setattr(ais, "decoded", decoded_but_one)
    assert unaccounted(text) == 1


CONTENT = {
    JSON.name: b"".join(b"%d" % k * (1 + k % 5) + b"\r\n" for k in range(12)),
    ASTERIX.name: b"".join(bytes([48, 0, 3 + n]) + b"x" * n for n in (1, 5, 2, 9, 1, 30)),
}


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(sorted(CONTENT)), size=st.integers(1, 64), beyond=st.integers(-1, 1), blocks=st.integers(1, 4))
def test_messages_do_not_depend_on_where_blocks_and_the_file_end(
    name: str, size: int, beyond: int, blocks: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, content = tmp_path / "x.bin", CONTENT[name][: max(size * blocks + beyond, 4 if name == "json" else 13)]
    path.write_bytes(content)
    whole, tally = list(items_of(wire_file(f"{name}+file:{path}"), Tally())), Tally()
    monkeypatch.setattr(wire_stream, "BLOCK_BYTES", size)
    found = list(items_of(wire_file(f"{name}+file:{path}"), tally))
    monkeypatch.undo()
    assert [data for _, data, _ in found] == [data for _, data, _ in whole]
    rest = content if name == "json" else content[sum(len(data) for _, data, _ in found) :]
    assert tally.count(CUT_FILE) == int(name == "asterix" and bool(rest))
    if name == "json":
        assert [data for _, data, _ in found] == [line.rstrip(b"\r") for line in content.removesuffix(b"\n").split(b"\n")]


@pytest.mark.parametrize("name", REPORTS)
def test_a_file_that_is_cut_is_used_as_far_as_it_goes(name: str, tmp_path: Path) -> None:
    found = messages(name)
    whole = as_file(name, tmp_path / "x.bin", found).read_bytes()
    for size in range(len(whole) // 2, len(whole) // 2 + 120, 7):
        (tmp_path / "cut.bin").write_bytes(whole[:size])
        read = stream(address(name, tmp_path / "cut.bin"))
        assert len(read.between(-math.inf, math.inf)) > 0
        assert all(fault.where.startswith("cut.bin") for fault in read.faults())


@pytest.mark.parametrize("writer", [dpkt.pcap.Writer, dpkt.pcapng.Writer])
def test_a_capture_that_is_cut_or_damaged_is_used_as_far_as_it_goes(writer: Callable[..., Any], tmp_path: Path) -> None:
    whole = as_capture(tmp_path / "x.pcap", messages("json"), writer).read_bytes()
    cut = tmp_path / "cut.pcap"
    for size in range(len(whole) // 2, len(whole) // 2 + 200, 9):
        cut.write_bytes(whole[:size])
        tally = Tally()
        assert len(list(items_of(wire_file(f"json+file:{cut}"), tally))) > 10
        assert tally.count(CUT_FILE) + tally.count(DAMAGED_FILE) <= 1
    cut.write_bytes(whole[: len(whole) // 2] + b"\xff" * 400)
    tally = Tally()
    assert len(list(items_of(wire_file(f"json+file:{cut}"), tally))) > 10
    assert tally.count(CUT_FILE) + tally.count(DAMAGED_FILE) == 1
    cut.write_bytes(whole[:6])
    with pytest.raises(InputError, match=r"cut\.pcap: byte 6"):
        list(items_of(wire_file(f"json+file:{cut}"), Tally()))


def test_a_line_that_is_too_long_is_counted_once_with_its_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.jsonl"
    path.write_bytes(b"a\n" + b"b" * (3 * wire_stream.LONGEST) + b"\nc\n")
    for size in (wire_stream.LONGEST // 3, 1 << 20):
        monkeypatch.setattr(wire_stream, "BLOCK_BYTES", size)
        tally = Tally()
        assert [data for _, data, _ in items_of(wire_file(f"json+file:{path}"), tally)] == [b"a", b"c"]
        (fault,) = tally.faults()
        assert (fault.kind, fault.count, fault.where) == (TOO_LONG, 1, "x.jsonl: byte 2")


def test_what_no_format_can_read_is_refused_with_file_and_byte(tmp_path: Path) -> None:
    path = tmp_path / "x.ast"
    path.write_bytes(b"\x30\x00\x00\x00")
    with pytest.raises(InputError, match=r"x\.ast: byte 4: got an ASTERIX data block of 0 bytes"):
        list(items_of(wire_file(f"asterix+file:{path}"), Tally()))
    with pytest.raises(InputError, match=r"needed the day of its first report behind '\?'"):
        stream(f"asterix+file:{path}")
    for text in ("cot+file:x", "ais+udp://x:1", "ais+file:", "json+file:x?port=a"):
        with pytest.raises(InputError, match="needed FORMAT\\+file:PATH"):
            wire_file(text)


def test_lines_without_a_time_are_counted_with_their_file(tmp_path: Path) -> None:
    path = tmp_path / "x.jsonl"
    path.write_text('{"type": "bearing", "sonar": "mouth", "bearing_deg": 1}\nno object\n')
    read = stream(f"json+file:{path}")
    assert len(read.between(-math.inf, math.inf)) == 0
    assert {fault.kind: fault.where for fault in read.faults()} == {
        "not an object of the format": "x.jsonl:2",
        "time missing": "x.jsonl",
    }


@pytest.mark.parametrize(
    ("line", "kind", "example"),
    [
        (
            '"type": "plot", "radar": "north", "range_m": 1, "azimuth_deg": -10',
            "azimuth_deg wrong or out of range",
            "azimuth_deg -10",
        ),
        ('"type": "bearing", "sonar": "mouth", "bearing_deg": 361', "bearing_deg wrong or out of range", "bearing_deg 361"),
        ('"type": "bearing", "sonar": "mouth"', "no bearing_deg", '{"type": "bearing", "sonar": "mouth"}'),
        ('"type": "bearing", "sonar": "mouth", "bearing_deg": 1, "x": 2', "field that the format does not have", "x"),
        ('"type": "bearing", "sonar": "mouth", "time": "noon", "bearing_deg": 1', "time wrong or out of range", "time 'noon'"),
        ('"type": "moon"', "not an object of the format", '{"type": "moon"}'),
        ('"type": ', "not an object of the format", '{"type": }'),
    ],
)
def test_a_line_of_json_that_is_refused_names_its_field(tmp_path: Path, line: str, kind: str, example: str) -> None:
    path = tmp_path / "x.jsonl"
    path.write_text(f"{{{line}}}\n")
    read = stream(f"json+file:{path}")
    assert len(read.between(-math.inf, math.inf)) == 0
    (fault,) = read.faults()
    assert (fault.kind, fault.where, fault.example) == (kind, "x.jsonl:1", example)


def test_lines_of_json_keep_the_place_of_a_sensor_that_moves_and_the_errors_of_each_report(tmp_path: Path) -> None:
    """They were lost on the way, in silence: a camera on a ship could not be fed."""
    sent = reports()
    moved = sent.radar.site_deg + np.linspace(0.0, 0.1, SECONDS)[:, None]
    sigma = np.where(np.arange(SECONDS) % 2, np.linspace(1.0, 5.0, SECONDS), np.nan)
    sent = replace(
        sent,
        radar=replace(sent.radar, site_deg=moved, range_sigma_m=sigma, azimuth_sigma_deg=sigma),
        bearing=replace(sent.bearing, site_deg=moved[::-1], bearing_sigma_deg=sigma, contact=sent.bearing.contact + 2**39),
    )
    path = tmp_path / "x.jsonl"
    path.write_bytes(b"\n".join(JSON.encode(sent, sensors())))
    read = stream(f"json+file:{path}").between(-math.inf, math.inf)
    for kind, names in (("radar", ("range_sigma_m", "azimuth_sigma_deg")), ("bearing", ("bearing_sigma_deg", "contact"))):
        got, wanted = getattr(read, kind), getattr(sent, kind)
        for name in ("site_deg", "time_s", *names):
            np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-12)


def test_fuse_reads_captures_and_lines_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plots = as_capture(tmp_path / "plots.pcap", messages("asterix"))
    ais = as_file("ais", tmp_path / "ais.nmea", messages("ais"))
    line = ["fuse", "--feed", f"asterix+file:{plots}?port={PORT}", "--feed", f"ais+file:{ais}"]
    line += ["--feed", address("ttm", as_file("ttm", tmp_path / "x.ttm", messages("ttm")))]
    line += ["--radar", f"north,{SITE[0]},{SITE[1]},12,24,10,0.3", "--db", f"sqlite:///{tmp_path / 'x.db'}"]
    assert main(line) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "ais.nmea: 90 ais reports" in said
    assert "plots.pcap: 90 asterix reports" in said
    assert "x.ttm: 90 ttm reports" in said
