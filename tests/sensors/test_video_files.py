"""Recorded radar video: captures with fragments, files of CAT 240 and pictures, whole, cut and wrong."""

from __future__ import annotations

import math
import struct
import tracemalloc
from itertools import pairwise
from pathlib import Path

import dpkt
import numpy as np
import pytest
from matplotlib import image
from PIL import Image
from spans import span_of
from video_world import CELLS, PERIOD_S, SPOKES, START_S, arrivals, captured, messages, sensors

from coastwatch.batches import RadarVideo, Sensors
from coastwatch.errors import InputError
from coastwatch.scenario import load_scenario
from coastwatch.sensors import VideoFiles
from coastwatch.sensors.recorded.video import pictures
from coastwatch.sensors.recorded.video.pictures import Pictures
from coastwatch.sensors.recorded.wire import captures

pytestmark = pytest.mark.contract

CENTRE, M_PER_PIXEL = 100, 20.0
TABLE = "file,time,heading\n"


def stream(**settings):
    feed = VideoFiles(**settings)
    return feed.load(sensors(), 1, None).reports, feed


def spokes_of(found) -> RadarVideo:
    (part,) = found.between(-math.inf, math.inf).video.parts
    return part


def levels(turns: float, cells: int = CELLS) -> np.ndarray:
    return np.stack([message.level for message in messages(turns, cells=cells)])


@pytest.mark.parametrize("writer", [dpkt.pcap.Writer, dpkt.pcapng.Writer])
def test_a_capture_with_fragments_gives_its_spokes(writer, tmp_path):
    path = captured(tmp_path / "x.pcap", arrivals(messages(turns=0.5, cells=4000)), writer)
    found, _ = stream(files=(str(path),))
    assert np.array_equal(spokes_of(found).level, levels(0.5, 4000))
    assert found.faults() == ()
    (content,) = found.contents()
    assert (content.records, content.kind) == (SPOKES // 2, "video reports")


def test_lost_and_cut_fragments_are_counted_and_the_rest_is_read(tmp_path):
    items = arrivals(messages(turns=0.5, cells=4000))
    path = captured(tmp_path / "x.pcap", items, lost=lambda packet, fragment: packet in (5, 9) and fragment == 1)
    found, _ = stream(files=(f"video+file:{path}?port=8600",))
    assert len(spokes_of(found)) == SPOKES // 2 - 2
    assert {fault.kind: fault.count for fault in found.faults()} == {captures.FRAGMENT: 4}
    cut, _ = stream(files=(str(captured(tmp_path / "cut.pcap", items, snap=800)),))
    assert len(cut.between(-math.inf, math.inf)) == 0
    assert captures.SHORT in {fault.kind for fault in cut.faults()}


def test_a_datagram_shorter_than_its_head_is_counted_as_cut(tmp_path):
    udp = dpkt.udp.UDP(sport=8600, dport=8600, ulen=4, data=b"0123456789")
    packet = dpkt.ip.IP(src=bytes(4), dst=bytes(4), p=dpkt.ip.IP_PROTO_UDP, data=udp)
    packet.len = len(packet)
    with (path := tmp_path / "x.pcap").open("wb") as file:
        dpkt.pcap.Writer(file, linktype=dpkt.pcap.DLT_RAW).writepkt(bytes(packet), ts=1.0)
    tally = captures.Tally()
    with path.open("rb") as file:
        assert list(captures.datagrams(captures.Bytes(file), "x.pcap", None, tally)) == []
    assert [fault.kind for fault in tally.faults()] == [captures.SHORT]


def packed(path: Path, fragments: list[tuple[float, int, int, bytes, bool]]) -> Path:
    """A capture made octet by octet, as RFC 791 has it. Args: fragments: time, number, place in octets, bytes, and whether more come."""
    out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 101)  # raw IP
    for at_s, number, first, part, more in fragments:
        head = struct.pack(
            ">BBHHHBBH4s4s", 0x45, 0, 20 + len(part), number, more << 13 | first // 8, 64, 17, 0, b"\x0a\0\0\1", b"\xef\0\0\1"
        )
        out += struct.pack("<IIII", int(at_s), 0, 20 + len(part), 20 + len(part)) + head + part
    path.write_bytes(out)
    return path


def pieces(data: bytes, number: int = 7, at_s: float = START_S, unit: int = 1480) -> list[tuple[float, int, int, bytes, bool]]:
    udp = struct.pack(">HHHH", 4000, 8600, 8 + len(data), 0) + data
    return [(at_s, number, first, udp[first : first + unit], first + unit < len(udp)) for first in range(0, len(udp), unit)]


def test_fragments_of_a_capture_of_a_network_are_joined(tmp_path):
    (data,) = (data for _, data, _ in arrivals(list(messages(turns=0.1, cells=4000))[:1]))
    found, _ = stream(files=(str(packed(tmp_path / "x.pcap", pieces(data))),))
    assert np.array_equal(spokes_of(found).level, levels(1 / SPOKES, 4000))
    assert found.faults() == ()


def test_a_number_that_comes_again_begins_another_datagram(tmp_path):
    first, second = (data for _, data, _ in arrivals(list(messages(turns=0.1, cells=4000))[:2]))
    items = [*pieces(first)[:2], *pieces(second, at_s=START_S + 3.0)]
    found, _ = stream(files=(str(packed(tmp_path / "x.pcap", items)),))
    assert np.array_equal(spokes_of(found).level, levels(2 / SPOKES, 4000)[1:])
    assert {fault.kind: fault.count for fault in found.faults()} == {captures.FRAGMENT: 2}


def test_fragments_that_overlap_hold_no_more_than_a_datagram(tmp_path):
    items = [(START_S, 7, 8 * k, bytes(32_000), True) for k in range(3)]
    items += [(START_S, 8, 0, bytes(16), True), (START_S, 8, 8, bytes(8), True), (START_S, 8, 24, bytes(8), False)]
    found, _ = stream(files=(str(packed(tmp_path / "x.pcap", items)),))
    assert len(found.between(-math.inf, math.inf)) == 0
    assert {fault.kind: fault.count for fault in found.faults()} == {captures.OVERLAP: 6}


def test_a_file_of_blocks_in_parts_of_time_gives_each_spoke_once(tmp_path):
    path = tmp_path / "x.ast"
    path.write_bytes(b"".join(data for _, data, _ in arrivals(messages(turns=4))))
    text = f"video+file:{path}?date=2026-07-01"
    whole, feed = stream(files=(text,))
    wanted = spokes_of(whole)
    assert np.array_equal(wanted.level, levels(4))
    again, _ = stream(files=(text,))
    edges = np.arange(START_S - 1.0, START_S + 13.0, 0.7)
    parts = [part for a, b in pairwise(edges) for part in again.between(a, b).video.parts]
    assert np.array_equal(np.concatenate([part.time_s for part in parts]), wanted.time_s[: sum(map(len, parts))])
    assert sum(map(len, parts)) >= 4 * SPOKES - 1
    assert span_of(feed, sensors()) == pytest.approx((START_S, START_S + 4 * PERIOD_S), abs=1.1)
    with pytest.raises(InputError, match="needed the day of its first report"):
        stream(files=(str(path),))
    with pytest.raises(ValueError, match=r"needed video\+file:PATH"):
        stream(files=(f"asterix+file:{path}",))


def picture(folder: Path, name: str, *echoes: tuple[float, float], size: int = 2 * CENTRE + 1) -> None:
    """A screen with noise, a yellow heading line and a table. Args: echoes: relative bearing, deg, and pixels from the middle."""
    rng = np.random.default_rng(len(name))
    pixels = np.repeat(rng.integers(10, 20, (size, size, 1)), 3, 2)
    for bearing, reach in echoes:
        x, y = CENTRE + reach * np.sin(np.radians(bearing)), CENTRE - reach * np.cos(np.radians(bearing))
        pixels[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2] = 200
    pixels[:CENTRE, CENTRE] = 255, 255, 0
    pixels[:30, :60] = 250
    image.imsave(folder / name, pixels.astype(np.uint8))


def settings(folder: Path, **given):
    given = {"radar": "north", "pixel_m": M_PER_PIXEL, "radius_pixels": CENTRE, "spokes": 512} | given
    return Pictures(table=folder / "turns.csv", rectangles=((0, 0, 60, 30),), colours=((255, 255, 0),), **given)


def test_pictures_are_masked_turned_by_their_heading_and_read_around_the_antenna(tmp_path):
    picture(tmp_path, "a.png", (60.0, 50.0))
    picture(tmp_path, "b.png", (40.0, 50.0))
    (tmp_path / "turns.csv").write_text(f"{TABLE}b.png,2026-07-01T00:00:03Z,50\na.png,2026-07-01T00:00:00Z,30\n")
    found, _ = stream(pictures=(settings(tmp_path, head_up=True),))
    first, second = (found.between(START_S + at, START_S + at + 2.0).video.parts for at in (-1.0, 2.0))
    for parts in (first, second):
        (turn,) = parts
        assert turn.level.max() == 200  # neither the line nor the table
        row, cell = np.unravel_index(turn.level.argmax(), turn.level.shape)
        assert np.degrees(turn.azimuth_rad[row]) == pytest.approx(90.0, abs=2.0)
        assert (cell + 0.5) * turn.cell_m == pytest.approx(50.0 * M_PER_PIXEL, abs=2.0 * M_PER_PIXEL)
    assert second[0].time_s[0] == START_S + 3.0
    (content,) = found.contents()
    assert (content.records, content.first_s, content.last_s) == (2, START_S, START_S + 3.0)
    assert found.faults() == ()


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "P", "RGB", "RGBA"])
def test_pictures_of_every_kind_have_the_levels_that_they_show(mode, tmp_path):
    grey = np.full((2 * CENTRE + 1, 2 * CENTRE + 1), 255, np.uint8)
    grey[:, CENTRE:] = 0
    shown = Image.fromarray(grey.astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(grey).convert(mode)
    shown.save(tmp_path / "a.png")
    (tmp_path / "turns.csv").write_text("file,time\na.png,2026-07-01T00:00:00Z\n")
    plain = Pictures(table=tmp_path / "turns.csv", radar="north", pixel_m=1.0, radius_pixels=CENTRE, spokes=8)
    (turn,) = stream(pictures=(plain,))[0].between(-math.inf, math.inf).video.parts
    assert (turn.level[:4] == 0).all()
    assert (turn.level[4:, 2:] == 255).all()


def test_a_picture_takes_little_memory_and_a_masked_middle_is_empty(tmp_path):
    image.imsave(tmp_path / "a.png", np.full((1_500, 1_500, 3), 7, np.uint8))
    (tmp_path / "turns.csv").write_text("file,time\na.png,2026-07-01T00:00:00Z\n")
    found, _ = stream(pictures=(settings(tmp_path, disc_pixels=20.0, radius_pixels=64),))
    tracemalloc.start()
    (turn,) = found.between(-math.inf, math.inf).video.parts
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert turn.level[:, :20].max() == 0
    assert turn.level[:, 20:].min() == turn.level.max() == 7
    assert peak < 30e6  # 2.25 million pixels in four bytes, twice; of floats 100 MB and more


def test_bad_pictures_are_counted_with_their_row_and_the_others_read(tmp_path, monkeypatch):
    picture(tmp_path, "good.png", (60.0, 50.0))
    picture(tmp_path, "small.png", size=2 * CENTRE - 1)
    (tmp_path / "text.png").write_text("no picture, whatever its name says")
    (tmp_path / "cut.png").write_bytes((tmp_path / "good.png").read_bytes()[:200])
    (tmp_path / "bomb.png").write_bytes(pictures.PNG + b"\0\0\0\rIHDR" + (4_001).to_bytes(4, "big") * 2)
    rows = [
        "good.png,1,5",
        "none.png,2,5",
        "small.png,3,5",
        "text.png,4,5",
        "cut.png,5,5",
        "bomb.png,6,5",
        "good.png,7,",
        "good.png,,5",
    ]
    (tmp_path / "turns.csv").write_text(TABLE + "".join(f"{row}\n" for row in rows))
    found, _ = stream(pictures=(settings(tmp_path, head_up=True),))
    assert len(found.between(-math.inf, math.inf).video) == 512
    assert {fault.kind: (fault.count, fault.where) for fault in found.faults()} == {
        pictures.NO_TIME: (1, "turns.csv:9"),
        pictures.NO_HEADING: (1, "turns.csv:8"),
        pictures.NO_PICTURE: (3, "turns.csv:3"),
        pictures.OTHER_SIZE: (1, "turns.csv:4"),
        pictures.TOO_LARGE: (1, "turns.csv:7"),
    }
    with pytest.raises(InputError, match="needed one of north, south as radar"):
        stream(pictures=(settings(tmp_path, radar="west"),))
    (tmp_path / "turns.csv").write_text("name,heading\na.png,5\n")
    with pytest.raises(InputError, match="needed file and time"):
        stream(pictures=(settings(tmp_path),))


def test_a_scenario_of_video_files_has_the_span_of_its_files(tmp_path):
    path = captured(tmp_path / "x.pcap", arrivals(messages(turns=3)))
    text = f"""name = "x"
title = "x"
period_s = 2.4
cycles = 0
warmup_s = 0.0
[area]
latitude_deg = 54.0
longitude_deg = 12.0
[[radars]]
name = "north"
latitude_deg = 54.0
longitude_deg = 12.0
range_nm = 6.0
rpm = 25.0
[input]
method = "video_files"
files = ["{path}"]
"""
    (tmp_path / "scenario.toml").write_text(text)
    scenario = load_scenario(str(tmp_path / "scenario.toml"))
    plan = scenario.plan()
    assert (plan.start_s, plan.cycles) == (START_S - 1.0, 4)
    recording = scenario.input.load(scenario.sensors(), 1, plan)
    assert isinstance(scenario.sensors(), Sensors)
    assert recording.rest(-math.inf) == 3 * SPOKES
    assert recording.all_faults() == ()
