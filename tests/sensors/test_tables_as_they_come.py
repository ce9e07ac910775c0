"""Tables as other programs write them: texts for no value, years of two digits, letters of hemispheres, numbers with cut digits."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from coastwatch.batches import NavStatus, PositionAccuracy, Sensors, Sonars, TrackSources
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.sensors.recorded.files import has_sentences
from coastwatch.sensors.recorded.tables.ais import AisTable
from coastwatch.sensors.recorded.tables.feed import NO_SENSORS, PlotColumns, Tables
from coastwatch.sensors.recorded.tables.reader import read_table
from coastwatch.sensors.recorded.tables.rows import find_columns, numbers_of_names
from coastwatch.sensors.recorded.tables.static_data import UNKNOWN_TYPE
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden

T0 = 1_452_603_731
HEADER = "Time,MMSI,Latitude,Longitude,SOG,COG"


def table(path: Path, *rows: str, header: str = HEADER) -> Path:
    file = path / "table.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


@pytest.mark.parametrize("text", ["NULL", "null", "None", "N/A", "NA", "-", "--", "?", "nan", "", " "])
def test_a_text_for_no_value_leaves_the_position(tmp_path: Path, text: str) -> None:
    rows = [f"{1_452_603_731 + 10 * k},235070762,50.7,-1.1,5,{text}" for k in range(3)]
    reports, _, faults = AisTable(files=(table(tmp_path, *rows),)).read()
    assert len(reports) == 3
    assert np.isnan(reports.cog_deg).all() or (reports.cog_deg >= 360.0).all()
    assert reports.sog_kn.tolist() == [5.0] * 3
    assert faults == ()
    rows = [f"1452603731,235070762,{text},-1.1,5,90", "1452603741,235070762,50.7,-1.1,5,90"]
    reports, _, (fault,) = AisTable(files=(table(tmp_path, *rows),)).read()
    assert (len(reports), fault.count) == (1, 1)


@pytest.mark.parametrize(
    "stamp", ["12/01/16 13:02", "31/01/16 13:02:11", "12.01.16 13:02:11", "16-01-12 13:02:11", "16-01-12T13:02"]
)
def test_a_year_of_two_digits_is_refused_with_the_patterns_that_read_it(tmp_path: Path, stamp: str) -> None:
    """It was read as the year 12, 16 or 31, and nothing was left."""
    file = table(tmp_path, f"{stamp},235070762,50.7,-1.1,5,90")
    with pytest.raises(
        InputError, match=r"column Time: got '.*', whose year has two digits: .*time_format=\"%d/%m/%y %H:%M:%S\""
    ):
        AisTable(files=(file,)).read()
    if stamp == "31/01/16 13:02:11":
        reports, _, _ = AisTable(files=(file,), time_format="%d/%m/%y %H:%M:%S").read()
        assert reports.received_s.tolist() == [1_454_245_331.0]


def test_twelve_hours_are_in_the_pattern_that_is_proposed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="%I:%M:%S %p"):
        AisTable(files=(table(tmp_path, "01/12/2016 01:02:11 PM,235070762,50.7,-1.1,5,90"),)).read()


@pytest.mark.parametrize("names", ["lat,ns,lon,ew", "latitude,lat_hemisphere,longitude,lon_hemisphere", "Lat,N/S,Lon,E/W"])
def test_letters_of_hemispheres_give_the_signs(tmp_path: Path, names: str) -> None:
    rows = ["1452603731,235070762,50.7,N,1.1,W", "1452603741,235070763,33.5,S,18.4,e", "1452603751,235070764,33.5,,18.4,"]
    given = AisTable(files=(table(tmp_path, *rows, header=f"time,mmsi,{names}"),))
    reports, _, faults = given.read()
    assert reports.position_deg.tolist() == [[50.7, -1.1], [-33.5, 18.4], [33.5, 18.4]]
    assert faults == ()
    assert given.contents()[0].ignored == ()


def test_an_mmsi_whose_digits_a_spreadsheet_has_cut_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"table\.csv:2, column MMSI: got '2.350708e\+08', a number whose digits a spreadsheet has cut"
    ):
        AisTable(files=(table(tmp_path, "1452603731,2.350708e+08,50.7,-1.1,5,90"),)).read()


def test_courses_from_minus_180_to_180_are_those_of_a_full_circle(tmp_path: Path) -> None:
    courses = [-170.0, -90.0, -0.5, 0.0, 45.0, 179.0] * 20
    given = AisTable(
        files=(
            table(
                tmp_path,
                *(f"{1_452_603_731 + 10 * k},235070762,{50.7 + 3e-4 * k:.4f},-1.1,5,{c}" for k, c in enumerate(courses)),
            ),
        )
    )
    reports, _, faults = given.read()
    assert reports.cog_deg.tolist() == [course % 360.0 for course in courses]
    assert faults == ()
    assert given.contents()[0].notes == ("COG from -180 to 180 degrees: 360 is added to what is negative",)


def test_one_wrong_cell_among_others_loses_its_row_alone(tmp_path: Path) -> None:
    rows = [f"2016-01-12 13:02:1{k},23507076{k},50.7{k},-1.1,5,90" for k in range(6)]
    rows += ["12/01/16 13:02:17,235070767,50.7,-1.1,5,90", "2016-01-12 13:02:18,2.350708e+08,50.7,-1.1,5,90"]
    reports, _, faults = AisTable(files=(table(tmp_path, *rows),)).read()
    assert len(reports) == 6
    assert {fault.kind: fault.count for fault in faults} == {"unparsable cell": 2}


@pytest.mark.parametrize(
    ("above", "separator"),
    [
        (
            [
                "# positions of the VTS, 12 January 2016",
                "# time, position, speed and course, all in UTC, of class A and B, no statics",
            ],
            ",",
        ),
        (["Export", "", "made on 12 January 2016"], ";"),
        (["sep=;"], ";"),
        (["\ufeffsep=;"], ";"),
        ([], ";"),
    ],
)
def test_titles_and_comments_above_the_header_are_passed_over(tmp_path: Path, above: list[str], separator: str) -> None:
    rows = [f"{1452603731 + 10 * k},235070762,50.7{k},-1.1,5,90" for k in range(3)]
    lines = [*above, *(line.replace(",", separator) for line in (HEADER, *rows))]
    if separator == ";":
        lines = [*lines[: len(above) + 1], *(line.replace(".", ",") for line in lines[len(above) + 1 :])]  # decimal commas
    file = tmp_path / "table.csv"
    file.write_text("\n".join(lines) + "\n", "utf-8")
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.position_deg.tolist() == [[50.7, -1.1], [50.71, -1.1], [50.72, -1.1]]
    assert faults == ()


def test_the_header_of_the_danish_authority_begins_with_a_comment_mark(tmp_path: Path) -> None:
    file = table(tmp_path, "12/01/2016 13:02:11,235070762,50.7,-1.1,5,90", header="# Timestamp,MMSI,Latitude,Longitude,SOG,COG")
    assert len(AisTable(files=(file,)).read()[0]) == 1


def test_names_without_a_position_are_refused_as_a_file_without_records(tmp_path: Path) -> None:
    """The check of gaps ended in a traceback: it had no file."""
    file = table(tmp_path, *(f"{T0 + 9 * k},235070762,91,181,,,SHIP" for k in range(3)), header=f"{HEADER},Name")
    with pytest.raises(InputError, match="got no usable record, needed at least one: 3 position not available"):
        Tables(ais=(file,)).span(lambda: NO_SENSORS, 0.0, to_the_end=True)


@pytest.mark.parametrize(
    ("texts", "wanted"),
    [(("VHF2", "VHF1", "", "VHF2"), [2, 1, -1, 2]), (("7", "3", "-", "7.0"), [7, 3, -1, 7])],
)
def test_a_contact_of_a_bearing_is_a_number_or_a_text(tmp_path: Path, texts: tuple[str, ...], wanted: list[int]) -> None:
    """A text lost every row."""
    file = table(tmp_path, *(f"{T0 + k},{10 * k},{text}" for k, text in enumerate(texts)), header="time,bearing,contact")
    one = np.ones(1)
    sonars = Sonars(np.array(["df"], "U32"), np.array([[50.8, -1.1]]), 1e4 * one, 0.02 * one, one, 0.0 * one, 360.0 * one)
    recording = Tables(bearings=(file,)).load(replace(NO_SENSORS, sonars=sonars), 1, Plan(start_s=T0, period_s=3.0, cycles=1))
    assert recording.faults == ()
    assert recording.reports.bearing.contact.tolist() == wanted


def test_the_class_of_marine_cadastre_is_read_as_it_is_misspelt(tmp_path: Path) -> None:
    rows = (f"{T0 + 9 * k},23507076{k},50.7,-1.1,5,90,{c}" for k, c in enumerate("AB"))
    reports, _, _ = AisTable(files=(table(tmp_path, *rows, header=f"{HEADER},TranscieverClass"),)).read()
    assert reports.class_b.tolist() == [False, True]


@pytest.mark.parametrize("name", ["msgtime", "date_time_utc", "BaseDateTime", "base_date_time"])
def test_the_time_of_other_authorities(tmp_path: Path, name: str) -> None:
    file = table(tmp_path, "2016-01-12T13:02:11,235070762,50.7,-1.1,5,90", header=HEADER.replace("Time", name))
    assert AisTable(files=(file,)).read()[0].time_s.tolist() == [T0]


def test_a_contact_that_is_no_number_is_none_and_the_others_stay_what_they_are(tmp_path: Path) -> None:
    file = tmp_path / "b.csv"
    file.write_text("time,contact,bearing\n" + "".join(f"{T0 + k},{c},5\n" for k, c in enumerate(("nan", "7.0", "nan", "9"))))
    number, empty = numbers_of_names(read_table(file, "auto", Tally()), "contact")
    assert (number.tolist(), empty.tolist()) == ([-1, 7, -1, 9], [True, False, True, False])


def test_times_of_plots_may_begin_at_0(tmp_path: Path) -> None:
    file = tmp_path / "p.csv"
    file.write_text("time,received,range_m,azimuth\n" + "".join(f"{k},{k + 20},1000,{k}\n" for k in range(30)))
    assert find_columns(read_table(file, "auto", Tally()), "plots", PlotColumns())["time"] == "time"


def test_a_helicopter_keeps_its_speed_in_a_table_of_tracks(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text(f"track,time,lat,lon,sog,cog\n1,{T0},50.7,-1.1,150,90\n1,{T0 + 1},50.7,-1.1,230,90\n")
    source = TrackSources(np.array(["t"], "U32"), np.full((1, 2), np.nan), *np.full((4, 1), np.nan))
    tracks = (
        Tables(tracks=(file,))
        .load(replace(NO_SENSORS, track_sources=source), 1, Plan(start_s=T0 - 1.0, period_s=3.0, cycles=2))
        .reports.tracks
    )
    assert tracks.velocity_m_s[0] == pytest.approx([150.0 * 1852.0 / 3600.0, 0.0])
    assert np.isnan(tracks.velocity_m_s[1]).all()


def test_static_data_that_a_row_leaves_out_stay(tmp_path: Path) -> None:
    """Each row without them, or with "Unknown" as call sign, was a new vessel's name and size, and the other way round."""
    said = ["OX1,SHIP,Cargo,20", "Unknown,,Undefined,", "OX1,SHIP,Cargo,20", "Unknown,,Undefined,", "OX1,SHIP,Tanker,20"]
    other = ["Unknown,Unknown,Undefined,", "n/a,,Submarine,12", "-,NEW,,"]
    rows = [f"{T0 + 9 * k},235070762,50.7{k},-1.1,5,90,{text}" for k, text in enumerate(said)]
    rows += [f"{T0 + 9 * k + 1},235070763,50.8{k},-1.1,5,90,{text}" for k, text in enumerate(other)]
    rows.sort()
    _, statics, faults = AisTable(files=(table(tmp_path, *rows, header=f"{HEADER},Callsign,Name,Ship type,Length"),)).read()
    assert {fault.kind: fault.count for fault in faults} == {UNKNOWN_TYPE: 1}
    of_vessel = zip(statics.mmsi.tolist(), statics.name, statics.call_sign, statics.ship_type, statics.length_m, strict=True)
    assert [row for row in of_vessel if row[0] == 235070762] == [
        (235070762, "SHIP", "OX1", 70, 20.0),
        (235070762, "SHIP", "OX1", 80, 20.0),
    ]
    of_vessel = zip(statics.mmsi.tolist(), statics.name, statics.call_sign, statics.length_m, strict=True)
    assert [row for row in of_vessel if row[0] == 235070763] == [(235070763, "", "", 12.0), (235070763, "NEW", "", 12.0)]


@pytest.mark.parametrize(
    ("word", "code"),
    [
        ("Fishing", 30),
        ("Towing long/wide", 32),
        ("SAR", 51),
        ("tanker", 80),
        ("37.0", 37),
        ("Cargo, all ships of this type", 70),
        ("Cargo - Hazard A (Major)", 70),
        ("Fishing vessel", 30),
        ("High speed craft", 40),
    ],
)
def test_types_of_ships_in_words_are_codes(tmp_path: Path, word: str, code: int) -> None:
    row = f'{T0},235070762,50.7,-1.1,5,90,"{word}"'
    _, statics, faults = AisTable(files=(table(tmp_path, row, header=f"{HEADER},Ship type"),)).read()
    assert (statics.ship_type.tolist(), faults) == ([code], ())


@pytest.mark.parametrize("other", ["timestampExternal", "Time", "received"])
def test_a_second_of_the_minute_is_no_time_beside_another_column(tmp_path: Path, other: str) -> None:
    """Digitraffic: the reports were of 1970."""
    rows = [f"235070762,5,90,0,true,false,{(T0 + 9 * k) % 60},{1000 * (T0 + 9 * k)},-1.1,50.7{k}" for k in range(3)]
    header = f"mmsi,sog,cog,navStat,posAcc,raim,timestamp,{other},lon,lat"
    reports, _, _ = AisTable(files=(table(tmp_path, *rows, header=header),)).read()
    assert reports.time_s.tolist() == reports.received_s.tolist() == [T0, T0 + 9, T0 + 18]
    assert reports.nav_status.tolist() == [NavStatus.UNDER_WAY_USING_ENGINE] * 3
    assert reports.accuracy.tolist() == [PositionAccuracy.HIGH] * 3
    alone = [row.replace(f",{1000 * (T0 + 9 * k)},", ",") for k, row in enumerate(rows)]
    reports, _, _ = AisTable(files=(table(tmp_path, *alone, header=header.replace(f",{other}", "")),)).read()
    assert (reports.received_s < 64.0).all()


def sources_of(*names: str) -> Sensors:
    n = len(names)
    sources = TrackSources(np.array(names, "U32"), np.full((n, 2), np.nan), *np.full((4, n), np.nan))
    return replace(NO_SENSORS, track_sources=sources)


def test_the_error_of_unknown_sources_of_tracks_says_how_they_become_known(tmp_path: Path) -> None:
    rows = [f"{T0 + 9 * k},{k},50.7,-1.1,{name}" for k, name in enumerate(("gfw", "vms", "gfw"))]
    tracks, plan = (
        Tables(tracks=(table(tmp_path, *rows, header="time,track,lat,lon,source"),)),
        Plan(start_s=T0, period_s=3.0, cycles=1),
    )
    known = """--set 'track_sources=[{name="gfw"}, {name="vms"}]' makes them known (in a scenario: [[track_sources]])"""
    with pytest.raises(InputError, match=f"'gfw', 'vms', needed one of table: {re.escape(known)}"):
        tracks.load(sources_of("table"), 1, plan)
    assert tracks.load(sources_of("gfw", "vms"), 1, plan).reports.tracks.sensor.tolist() == [0, 1, 0]
    with pytest.raises(InputError, match=re.escape("""[{name="a"}, {name="b"}, {name="gfw"}, {name="vms"}]""")):
        tracks.load(sources_of("a", "b"), 1, plan)


@pytest.mark.parametrize("name", ["ais.geoparquet", "ais.pq", "ais"])
def test_parquet_is_known_by_its_first_bytes(tmp_path: Path, name: str) -> None:
    """With another ending it was refused as bytes that are not text."""
    cells = {"time": [T0, T0 + 9, T0 + 18], "mmsi": [235070762] * 3, "lat": [50.7, 50.71, 99.0], "lon": [-1.1] * 3}
    pl.DataFrame(cells | {"geometry": [b"\x01"] * 3}).write_parquet(tmp_path / name)
    reports, _, (fault,) = AisTable(files=(tmp_path / name,)).read()
    assert (len(reports), fault.first) == (2, f"{name}, row 3: MMSI 235070762 latitude 99 longitude -1.1 SOG nan COG nan")
    assert not has_sentences(tmp_path / name, "ais")


@pytest.mark.parametrize(
    ("lacking", "free", "cells", "proposed"),
    [
        ("mmsi", "ship", "235070762", "ship"),
        ("mmsi", "ship", "1f0c-77aa", "NAME"),
        ("lat", "geometry", "POINT(1 2)", "NAME"),
        ("time", "at", "2016-01-12 13:02:11", "at"),
        ("time", "at", "Dover", "NAME"),
        ("track", "ident", "1f0c-77aa", "ident"),
    ],
)
def test_the_only_free_column_is_proposed_if_it_may_hold_what_is_needed(
    tmp_path: Path, lacking: str, free: str, cells: str, proposed: str
) -> None:
    values = {"time": str(T0), "track" if lacking == "track" else "mmsi": "235070762", "lat": "50.7", "lon": "-1.1"}
    values = {key: value for key, value in values.items() if key != lacking} | {free: cells}
    file = table(tmp_path, ",".join(values.values()), header=",".join(values))
    key = {"lat": "latitude"}.get(lacking, lacking)
    given = Tables(tracks=(file,)) if lacking == "track" else Tables(ais=(file,))
    with pytest.raises(InputError, match=rf"--columns \w+\.{key}={proposed} names yours"):
        given.load(sources_of("table"), 1, Plan(start_s=T0, period_s=3.0, cycles=1))
