"""Raw NMEA: every wire form, every kind of bad record, and the recordings of ../shared/data with the counts that their READMEs give."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyais import encode_dict

from coastwatch.batches import AisReports, Fault, Radars, Sensors, Sonars, Stations
from coastwatch.sensors.nmea import Nmea
from coastwatch.stage import Plan

DATA = Path(__file__).parents[2].parent / "shared" / "data"
WIRE_DEG = 1e-5  # the wire carries 1/10000 minute, 1.7e-6 deg; pyais rounds to 1e-6
T0 = 1_357_134_218.0  # 2013-01-02 13:43:38 UTC
ASSUMED = "2013-01-02T00:00:00Z"
SOUND = "!AIVDM,1,1,,B,14pWHb?P03rwO<F:RQOnROw<25bd,0*3E"


def wire(said: dict[str, object], seq_id: int = 1) -> list[str]:
    """The sentences of a message."""
    return encode_dict(said, talker_id="AI", sentence_type="VDM", seq_id=seq_id)


def sentence(**said: object) -> list[str]:
    message = {"msg_type": 1, "mmsi": 257000000, "lat": 59.5, "lon": 10.5, "speed": 12.3, "course": 45.6, "second": 60} | said
    return wire(message)


def checked(body: str) -> str:
    value = 0
    for c in body:
        value ^= ord(c)
    return f"{value:02X}"


def tagged(tag: str, line: str) -> str:
    return f"\\{tag}*{checked(tag)}\\{line}"


def write(path: Path, lines: list[str]) -> Path:
    file = path / "feed.nmea"
    file.write_bytes("\r\n".join(lines).encode("latin-1") + b"\r\n")
    return file


def read(path: Path, lines: list[str], **more: object) -> tuple[AisReports, dict[str, Fault]]:
    reports, _, faults = Nmea(files=(write(path, lines),), **more).read()
    return reports, {f.kind: f for f in faults}


def dataset(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    return path


def no_sensors() -> Sensors:
    return Sensors(Radars.empty(), Stations.empty(), Sonars.empty(), (), np.zeros((0, 2)))


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
    _, statics, faults = Nmea(files=(write(tmp_path, lines),)).read()
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
        "not an MMSI": sentence(mmsi=25700000)[0],
        "position not available": sentence(lat=91.0)[0],
        "latitude out of range": sentence(lat=86.0)[0],
        "longitude out of range": sentence(lon=190.0)[0],
        "not a sentence": "?? noise ??",
        "undecodable": f"!AIVDM,1,1,,A,H3KLehdt00000000?6ekkjm000000,0*{checked('AIVDM,1,1,,A,H3KLehdt00000000?6ekkjm000000,0')}",
    }
    lines = [f"1357134218 {good}", *(f"1357134219 {line}" for line in bad.values()), f"1357134220 {again}"]
    reports, faults = read(tmp_path, lines)
    assert reports.received_s.tolist() == [T0, T0 + 2.0]
    assert {k: f.count for k, f in faults.items()} == dict.fromkeys(bad, 1)
    assert {k: f.where for k, f in faults.items()} == {k: f"feed.nmea:{i}" for i, k in enumerate(bad, 2)}


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


def test_time_going_backwards_is_taken_within_the_lateness_and_refused_beyond(tmp_path: Path) -> None:
    stamps = [100.0, 101.0, 97.0, 102.0, 10.0, 103.0]
    lines = [f"{T0 + t:.1f} {sentence(mmsi=257000001 + i)[0]}" for i, t in enumerate(stamps)]
    reports, faults = read(tmp_path, lines, intake={"lateness_s": 5.0})
    assert reports.mmsi.tolist() == [257000001, 257000002, 257000003, 257000004, 257000006]
    assert (reports.received_s - T0).tolist() == [100.0, 101.0, 101.0, 102.0, 103.0]
    assert (reports.time_s - T0).tolist() == [100.0, 101.0, 97.0, 102.0, 103.0]
    assert faults["time going backwards"].count == 1
    assert faults["time going backwards"].where == "feed.nmea:5"
    assert faults["set aside: late, taken in order of arrival"].count == 1


def test_one_wrong_clock_reading_does_not_condemn_what_follows(tmp_path: Path) -> None:
    stamps = [0.0, 1.0, 5000.0, 2.0, 3.0, 1e9, 4.0]
    lines = [f"{T0 + t:.1f} {sentence(mmsi=257000001 + i)[0]}" for i, t in enumerate(stamps)]
    reports, faults = read(tmp_path, lines)
    assert (reports.received_s - T0).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert faults["time going backwards"].where == "feed.nmea:3"
    assert faults["time far from the rest"].where == "feed.nmea:6"


def test_the_same_message_by_several_stations_is_taken_once(tmp_path: Path) -> None:
    said, later = sentence(mmsi=257000001, second=38)[0], sentence(mmsi=257000001, second=48)[0]
    heard = [("s:1,c:1357134218", said), ("s:2,c:1357134219", said), ("s:1,c:1357134228", later), ("s:1,c:1357134278", said)]
    reports, faults = read(tmp_path, [tagged(tag, line) for tag, line in heard])
    assert (reports.received_s - T0).tolist() == [0.0, 10.0, 60.0]
    assert faults["set aside: duplicate"].count == 1


def test_the_second_in_the_message_dates_the_fix(tmp_path: Path) -> None:
    stamp = T0 + 2.0  # second 40 of the minute
    lines = [f"{stamp + i:.0f} {sentence(mmsi=257000001 + i, second=s)[0]}" for i, s in enumerate((38, 5, 60, 43))]
    assert (read(tmp_path, lines)[0].time_s - T0).tolist() == [0.0, 3.0, 4.0, 5.0]
    assert (read(tmp_path, lines, intake={"message_second": False})[0].time_s - T0).tolist() == [2.0, 3.0, 4.0, 5.0]


def test_parts_are_joined_across_other_lines_and_inherit_the_time_of_their_group(tmp_path: Path) -> None:
    first, second = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"}, seq_id=4)
    other = sentence(mmsi=257000002)[0]
    lines = [tagged("g:1-2-77,s:a,c:1357134218", first), tagged("s:b,c:1357134219", other), tagged("g:2-2-77", second)]
    _, statics, faults = Nmea(files=(write(tmp_path, lines),)).read()
    assert statics.name.tolist() == ["NORD"]
    assert statics.received_s.tolist() == [T0]
    assert not faults


def test_parts_of_two_stations_are_not_mixed(tmp_path: Path) -> None:
    a = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "AAA"}, seq_id=4)
    b = wire({"msg_type": 5, "mmsi": 257000002, "shipname": "BBB"}, seq_id=4)
    said = [("s:a,c:1357134218", a[0]), ("s:b,c:1357134218", b[0]), ("s:a,c:1357134218", a[1]), ("s:b,c:1357134218", b[1])]
    _, statics, faults = Nmea(files=(write(tmp_path, [tagged(t, line) for t, line in said]),)).read()
    assert sorted(zip(statics.mmsi.tolist(), statics.name.tolist(), strict=True)) == [(257000001, "AAA"), (257000002, "BBB")]
    assert not faults


def test_without_any_time_the_settings_decide(tmp_path: Path) -> None:
    lines = [sentence(mmsi=257000001 + i)[0] for i in range(3)]
    reports, faults = read(tmp_path, lines)
    assert len(reports) == 0
    assert faults["time missing"].count == 3
    reports, faults = read(tmp_path, lines, assume_start_utc=ASSUMED, assume_interval_s=2.0)
    assert np.diff(reports.received_s).tolist() == [2.0, 2.0]
    assert not faults


def test_before_the_first_clock_sentence_its_time_is_taken(tmp_path: Path) -> None:
    zda = "GPZDA,134338.50,02,01,2013,00,00"
    lines = [sentence(mmsi=257000001)[0], f"${zda}*{checked(zda)}", sentence(mmsi=257000002)[0]]
    reports, faults = read(tmp_path, lines)
    assert (reports.received_s - T0).tolist() == [0.5, 0.5]
    assert faults["set aside: time missing, that of its neighbour taken"].count == 1


def test_own_ship_is_dropped_where_asked(tmp_path: Path) -> None:
    own = sentence(mmsi=257000009)[0]
    body = own[1:-3].replace("VDM", "VDO")
    lines = [f"1357134218 {own}", f"1357134219 !{body}*{checked(body)}", f"1357134220 {sentence(mmsi=257000001)[0]}"]
    assert read(tmp_path, lines, intake={"duplicate_within_s": 0.0})[0].mmsi.tolist() == [257000009, 257000009, 257000001]
    reports, faults = read(tmp_path, lines, drop_own_ship=True)
    assert reports.mmsi.tolist() == [257000001]
    assert faults["set aside: own ship"].count == 2


def test_a_gzip_file_that_breaks_off_is_read_so_far(tmp_path: Path) -> None:
    lines = "".join(f"{T0 + i:.0f} {sentence(mmsi=257000001 + i % 500, lat=i / 100)[0]}\n" for i in range(2000))
    file = tmp_path / "cut.nmea.gz"
    file.write_bytes(gzip.compress(lines.encode())[:-3000])
    reports, _, faults = Nmea(files=(file,)).read()
    assert 100 < len(reports) < 2000
    assert [f.kind for f in faults if f.kind == "file cut short"]


def test_a_missing_file_is_named() -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.nmea"):
        Nmea(files=(Path("nowhere.nmea"),)).read()


def test_a_file_without_a_usable_record_says_what_was_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"1 not a sentence \(first at feed\.nmea:1\)"):
        Nmea(files=(write(tmp_path, ["nothing here"]),)).span()


def test_two_files_are_merged_in_order_of_arrival_and_cut_by_cycle(tmp_path: Path) -> None:
    files = []
    for k in range(2):
        file = tmp_path / f"{k}.nmea"
        file.write_text("\n".join(f"{T0 + 2 * i + k:.0f} {sentence(mmsi=257000001 + k, lat=10.0 + i)[0]}" for i in range(5)))
        files.append(file)
    feed = Nmea(files=tuple(files))
    start_s, stop_s = feed.span()
    assert (start_s, stop_s) == (T0 - 1.0, T0 + 9.0)
    recording = feed.load(no_sensors(), 1, Plan(start_s=start_s, period_s=2.0, cycles=5))
    assert (np.diff(recording.reports.ais.received_s) == 1.0).all()
    assert [len(recording.reports.between(start_s + 2 * c, start_s + 2 * c + 2)) for c in range(5)] == [2, 2, 2, 2, 2]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    reports, _, faults = Nmea(files=(file,), assume_start_utc=ASSUMED).read()
    assert len(reports) <= len(lines)
    assert all(f.count > 0 and f.where and len(f.example) <= 80 for f in faults)


def accounted(reports: AisReports, statics: int, faults: dict[str, int]) -> int:
    notes = ("set aside: time missing", "set aside: late", "file cut")
    return len(reports) + statics + sum(n for k, n in faults.items() if not k.startswith(notes))


def test_pyais_sample_is_accounted_for() -> None:
    reports, statics, faults = Nmea(files=(dataset("pyais_nmea/nmea_data_sample.txt"),), assume_start_utc=ASSUMED).read()
    counts = {f.kind: f.count for f in faults}
    assert counts["empty payload"] == 100  # the README: 100 do not decode, 88 and more of them empty
    assert counts["lone part of a message"] == 20
    assert accounted(reports, len(statics), counts) == 898
    assert reports.position_deg[:, 0].min() > 35.6 - 0.1
    assert reports.position_deg[:, 0].max() < 38.6 + 0.1


def test_danish_stream_is_accounted_for() -> None:
    reports, statics, faults = Nmea(files=(dataset("aislib_stream/stream_example.txt.gz"),)).read()
    counts = {f.kind: f.count for f in faults}
    assert accounted(reports, len(statics), counts) == 4051
    assert len(np.unique(reports.mmsi)) == 1382
    assert not np.isin(reports.mmsi, [32310738, 123456789, 24466031]).any()
    assert not [
        k for k in counts if k in ("checksum", "undecodable", "half a line", "lone part of a message", "time going backwards")
    ]
    assert 0.0 < (reports.received_s - reports.time_s).max() < 30.0
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert 25.0 < reports.received_s[-1] - reports.received_s[0] <= 28.9


def test_norwegian_tag_blocks_are_read() -> None:
    file = dataset("kystverket_tagblock/norwegian.raw")
    assert sum(line.startswith("\\") for line in file.read_text().splitlines()) == 197
    reports, _, faults = Nmea(files=(file,)).read()
    counts = {f.kind: f.count for f in faults}
    assert reports.received_s.min() == 1733782034.0
    assert reports.received_s.max() <= 1733782039.0
    assert len(np.unique(reports.mmsi)) == 142
    assert not [k for k in counts if "tag block" in k or "part" in k]
    assert 56.9 - 0.1 < reports.position_deg[:, 0].min() < reports.position_deg[:, 0].max() < 71.3 + 0.1


@pytest.mark.parametrize(("name", "vdo", "least"), [("gofree-merrimac.log.gz", 0, 1290), ("nais300-merrimac.log", 130, 375)])
def test_logs_of_a_ship_are_dated_by_its_clock(name: str, vdo: int, least: int) -> None:
    reports, _, faults = Nmea(files=(dataset(f"signalk_logs/{name}"),)).read()
    counts = {f.kind: f.count for f in faults}
    assert counts.get("position not available", 0) == vdo
    assert len(reports) >= least
    assert "time missing" not in counts
    assert reports.received_s[-1] - reports.received_s[0] < 145.0


@pytest.mark.parametrize("folder", ["ais_vectors_gpsd", "ais_vectors_libais"])
def test_decoder_vectors_stop_nothing(folder: str) -> None:
    files = [p for p in sorted(dataset(folder).iterdir()) if p.name not in ("README.md", "COPYING", "LICENSE")]
    for file in files:
        reports, statics, faults = Nmea(files=(file,), assume_start_utc=ASSUMED).read()
        assert len(reports) + len(statics) + len(faults) > 0
        assert np.isfinite(reports.position_deg).all()
