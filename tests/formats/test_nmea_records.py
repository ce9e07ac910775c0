"""One record of raw NMEA: every wire form, what a message says, every kind of bad record."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from nmea_sentences import ASSUMED, SOUND, T0, checked, read, read_all, sentence, tagged, wire, write

from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.messages import Assembler
from coastwatch.formats.nmea.sentences import ais_sentences
from coastwatch.sensors.recorded.nmea.feed import Nmea

pytestmark = pytest.mark.golden

WIRE_DEG = 1e-5  # the wire carries 1/10000 minute, 1.7e-6 deg; pyais rounds to 1e-6


@pytest.mark.parametrize(
    "line",
    [
        f"{SOUND},1357134218",
        f"1357134218 {SOUND}",
        f"1357134218.000,{SOUND}",
        f"1357134218000\t{SOUND}",
        f"2013-01-02T13:43:38Z {SOUND}",
        f"2013-01-02 13:43:38,{SOUND}",
        f"2013-01-02T14:43:38+01:00\t{SOUND}",
        tagged("s:257,c:1357134218", SOUND),
        tagged("c:1357134218000", SOUND),
        tagged("1G2:0125,c:1357134218", SOUND),
        "$PGHP,1,2013,1,2,13,43,38,000,219,,2190048,1,28*\n" + SOUND,
        tagged("c:1357134218", "") + "\n" + SOUND,
        "$GPZDA,134338,02,01,13,00,00*6A\n" + SOUND,
        "$GPRMC,134338.00,A,5310.8,N,00525.7,E,0.0,0.0,020113,0.7,E,A*\n" + SOUND,
    ],
)
def test_every_form_of_receive_time_is_read(tmp_path: Path, line: str) -> None:
    lines = []
    for part in line.split("\n"):
        body = part[1:].split("*")[0]
        lines.append(f"{part.split('*')[0]}*{checked(body)}" if part.startswith("$") else part)
    reports, _ = read(tmp_path, lines)
    assert reports.received_s.tolist() == [T0]


@pytest.mark.parametrize("talker", ["AI", "BS", "AB", "SS", "BY", "--"])
@pytest.mark.parametrize("form", ["VDM", "VDO"])
def test_any_talker_is_heard(tmp_path: Path, talker: str, form: str) -> None:
    body = SOUND[1:-3].replace("AIVDM", talker + form)
    reports, _ = read(tmp_path, [f"!{body}*{checked(body)},1357134218"])
    assert len(reports) == 1


def test_what_a_position_report_says_is_kept(tmp_path: Path) -> None:
    lines = [tagged("c:1357134218", line) for line in sentence(mmsi=257000001)]
    lines += [tagged("c:1357134219", line) for line in sentence(msg_type=18, mmsi=257000002, lat=-33.0, lon=-179.9)]
    lines += [tagged("c:1357134220", line) for line in sentence(mmsi=257000003, speed=102.3, course=360.0)]
    reports, faults = read(tmp_path, lines)
    assert not faults
    assert reports.mmsi.tolist() == [257000001, 257000002, 257000003]
    assert reports.class_b.tolist() == [False, True, False]
    np.testing.assert_allclose(reports.position_deg[:2], [[59.5, 10.5], [-33.0, -179.9]], atol=WIRE_DEG)
    np.testing.assert_allclose(reports.sog_kn[:2], 12.3)
    np.testing.assert_allclose(reports.cog_deg[:2], 45.6)
    assert math.isnan(reports.sog_kn[2])
    assert math.isnan(reports.cog_deg[2])
    assert (reports.origin == -1).all()


def test_statics_of_both_classes_are_read(tmp_path: Path) -> None:
    five = {"msg_type": 5, "mmsi": 257000001, "shipname": "NORD", "callsign": "LA1", "ship_type": 70}
    lines = [tagged("c:1357134218", s) for s in wire(five | {"to_bow": 100, "to_stern": 20, "to_port": 8, "to_starboard": 9})]
    lines += [tagged("c:1357134219", s) for s in wire({"msg_type": 24, "mmsi": 257000002, "partno": 0, "shipname": "SMALL"})]
    b = {"msg_type": 24, "mmsi": 257000002, "partno": 1, "callsign": "LB2", "ship_type": 37, "to_bow": 5, "to_stern": 3}
    lines += [tagged("c:1357134220", s) for s in wire(b)]
    _, statics, faults = read_all(Nmea(files=(write(tmp_path, lines),)))
    assert not faults
    assert statics.name.tolist() == ["NORD", "SMALL", ""]
    assert statics.call_sign.tolist() == ["LA1", "", "LB2"]
    assert statics.ship_type.tolist() == [70, -1, 37]
    np.testing.assert_allclose(statics.length_m, [120.0, np.nan, 8.0])
    np.testing.assert_allclose(statics.beam_m, [17.0, np.nan, np.nan])


def test_every_kind_of_bad_record_is_counted_with_its_line_and_stops_nothing(tmp_path: Path) -> None:
    good, again = sentence(mmsi=257000001)[0], sentence(mmsi=257000001, lat=59.6)[0]
    five = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"})
    bad = {
        "half a line": good[:25],
        "checksum": good.replace("1,1,,A", "1,1,,B"),
        "empty payload": "!AIVDM,1,1,,B,,0*25",
        "payload too short": f"!AIVDM,1,1,,A,13u?etP,0*{checked('AIVDM,1,1,,A,13u?etP,0')}",
        "lone part of a message": five[0],
        "position not available": sentence(lat=91.0)[0],
        "latitude out of range, -85 to 85": sentence(lat=86.0)[0],
        "longitude out of range": sentence(lon=190.0)[0],
        "not a sentence": "?? noise ??",
        "undecodable": f"!AIVDM,1,1,,A,H3KLehdt00000000?6ekkjm000000,0*{checked('AIVDM,1,1,,A,H3KLehdt00000000?6ekkjm000000,0')}",
    }
    lines = [f"1357134218 {good}", *(f"1357134219 {line}" for line in bad.values()), f"1357134220 {again}"]
    reports, faults = read(tmp_path, lines)
    assert reports.received_s.tolist() == [T0, T0 + 2.0]
    assert {k: f.count for k, f in faults.items()} == dict.fromkeys(bad, 1)
    assert {k: f.where for k, f in faults.items()} == {k: f"feed.nmea:{i}" for i, k in enumerate(bad, 2)}


def test_vessels_with_an_odd_number_are_kept_as_sent(tmp_path: Path) -> None:
    sent = [0, 1, 1193046, 25700000, 111111111, 123456789, 800123456, 999999999]
    reports, faults = read(tmp_path, [f"1357134218 {line}" for n in sent for line in sentence(mmsi=n)])
    assert reports.mmsi.tolist() == sent
    assert not faults


def test_status_and_accuracy_are_read(tmp_path: Path) -> None:
    said = [{"status": 1, "accuracy": 1}, {"status": 14, "raim": 1}, {"status": 6}, {"msg_type": 18, "accuracy": 1}]
    messages = [sentence(mmsi=257000000 + k, **fields)[0] for k, fields in enumerate(said)]
    reports, _ = read(tmp_path, [f"1357134218 {line}" for line in messages])
    assert reports.nav_status.tolist() == [1, 14, 6, -1]
    assert reports.accuracy.tolist() == [1, 2, 0, 1]


def test_what_is_no_vessel_is_set_aside(tmp_path: Path) -> None:
    lines = [
        *wire({"msg_type": 4, "mmsi": 2570001, "lat": 59.0, "lon": 10.0}),
        *wire({"msg_type": 21, "mmsi": 992570001, "lat": 59.0, "lon": 10.0, "name": "BUOY"})[:1],
        *wire({"msg_type": 9, "mmsi": 111257001, "lat": 59.0, "lon": 10.0}),
        *sentence(mmsi=2570001),
        *sentence(mmsi=992570001),
        *sentence(mmsi=111257001),
        *sentence(mmsi=982571234),
        *sentence(mmsi=970123456),
    ]
    reports, faults = read(tmp_path, [f"1357134218 {line}" for line in lines])
    assert reports.mmsi.tolist() == [982571234, 970123456]
    assert all(kind.startswith("set aside: ") or kind == "lone part of a message" for kind in faults)
    assert faults["set aside: coast station"].count == 1
    assert faults["set aside: search and rescue aircraft"].count == 2


def test_own_ship_is_dropped_where_asked(tmp_path: Path) -> None:
    own = sentence(mmsi=257000009)[0]
    body = own[1:-3].replace("VDM", "VDO")
    lines = [f"1357134218 {own}", f"1357134219 !{body}*{checked(body)}", f"1357134220 {sentence(mmsi=257000001)[0]}"]
    assert read(tmp_path, lines, intake={"duplicate_within_s": 0.0})[0].mmsi.tolist() == [257000009, 257000009, 257000001]
    reports, faults = read(tmp_path, lines, drop_own_ship=True)
    assert reports.mmsi.tolist() == [257000001]
    assert faults["set aside: own ship"].count == 2


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 70), st.binary(min_size=0, max_size=3)), max_size=20))
def test_no_damage_to_lines_stops_the_feed(tmp_path: Path, damage: list[tuple[int, int, bytes]]) -> None:
    five = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"})
    zda = "GPZDA,134338.50,02,01,2013,00,00"
    kinds = [SOUND, tagged("g:1-2-3,s:x,c:1357134218", SOUND), *five, f"1357134218 {SOUND}", f"${zda}*{checked(zda)}"]
    lines = []
    for kind, at, noise in damage:
        line = kinds[kind].encode()
        lines.append(line[:at] + noise + line[at + len(noise) :] if len(noise) < 3 else line[:at])
    file = tmp_path / "noise.nmea"
    file.write_bytes(b"\n".join(lines))
    reports, _, faults = read_all(Nmea(files=(file,), assume_start_utc=ASSUMED))
    assert len(reports) <= len(lines)
    assert all(f.count > 0 and f.where and len(f.example) <= 80 for f in faults)


def test_values_that_no_message_can_hold_are_counted_and_not_used(tmp_path: Path) -> None:
    lines = [f"{T0 + i:.0f} {sentence(mmsi=257000001 + i, course=c)[0]}" for i, c in enumerate((359.9, 360.0, 360.1, 409.5))]
    reports, faults = read(tmp_path, lines)
    assert np.isnan(reports.cog_deg).tolist() == [False, True, True, True]
    counted = faults["set aside: COG that no message can hold, taken as not available"]
    assert (counted.count, counted.where) == (2, "feed.nmea:3")


@pytest.mark.parametrize(
    "body",
    [
        f"AIVDM,2,1,3,{'A' * 60_000},55P5TL01VIaAL@7WKO,0",
        "AIVDM,2,1,3,ABCDE,55P5TL01VIaAL@7WKO,0",
        "AIVDM,2,1,12345,A,55P5TL01VIaAL@7WKO,0",
        f"AIVDM{'X' * 300},2,1,3,A,55P5TL01VIaAL@7WKO,0",
        f"AIVDM,2,1,3,A,55P5TL01VIaAL@7WKO,{'0' * 60_000}",
    ],
)
def test_a_sentence_with_fields_longer_than_any_logger_writes_is_undecodable(body: str) -> None:
    tally = Tally()
    sentences = list(ais_sentences([f"!{body}*{checked(body)}".encode(), SOUND.encode()], "feed", tally))
    assembler = Assembler("feed", tally)
    assert len(assembler.whole(sentences, False).line) == 1
    assert {fault.kind: fault.count for fault in tally.faults()} == {"undecodable": 1}
    assert assembler.waiting == 0


def test_what_is_remembered_of_a_sender_of_long_tag_blocks_is_little() -> None:
    five = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"})[0]
    tally, assembler = Tally(), Assembler("feed", Tally())
    tracemalloc.start()
    for k in range(50):
        line = tagged(f"s:{k}{'x' * 20_000},c:1357134218", five)
        (kept,) = ais_sentences([line.encode()], "feed", tally)
        assembler.whole([kept], False)
        assert (kept.station, math.isnan(kept.own_s)) == (b"", True)
    assert tracemalloc.get_traced_memory()[0] < 200_000
    tracemalloc.stop()
    assert {fault.kind: fault.count for fault in tally.faults()} == {"tag block checksum": 50}
