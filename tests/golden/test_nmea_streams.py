"""Many records of raw NMEA: the time that each has, parts and repetitions, and the files that they come in."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from nmea_sentences import ASSUMED, T0, checked, read, sentence, tagged, wire, write

from coastwatch.batches import Radars, Sensors, Sonars, Stations
from coastwatch.sensors.recorded.nmea import Nmea
from coastwatch.stage import Plan


def no_sensors() -> Sensors:
    return Sensors(Radars.empty(), Stations.empty(), Sonars.empty(), (), np.zeros((0, 2)))


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
