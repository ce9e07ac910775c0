"""Every reader uses a file to its last record, wherever it ends, and says what became of each record that it has read."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
import polars
import pytest
from hypothesis import given, settings, strategies as st
from nmea_sentences import T0, checked, sentence, tagged, wire
from spans import span_of

from coastwatch.batches import Radars, Recording, Sensors, Sonars, Stations, TrackSources
from coastwatch.errors import InputError
from coastwatch.formats.intake.accounts import UNACCOUNTED, UNUSED, accounts, losses
from coastwatch.formats.intake.faults import Tally
from coastwatch.sensors.recorded import files
from coastwatch.sensors.recorded.datasets.autoferry import Autoferry
from coastwatch.sensors.recorded.datasets.solent import FILE, Solent
from coastwatch.sensors.recorded.nmea import feed as nmea
from coastwatch.sensors.recorded.nmea.feed import Nmea
from coastwatch.sensors.recorded.tables import rows as table_rows
from coastwatch.sensors.recorded.tables.feed import Tables
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden

BLOCK = 16
SITE = np.array([59.5, 10.5])
EIGHT = settings(max_examples=40)


def sensors() -> Sensors:
    one = np.full(1, 20e3)
    radars = Radars(
        np.array(["a"], "U32"), np.zeros(1, np.int64), SITE[None], one, np.full(1, 3.0), np.full(1, 10.0), one / 1e6
    )
    sonars = Sonars(np.array(["s"], "U32"), SITE[None], one, one / 1e6, np.full(1, 3.0), np.zeros(1), np.full(1, 360.0))
    sources = TrackSources(np.array(["t"], "U32"), SITE[None], np.zeros(1), *np.ones((3, 1)))
    return Sensors(radars, Stations.empty(), sonars, ("west",), SITE[None], track_sources=sources)


def dollar(body: str) -> str:
    return f"${body}*{checked(body)}"


def position(k: int) -> str:
    return sentence(mmsi=257000001 + k, lat=10 + k / 100)[0]


HALVES = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"}, seq_id=4)
LINES: dict[str, Callable[[int], list[str]]] = {
    "position": lambda k: [tagged(f"c:{T0 + k:.0f}", position(k))],
    "other position": lambda k: [tagged(f"c:{T0 + k:.0f}", position(500 + k))],
    "again": lambda k: [tagged(f"c:{T0 + k:.0f}", position(0))],
    "two parts": lambda k: [tagged(f"g:{i + 1}-2-{k},c:{T0 + k:.0f}", half) for i, half in enumerate(HALVES)],
    "one half": lambda k: [tagged(f"g:1-2-{9000 + k},s:r{k},c:{T0 + k:.0f}", HALVES[0])],
    "name and position": lambda k: [
        tagged(f"c:{T0 + k:.0f}", one) for one in wire({"msg_type": 19, "mmsi": 257100000 + k, "lat": 10.0, "shipname": "B"})[:1]
    ],
    "both": lambda k: [
        tagged(f"g:{i + 1}-2-{4000 + k},c:{T0 + k:.0f}", one)
        for i, one in enumerate(wire({"msg_type": 19, "mmsi": 257100000 + k, "lat": 10.0, "shipname": "B"}))
    ],
    "base station": lambda k: [tagged(f"c:{T0 + k:.0f}", one) for one in wire({"msg_type": 4, "mmsi": 2570000, "lat": 10.0})],
    "no check sum": lambda k: [tagged(f"c:{T0 + k:.0f}", position(k))[:-1] + "x"],
    "no position": lambda k: [tagged(f"c:{T0 + k:.0f}", sentence(mmsi=257200000 + k, lat=91.0)[0])],
    "without a time": lambda k: [position(1000 + k)],
    "years later": lambda k: [tagged(f"c:{T0 + 1e8:.0f}", position(2000 + k))],
    "earlier": lambda k: [tagged(f"c:{T0 - 5000:.0f}", position(3000 + k))],
    "clock": lambda k: [dollar("GPZDA,134338.00,02,01,2013,00,00")],
    "own ship": lambda k: [dollar("GPRMC,134338,A,5930.0,N,01030.0,E,10.0,90.0,020113,,")],
    "wrong clock": lambda k: ["$GPZDA,134338.00,02,01,2013,00,00*00"],
    "gateway": lambda k: ["$PGHP,1,2013,1,2,13,43,38,0,257,,2190047,1,2B*2B"],
    "odd gateway": lambda k: ["$PGHP,1,x*00"],
    "depth": lambda k: [dollar("SDDBT,1.0,f,0.3,M,0.2,F")],
    "tag alone": lambda k: [tagged(f"c:{T0 + k:.0f}", "")],
    "tag without end": lambda k: ["\\c:1357134218*00"],
    "wrong tag": lambda k: [f"\\c:{T0 + k:.0f}*00\\{position(4000 + k)}"],
    "odd prefix": lambda k: [f"what {position(5000 + k)}"],
    "text": lambda k: ["hello"],
    "other": lambda k: ["!AIABK,257000001,A,6,0,0*3C"],
    "half a line": lambda k: ["!AIVDM,1,1,,A,13u"],
    "blank": lambda k: ["", "# a comment"],
}  # fmt: skip


def balance(contents: Any, faults: Any) -> None:
    assert losses(contents, faults, 0) == (), accounts(contents, faults)


@settings(max_examples=150)
@given(
    kinds=st.lists(st.sampled_from(sorted(LINES)), min_size=0, max_size=3 * BLOCK),
    blocks=st.integers(0, 3), past=st.integers(-1, 1), packed=st.booleans(), end=st.sampled_from(["", "\r\n"]),
    cuts=st.lists(st.integers(0, 70), max_size=4), order=st.sampled_from(["arrival", "time"]), own=st.booleans(),
)  # fmt: skip
def test_every_line_of_ais_is_in_a_report_or_counted_once(
    kinds: list[str], blocks: int, past: int, packed: bool, end: str, cuts: list[int], order: str, own: bool
) -> None:
    said = ["position", *kinds]
    said += ["other position"] * max(blocks * BLOCK + past - len(said), 0)
    lines = [line for k, kind in enumerate(said) for line in LINES[kind](k)]
    text = ("\r\n".join(lines) + end).encode("latin-1")
    with TemporaryDirectory() as folder, mock.patch.multiple(nmea, BLOCK=BLOCK, TAIL_BYTES=300):
        path = Path(folder) / "feed.nmea"
        path.write_bytes(gzip.compress(text) if packed else text)
        stream = Nmea(files=(path,), drop_own_ship=own, intake={"order": order}).stream()
        after_s, handed = -np.inf, 0
        for until_s in sorted(T0 + cut for cut in cuts):
            handed += len(stream.between(after_s, until_s))
            after_s = until_s
            balance(stream.contents(), stream.faults())
        handed += stream.rest(after_s)
        balance(stream.contents(), stream.faults())
        found = accounts(stream.contents(), stream.faults())
    content_lines = sum(bool(line.strip()) and not line.startswith("#") for line in lines)
    assert 0 <= found.read - content_lines <= said.count("both") + said.count("name and position")
    assert handed == found.in_reports + dict(found.beside).get(nmea.NAMES, 0)
    assert nmea.WAITING not in dict(found.beside)


@EIGHT
@given(
    kinds=st.lists(st.sampled_from(["target", "TLL", "lost", "odd", "own", "cut", "text", "old", "RATTM"]), max_size=40),
    packed=st.booleans(), end=st.sampled_from(["", "\n"]),
)  # fmt: skip
def test_every_sentence_of_targets_is_a_state_or_counted_once(kinds: list[str], packed: bool, end: str) -> None:
    made = {
        "target": lambda k: f"{T0 + k:.0f} " + dollar(f"RATTM,{k:02d},2.5,45.0,T,10.0,90.0,T,0.1,1.0,N,,T,,,A"),
        "TLL": lambda k: f"{T0 + k:.0f} " + dollar(f"RATLL,{k:02d},5930.0,N,01030.0,E,,134338.00,T,"),
        "lost": lambda k: f"{T0 + k:.0f} " + dollar(f"RATTM,{k:02d},2.5,45.0,T,10.0,90.0,T,0.1,1.0,N,,L,,,A"),
        "odd": lambda k: f"{T0 + k:.0f} " + dollar("RATTM,01,x,45.0,T"),
        "own": lambda k: f"{T0 + k:.0f} " + dollar("GPRMC,134338,A,5930.0,N,01030.0,E,10.0,90.0,020113,,"),
        "cut": lambda k: "$RATTM,01",
        "text": lambda k: "hello",
        "old": lambda k: f"{T0 - 5000:.0f} " + dollar("RATLL,01,5930.0,N,01030.0,E,,134338.00,T,"),
        "RATTM": lambda k: dollar("RATTM,01,2.5,45.0*45"),
    }
    said = ["target", *kinds, "target"]
    text = ("\n".join(made[kind](k) for k, kind in enumerate(said)) + end).encode()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "targets.nmea"
        path.write_bytes(gzip.compress(text) if packed else text)
        made_of = Tables(track_sentences=(path,)).load(sensors(), 0, PLAN)
    balance(made_of.contents, made_of.faults)
    assert made_of.contents[0].read == len(said)
    assert len(made_of.whole().tracks) == made_of.contents[0].records >= 1


PLAN = Plan(start_s=T0, period_s=10.0, cycles=10)
TABLES: dict[str, tuple[str, Callable[[int], str]]] = {
    "ais": ("time,mmsi,latitude,longitude,sog,cog,name", lambda k: f"{T0 + k:.1f},{257000001 + k % 7},{59 + k / 1e4},10.5,5,90,V{k % 3}"),
    "plots": ("time,range_m,azimuth", lambda k: f"{T0 + k:.1f},{1000 + k},45"),
    "bearings": ("time,bearing,contact", lambda k: f"{T0 + k:.1f},{k % 360},{k % 4}"),
    "tracks": ("time,track,latitude,longitude,sog,cog", lambda k: f"{T0 + k:.1f},{k % 5},{59 + k / 1e4:.4f},10.5,5,90"),
}  # fmt: skip
ODD: dict[str, Callable[[str], str]] = {
    "good": lambda row: row,
    "half": lambda row: row.partition(",")[0],
    "more": lambda row: row + ",1",
    "quote": lambda row: row + '"',
    "no time": lambda row: row[row.index(",") :],
    "text": lambda row: row.replace(row.split(",")[-1 if row.count(",") < 5 else 2], "x", 1),
    "inf": lambda row: ",".join(["inf" if k == 2 else cell for k, cell in enumerate(row.split(","))]),
    "far": lambda row: "1e8" + row[row.index(",") :],
    "again": lambda row: row + "\n" + row,
    "blank": lambda row: row + "\n\n  ",
}


@pytest.mark.parametrize("kind", TABLES)
@EIGHT
@given(
    odd=st.lists(st.sampled_from(sorted(ODD)), min_size=1, max_size=60), end=st.sampled_from(["", "\n", "\r\n", "\n\n"]),
    form=st.sampled_from(["csv", "csv.gz", "utf-16"]), past=st.integers(-2, 2),
)  # fmt: skip
def test_every_row_of_a_table_is_a_report_or_counted_once(kind: str, odd: list[str], end: str, form: str, past: int) -> None:
    header, row = TABLES[kind]
    text = (
        header
        + "\n"
        + row(0)
        + "\n"
        + "\n".join(ODD[what](row(k)) for k, what in enumerate(odd, 1))
        + "\n"
        + row(len(odd) + 1)
        + end
    )
    content = text.encode("utf-16" if form == "utf-16" else "utf-8")
    look = max(len(content) + past, 40) if form == "csv" else files.LOOK_BYTES
    with TemporaryDirectory() as folder, mock.patch.object(files, "LOOK_BYTES", look):
        path = Path(folder) / f"{kind}.csv"
        path.write_bytes(gzip.compress(content) if form == "csv.gz" else content)
        made = Tables(**{kind: (path,)}).load(sensors(), 0, PLAN)
    check_table(made, kind, sum(bool(line.strip()) for line in text.splitlines()) - 1)


def check_table(made: Recording, kind: str, rows: int) -> None:
    balance(made.contents, made.faults)
    reports, content = made.whole(), made.contents[0]
    assert content.read - rows <= len(reports.statics) + sum(fault.count for fault in made.faults)
    assert content.read == rows or kind == "ais"
    taken = {"ais": reports.ais, "plots": reports.radar, "bearings": reports.bearing, "tracks": reports.tracks}[kind]
    assert len(taken) == content.records
    assert taken.received_s[-1] == made.contents[0].last_s, "the last row is used"


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize("rows", [1, 2, 999, 1000, 1001])
@pytest.mark.parametrize("group", [None, 1000])
def test_every_row_of_parquet_is_a_report_or_counted_once(kind: str, rows: int, group: int | None, tmp_path: Path) -> None:
    header, row = TABLES[kind]
    cells = [row(k).split(",") for k in range(rows)]
    frame = polars.DataFrame({name: [one[k] for one in cells] for k, name in enumerate(header.split(","))})
    frame.write_parquet(tmp_path / "x.parquet", row_group_size=group)
    check_table(Tables(**{kind: (tmp_path / "x.parquet",)}).load(sensors(), 0, PLAN), kind, rows)


@pytest.mark.parametrize("rows", [9, 10, 11, 200])
def test_every_fix_of_the_solent_is_a_report_truth_or_counted_once(rows: int, tmp_path: Path) -> None:
    lines = ["time,mmsi,latitude,longitude,sog,cog,name"]
    for k in range(rows):
        jump = 0.2 if k % 50 == 30 else 0.0
        lines += [
            f"{T0 + 2 * k:.1f},{235000001 + v},{50.75 + v / 100 + jump:.5f},{-1.1 + k / 1e4:.5f},7,90,V{v}" for v in range(3)
        ]
    (tmp_path / FILE).write_bytes(gzip.compress("\n".join([*lines, "x", "1,2"]).encode()))
    feed = Solent(root=tmp_path, silence_mmsi=(235000002,), silence_from_s=5.0)
    made = feed.load(sensors(), 1, Plan(start_s=span_of(feed)[0], period_s=3.0, cycles=4))
    balance(made.contents, made.faults)
    (content,) = made.contents
    assert content.records == len(made.whole().ais)
    assert content.read >= 3 * rows + 2
    assert dict(content.beside)["fixes of the truth"] > 0
    assert dict(content.beside)["reports of AIS that is switched off"] > 0


@pytest.mark.parametrize("lidar", [False, True])
@pytest.mark.parametrize("cameras", [False, True])
def test_every_return_of_autoferry_is_a_report_or_counted_once(lidar: bool, cameras: bool, tmp_path: Path) -> None:
    folder = tmp_path / "scenario2"
    folder.mkdir()
    one = {1: [[1.0, 2.0], [3.0, 4.0]], 2: [[100.0, 0.0, 3.0], [50.0, 6.0, 7.0]], 3: [0.1, 0.2], 4: []}
    frames: list[Any] = [
        {"sensorID": 1 + k % 4, "time": T0 + k, "ownshipPosition": [0.0, 0.0], "measurement": one[1 + k % 4]} for k in range(21)
    ]
    frames += [{"sensorID": 9}, {**frames[0], "time": float("nan")}]
    (folder / "scenario2_detections.json.gz").write_bytes(gzip.compress(json.dumps(frames).encode()))
    truth = [{"targetID": 1, "time": T0 + k, "position": [10.0 + k, 5.0]} for k in range(21)]
    (folder / "scenario2_groundTruth.json.gz").write_bytes(gzip.compress(json.dumps(truth).encode()))
    made = Autoferry(scenario=2, root=tmp_path, use_lidar=lidar, use_cameras=cameras).load(sensors(), 0, PLAN)
    balance(made.contents, made.faults)
    assert made.contents[0].read == 6 * 2 + 5 * 3 + 5 * 2 + 2
    assert made.contents[0].records == len(made.whole())


def test_a_record_that_is_lost_is_found(tmp_path: Path) -> None:
    """The invariant fails where a reader loses records: planted defects in each of three readers."""
    path = tmp_path / "feed.nmea"
    path.write_text("\n".join(tagged(f"c:{T0 + k:.0f}", position(k)) for k in range(40)))

    def lossy(parts: Any, after_s: float, until_s: float) -> Any:
        taken, later, older = SPLIT(parts, after_s, until_s)
        return [part.take(np.arange(len(part) - 1)) for part in taken], later, older

    with mock.patch.object(nmea, "_split", lossy), mock.patch.object(nmea, "BLOCK", BLOCK):
        stream = Nmea(files=(path,)).stream()
        stream.between(-np.inf, np.inf)
    (fault,) = losses(stream.contents(), stream.faults(), 0)
    assert (fault.kind, fault.count) == (UNACCOUNTED, 3)

    header, row = TABLES["plots"]
    table = tmp_path / "plots.csv"
    table.write_text("\n".join([header, *map(row, range(9))]))
    with mock.patch.object(Tally, "add_rows"):
        cells = table.read_text().replace("1003", "x")
        table.write_text(cells)
        made = Tables(plots=(table,)).load(sensors(), 0, PLAN)
    (fault,) = losses(made.contents, made.faults, 7)[:1]
    assert (fault.kind, fault.count) == (UNACCOUNTED, 1)
    assert losses(made.contents, made.faults, 7)[1].kind == UNUSED
    assert table_rows.NAMES == nmea.NAMES


SPLIT = nmea.__dict__["_split"]


def test_a_file_whose_records_are_all_set_aside_says_why(tmp_path: Path) -> None:
    file = tmp_path / "base.csv"
    rows = "".join(f"002190001,2024-05-06 12:00:{s:02d},55.1,10.3,Base Station\n" for s in (0, 10))
    file.write_text(f"mmsi,time,lat,lon,class\n{rows}", "utf-8")
    with pytest.raises(
        InputError, match=r"needed at least one: 2 set aside: coast station \(first at base\.csv:2: MMSI 2190001 "
    ):
        span_of(Tables(ais=(file,)))
