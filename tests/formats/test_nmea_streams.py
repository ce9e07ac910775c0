"""Many records of raw NMEA: the time that each has, parts and repetitions, and the files that they come in."""

from __future__ import annotations

import gzip
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from nmea_sentences import ASSUMED, T0, checked, read, read_all, sentence, tagged, wire, write
from spans import span_of

from coastwatch.batches import Radars, Sensors, Sonars, Stations
from coastwatch.formats.decoding import Item
from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.nmea.ais import AisDecoder
from coastwatch.formats.nmea.sentence_feed import SentenceFeed, made_sentence
from coastwatch.sensors.recorded.nmea import feed as nmea
from coastwatch.sensors.recorded.nmea.feed import Nmea
from coastwatch.sensors.recorded.tables.feed import Tables
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden


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


@pytest.mark.parametrize("late_s", [15.0, 20.0, 37.0])
def test_a_feed_that_is_late_as_a_whole_is_dated_by_the_seconds_of_its_messages(tmp_path: Path, late_s: float) -> None:
    """Ships were shown 60 m off at 10 knots. T0 is second 38 of a minute; one vessel of eight has a wrong second."""
    lines = []
    for k in range(60):
        second = int(38 + k) % 60 if k % 8 else 0
        lines.append(f"{T0 + k + late_s:.0f} {sentence(mmsi=257000001 + k % 8, second=second)[0]}")
    reports, faults = read(tmp_path, lines)
    right = reports.mmsi != 257000001
    assert np.count_nonzero(right) >= 50
    assert (reports.received_s - reports.time_s)[right].tolist() == [late_s] * np.count_nonzero(right)
    assert faults["received late, as the reports of most vessels: the second in the message is the time of the fix"].count >= 50


def test_a_second_too_old_to_be_the_time_makes_the_time_of_reception_uncertain(tmp_path: Path) -> None:
    stamp = T0 + 2.0  # second 40 of the minute
    lines = [f"{stamp + i:.0f} {sentence(mmsi=257000001 + i, second=s)[0]}" for i, s in enumerate((20, 48, 60, 42))]
    reports, _ = read(tmp_path, lines)
    assert (reports.time_s - T0).tolist() == [2.0, 3.0, 4.0, 4.0]
    np.testing.assert_equal(reports.time_error_s.tolist(), [20.0, 7.0, np.nan, np.nan])
    assert np.isnan(read(tmp_path, lines, intake={"message_second": False})[0].time_error_s).all()


def test_parts_are_joined_across_other_lines_and_inherit_the_time_of_their_group(tmp_path: Path) -> None:
    first, second = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"}, seq_id=4)
    other = sentence(mmsi=257000002)[0]
    lines = [tagged("g:1-2-77,s:a,c:1357134218", first), tagged("s:b,c:1357134219", other), tagged("g:2-2-77", second)]
    _, statics, faults = read_all(Nmea(files=(write(tmp_path, lines),)))
    assert statics.name.tolist() == ["NORD"]
    assert statics.received_s.tolist() == [T0]
    assert not faults


def test_parts_of_two_stations_are_not_mixed(tmp_path: Path) -> None:
    a = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "AAA"}, seq_id=4)
    b = wire({"msg_type": 5, "mmsi": 257000002, "shipname": "BBB"}, seq_id=4)
    said = [("s:a,c:1357134218", a[0]), ("s:b,c:1357134218", b[0]), ("s:a,c:1357134218", a[1]), ("s:b,c:1357134218", b[1])]
    _, statics, faults = read_all(Nmea(files=(write(tmp_path, [tagged(t, line) for t, line in said]),)))
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
    reports, _, faults = read_all(Nmea(files=(file,)))
    assert 100 < len(reports) < 2000
    assert [f.kind for f in faults if f.kind == "file cut short"]


def test_a_missing_file_is_named() -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.nmea"):
        read_all(Nmea(files=(Path("nowhere.nmea"),)))


def test_a_file_without_a_usable_record_says_what_was_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"feed\.nmea: got no sentence of NMEA 0183, needed VDM or VDO; a table of AIS goes to"
    ):
        span_of(Nmea(files=(write(tmp_path, ["time,mmsi"]),)))
    with pytest.raises(ValueError, match=r"1 half a line \(first at feed\.nmea:1: !AIVDM,"):
        span_of(Nmea(files=(write(tmp_path, ["!AIVDM,1,1,,A,33P;Tw0"]),)))
    target = "$RATTM,01,0.25,190.8,T,12.1,109.7,T,0.1,0.5,N,TGT01,T,,100021.00,A"
    lines = [target, target, target[:30], "$RAHDT,12.0,T", sentence()[0].partition("*")[0]]
    with pytest.raises(
        ValueError,
        match=r"2 without checksum \(first at feed\.nmea:1: \$RATTM,.*\); 1 half a line \(first at feed\.nmea:3: \$RATTM,",
    ):
        span_of(Tables(track_sentences=(write(tmp_path, lines),)))
    with pytest.raises(ValueError, match=r"1 without checksum \(first at feed\.nmea:5: !"):
        span_of(Nmea(files=(write(tmp_path, lines),)))


def test_two_files_are_merged_in_order_of_arrival_and_cut_by_cycle(tmp_path: Path) -> None:
    files = []
    for k in range(2):
        file = tmp_path / f"{k}.nmea"
        file.write_text("\n".join(f"{T0 + 2 * i + k:.0f} {sentence(mmsi=257000001 + k, lat=10.0 + i)[0]}" for i in range(5)))
        files.append(file)
    feed = Nmea(files=tuple(files))
    start_s, stop_s = span_of(feed)
    assert (start_s, stop_s) == (T0 - 1.0, T0 + 9.0)
    recording = feed.load(no_sensors(), 1, Plan(start_s=start_s, period_s=2.0, cycles=5))
    cut = [recording.reports.between(start_s + 2 * c, start_s + 2 * c + 2) for c in range(5)]
    assert [len(part) for part in cut] == [2, 2, 2, 2, 2]
    assert (np.diff(np.concatenate([part.ais.received_s for part in cut])) == 1.0).all()


def feed_of(lines: int, seed: int = 3) -> list[str]:
    """Sentences of several stations with late stamps, duplicates, messages in two parts, damage and a jump of the clock."""
    rng = np.random.default_rng(seed)
    out: list[str] = []
    while len(out) < lines:
        i = len(out)
        stamp = T0 + 0.5 * i - (8.0 if rng.random() < 0.05 else 0.0) + (5000.0 if lines // 2 <= i < lines // 2 + 5 else 0.0)
        mmsi = 257000001 + int(rng.integers(50))
        kind = rng.random()
        if kind < 0.1:
            parts = wire({"msg_type": 5, "mmsi": mmsi, "shipname": f"SHIP {mmsi % 100}"}, seq_id=i % 10)
        elif kind < 0.15:
            parts = [sentence(mmsi=mmsi)[0][: int(rng.integers(5, 40))]]
        else:
            parts = sentence(mmsi=mmsi, lat=59.0 + round(float(rng.random()), 3), second=60)
        out += [tagged(f"s:{i % 3},c:{stamp:.0f}", part) for part in parts]
        if rng.random() < 0.1:
            out += [tagged(f"s:9,c:{stamp:.0f}", part) for part in parts]
    return out


@pytest.mark.parametrize("block", [25, 60, 200])
def test_blocks_give_the_reports_and_the_counts_of_the_whole_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    feed = Nmea(files=(write(tmp_path, feed_of(900)),))
    whole, statics, faults = read_all(feed)
    monkeypatch.setattr(nmea, "BLOCK", block)
    cut, cut_statics, cut_faults = read_all(feed)
    assert len(whole) > 500
    assert len(statics) > 30
    for got, needed in ((cut, whole), (cut_statics, statics)):
        for column in fields(needed):
            np.testing.assert_array_equal(getattr(got, column.name), getattr(needed, column.name))
    assert sorted((f.kind, f.count, f.where) for f in cut_faults) == sorted((f.kind, f.count, f.where) for f in faults)
    assert "time going backwards" in {f.kind for f in faults}


def test_a_cycle_needs_only_the_blocks_up_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nmea, "BLOCK", 20)
    lines = [tagged(f"c:{T0 + i:.0f}", sentence(mmsi=257000001 + i % 7, lat=10 + i / 1000)[0]) for i in range(1000)]
    lines.insert(500, "?? noise ??")
    stream = Nmea(files=(write(tmp_path, lines),)).stream()
    assert len(stream.between(-np.inf, T0 + 99.0)) == 100
    assert not stream.faults()  # line 501 has not been read
    assert len(stream.between(T0 + 499.0, T0 + 999.0)) == 500
    assert [f.where for f in stream.faults()] == ["feed.nmea:501"]


def test_the_span_of_a_long_file_is_read_at_both_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [f"{T0 + i:.0f} {sentence(mmsi=257000001, lat=i / 100)[0]}" for i in range(500)]
    packed = tmp_path / "feed.nmea.gz"
    packed.write_bytes(gzip.compress("\n".join(lines).encode()))
    monkeypatch.setattr(nmea, "BLOCK", 20)
    monkeypatch.setattr(nmea, "TAIL_BYTES", 2000)
    for file in (write(tmp_path, lines), packed):
        assert span_of(Nmea(files=(file,))) == (T0 - 1.0, T0 + 499.0)
    bare = write(tmp_path, [line.split(" ")[1] for line in lines])
    feed = Nmea(files=(bare,), assume_start_utc=ASSUMED, assume_interval_s=2.0)
    start_s, stop_s = span_of(feed)
    assert stop_s - start_s == 999.0


def test_a_run_that_starts_in_the_middle_of_a_file_takes_the_last_hour_before(tmp_path: Path) -> None:
    lines = [f"{T0 + 60 * i:.0f} {sentence(mmsi=257000001 + i % 9, lat=i / 10)[0]}" for i in range(180)]
    plan = Plan(start_s=T0 + 7200.0, period_s=60.0, cycles=5)
    recording = Nmea(files=(write(tmp_path, lines),)).load(no_sensors(), 1, plan)
    first = recording.of_first_cycle(plan.start_s, plan.instant_s(0)).ais
    assert (first.received_s.min() - T0, first.received_s.max() - T0) == (3660.0, 7260.0)
    everything = replace(recording, reports=Nmea(files=(write(tmp_path, lines),)).stream().between(-np.inf, np.inf))
    assert len(everything.of_first_cycle(plan.start_s, plan.instant_s(0))) == 122


PGHP = made_sentence("PGHP,1,2013,1,2,13,43,40,0,219,219,00,1,1C")
CAME_S = T0 + 5.0
ZDA = made_sentence("GPZDA,134338.00,02,01,2013,00,00")
TTM = made_sentence("RATTM,01,1.00,10.0,T,5.0,90.0,T,,,N,,T,,,A")


@pytest.mark.parametrize(
    ("lines", "wanted_s"),
    [
        (["{}", PGHP, "{}", "{}"], [CAME_S, T0 + 2.0, CAME_S]),
        (["{}", tagged(f"c:{T0 + 2.0:.0f}", ""), "{}", "{}"], [CAME_S, T0 + 2.0, CAME_S]),
        ([ZDA, "{}", "{}"], [T0, T0]),
        ([tagged("s:gyro", ZDA), "{}", PGHP, "{}", "{}"], [T0, T0 + 2.0, T0]),
        ([PGHP, ZDA, "{}", "{}"], [T0 + 2.0, T0]),
        ([ZDA, ZDA[:-2] + "00", "{}"], [T0]),  # a damaged clock sentence
    ],
)
@pytest.mark.parametrize("batch", [1, 2, 3, 9])
def test_sentences_of_a_feed_have_the_same_times_in_batches_of_every_size(
    lines: list[str], wanted_s: list[float], batch: int
) -> None:
    ais, targets = AisDecoder("live", 0, False), SentenceFeed("live", (b"TTM",), Tally(), Ledger())
    targets_s: list[float] = []
    for start in range(0, len(lines), batch):
        part = lines[start : start + batch]
        ais.decode([_item(line, sentence(mmsi=257000001 + start + k)[0]) for k, line in enumerate(part)], None)
        targets_s += [fed.time_s for fed in targets.sentences([_item(line, TTM) for line in part])]
    rows, _ = ais.due(-math.inf, math.inf)
    assert sorted(rows.stamp_s.tolist()) == sorted(wanted_s)
    assert targets_s == wanted_s


def _item(line: str, wanted: str) -> Item:
    return CAME_S, line.format(wanted).encode(), 0
