"""Tables of AIS, plots and bearings: any names of columns, every kind of bad row, and the Solent table with its README's counts."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pydantic import TypeAdapter, ValidationError
from spans import span_of

from coastwatch.batches import Fault, Radars, Sensors, Sonars, Stations, TrackSources
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, from_plane
from coastwatch.sensors import Feed
from coastwatch.sensors.recorded.tables.ais import AisTable, wrapped_cog
from coastwatch.sensors.recorded.tables.feed import Tables
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden

DATA = Path(__file__).parents[2].parent / "shared" / "data"
T0 = 1_452_603_731.0  # 2016-01-12 13:02:11 UTC
PLAN = Plan(start_s=T0, period_s=3.0, cycles=10)
METRES = 0.05  # the plane at the radar against the ellipsoid, 5 km out
HEADER = "Time,MMSI,Latitude,Longitude,SOG,COG"


def table(path: Path, *rows: str, header: str = HEADER) -> Path:
    file = path / "table.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def row(t: float = 0.0, mmsi: str = "235070762", lat: str = "50.7", lon: str = "-1.1", sog: str = "5", cog: str = "90") -> str:
    return f"{T0 + t},{mmsi},{lat},{lon},{sog},{cog}"


def kinds(faults: tuple[Fault, ...]) -> dict[str, int]:
    return {f.kind: f.count for f in faults}


def sensors() -> Sensors:
    one = np.ones(2)
    names = np.array(["north", "south"], "U32")
    site = np.array([[50.8, -1.1], [50.7, -1.1]])
    radars = Radars(names, np.zeros(2, np.int64), site, 2e4 * one, 3.0 * one, 10.0 * one, 0.005 * one)
    sonars = Sonars(np.array(["hull", "mast"], "U32"), site, 1e4 * one, 0.02 * one, one, 0.0 * one, 360.0 * one)
    return Sensors(radars, Stations.empty(), sonars, ("region",), site[:1])


@pytest.mark.parametrize(
    "stamp",
    [
        "1452603731",
        "1452603731.000",
        "1452603731000",
        "2016-01-12 13:02:11",
        "2016-01-12T13:02:11Z",
        "2016-01-12T14:02:11.000+01:00",
        "2016-01-12 14:02:11+0100",
        "20160112T130211Z",
        "20160112130211",
        "12.01.2016 13:02:11",
        "2016/01/12 13:02:11.000",
        "12-Jan-2016 13:02:11",
    ],
)
def test_every_way_to_write_a_time(tmp_path: Path, stamp: str) -> None:
    reports, _, faults = AisTable(files=(table(tmp_path, f"{stamp},235070762,50.7,-1.1,5,90"),)).read()
    assert reports.received_s.tolist() == [T0]
    assert not faults


def test_a_pattern_of_time_may_be_given(tmp_path: Path) -> None:
    file = table(tmp_path, "13:02:11 12.01.2016,235070762,50.7,-1.1,5,90")
    assert AisTable(files=(file,), time_format="%H:%M:%S %d.%m.%Y").read()[0].received_s.tolist() == [T0]
    with pytest.raises(
        ValueError, match=r"table\.csv:2, column Time: got '13:02:11 12\.01\.2016', which is no time: .*time_format"
    ):
        AisTable(files=(file,)).read()


@pytest.mark.parametrize("cells", ["2016-01-12,13:02:11", "12.01.2016,13:02:11.000", "2016-01-12,14:02:11+01:00"])
def test_a_date_beside_a_time_of_day_is_joined_with_it(tmp_path: Path, cells: str) -> None:
    file = table(tmp_path, f"{cells},235070762,50.7,-1.1,5,90", header=f"Date,{HEADER}")
    reports, _, faults = AisTable(files=(file,)).read()
    assert (reports.received_s.tolist(), faults) == ([T0], ())
    alone = table(tmp_path, f"{cells},235070762,50.7,-1.1,5,90", header=f"Day,{HEADER}")
    with pytest.raises(InputError, match=r"got '1.:02:11.*', which is no time: needed a date too, .*a column `date`"):
        AisTable(files=(alone,)).read()


def test_longitudes_that_count_to_360_are_west_beyond_180_and_one_wrong_cell_is_not(tmp_path: Path) -> None:
    file = table(tmp_path, *(row(3.0 * k, lon=lon) for k, lon in enumerate(("179.5", "180.5", "358.9"))), row(9.0, lon="181"))
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.position_deg[:, 1].tolist() == pytest.approx([179.5, -179.5, -1.1])
    assert kinds(faults) == {"position not available": 1}
    wrong = table(tmp_path, row(lon="1.1"), row(3.0, lon="200"))
    assert kinds(AisTable(files=(wrong,)).read()[2]) == {"longitude out of range": 1}
    both = table(tmp_path, row(lon="-1.1"), row(3.0, lon="200"), row(6.0, lon="201"))
    assert kinds(AisTable(files=(both,)).read()[2]) == {"longitude out of range": 2}


@pytest.mark.parametrize(
    ("header", "stamps", "second"),
    [
        ("Time", ("12/01/2016 13:02:11", "13/01/2016 13:02:11"), T0),
        ("Time", ("01/12/2016 1:02:11 PM", "01/13/2016 1:02:11 PM"), T0),
        ("# Timestamp", ("12/01/2016 13:02:11", "12/01/2016 13:02:12"), T0),
    ],
)
def test_dates_with_slashes_are_read_as_the_whole_column_shows(
    tmp_path: Path, header: str, stamps: tuple[str, ...], second: float
) -> None:
    file = table(tmp_path, *(f"{s},235070762,50.7,-1.1,5,90" for s in stamps), header=HEADER.replace("Time", header))
    assert AisTable(files=(file,)).read()[0].received_s[0] == second


def test_dates_that_may_be_day_or_month_first_are_refused(tmp_path: Path) -> None:
    file = table(tmp_path, "03/04/2026 13:02:11,235070762,50.7,-1.1,5,90")
    with pytest.raises(
        ValueError, match=r"table\.csv, column Time: got '03/04/2026 13:02:11', which may be day first or month"
    ):
        AisTable(files=(file,)).read()


def test_times_without_a_zone_are_noted_once(tmp_path: Path) -> None:
    for stamp, notes in (("12.01.2016 13:02:11", ("times have no zone: taken as UTC",)), ("2016-01-12T13:02:11Z", ())):
        feed = AisTable(files=(table(tmp_path, f"{stamp},235070762,50.7,-1.1,5,90"),))
        assert [file.notes for file in feed.load(sensors(), 1, PLAN).contents] == [notes]


@pytest.mark.parametrize(
    ("separator", "point", "encoding"),
    [(";", ",", "utf-8"), (";", ".", "utf-8-sig"), ("\t", ".", "utf-16"), ("|", ".", "latin-1"), (",", ".", "utf-16")],
)
def test_separator_decimal_sign_and_encoding_are_found(tmp_path: Path, separator: str, point: str, encoding: str) -> None:
    line = row(0, sog="5.5").replace(",", separator).replace(".", point)
    file = tmp_path / "table.csv"
    file.write_text(f"{HEADER.replace(',', separator)}\n{line}\n", encoding)
    reports, _, faults = AisTable(files=(file,)).read()
    assert (reports.received_s.tolist(), reports.position_deg.tolist(), reports.sog_kn.tolist()) == (
        [T0],
        [[50.7, -1.1]],
        [5.5],
    )
    assert not faults


def test_a_column_that_is_there_twice_is_refused_if_it_is_used(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"table\.csv: got two columns 'Latitude', needed one"):
        AisTable(files=(table(tmp_path, row(0) + ",1", header=HEADER + ",Latitude"),)).read()
    assert len(AisTable(files=(table(tmp_path, row(0) + ",1,2", header=HEADER + ",note,note"),)).read()[0]) == 1


def test_columns_may_have_any_name_and_unit(tmp_path: Path) -> None:
    file = table(tmp_path, f"x;235070762;{T0};-1.1;50.7;10;S V;7;B", header="a;who;when;east;north;v;label;len;kind")
    columns = {
        "time": "when",
        "mmsi": "who",
        "latitude": "north",
        "longitude": "east",
        "sog": "v",
        "name": "label",
        "length": "len",
    }
    feed = AisTable(files=(file,), columns=columns | {"ais_class": "kind"}, separator=";", speed_unit="m/s")
    reports, statics, faults = feed.read()
    assert reports.position_deg.tolist() == [[50.7, -1.1]]
    np.testing.assert_allclose(reports.sog_kn, 10.0 * 3600.0 / 1852.0)
    assert np.isnan(reports.cog_deg).all()
    assert reports.class_b.all()
    assert (statics.name.tolist(), statics.length_m.tolist()) == (["S V"], [7.0])
    assert not faults


def test_a_column_that_is_not_there_is_named(tmp_path: Path) -> None:
    file = table(tmp_path, "1,2", header="Time,MMSI")
    with pytest.raises(
        ValueError, match=r"table\.csv: got columns Time, MMSI, needed one of latitude, lat.*--columns ais\.latitude="
    ):
        AisTable(files=(file,)).read()
    with pytest.raises(ValueError, match="needed 'nord'"):
        AisTable(files=(file,), columns={"latitude": "nord"}).read()


def test_every_kind_of_bad_row_is_counted_with_its_line_and_stops_nothing(tmp_path: Path) -> None:
    bad = {
        "set aside: duplicate": row(0),
        "half a line": row(1)[:32],
        "line with too many cells": row(1) + ",7",
        "quotation without end": row(1).replace("235070762", '"235070762'),
        "empty cell": row(1, lat=""),
        "unparsable cell": row(1, lon="west"),
        "non-finite": row(1, lat="nan"),
        "position not available": row(1, lat="91"),
        "latitude out of range, -85 to 85": row(1, lat="-95"),
        "longitude out of range": row(1, lon="200"),
        "not an MMSI": row(1, mmsi="-1"),
        "time going backwards": row(-100),
        "set aside: quick repeat of one position": row(1, sog="5.1"),
        "time far from the rest": row(-1e9),
    }
    file = table(tmp_path, row(0), *bad.values(), row(8, lat="50.701", cog="360"))
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.received_s.tolist() == [T0, T0 + 8.0]
    assert np.isnan(reports.cog_deg[1])
    assert kinds(faults) == dict.fromkeys(bad, 1)
    places = {f.kind: f.where.partition(",")[0] for f in faults}
    assert places == {kind: f"table.csv:{i}" for i, kind in enumerate(bad, 3)}
    assert next(f.where for f in faults if f.kind == "unparsable cell").endswith("column Longitude")


@pytest.mark.parametrize("value", ["inf", "-inf", "1e400"])
def test_infinite_speed_is_refused_and_empty_speed_is_not_available(tmp_path: Path, value: str) -> None:
    reports, _, faults = AisTable(files=(table(tmp_path, row(0, sog=value), row(3, sog="")),)).read()
    assert kinds(faults) == {"non-finite": 1}
    assert np.isnan(reports.sog_kn).tolist() == [True]


@pytest.mark.parametrize("order", ["by vessel", "newest first"])
def test_a_table_that_is_not_in_order_of_arrival_is_sorted_by_time(tmp_path: Path, order: str) -> None:
    rows = [row(t, mmsi=m, lat=f"50.{t:04d}") for m in ("235070762", "235070763") for t in range(0, 1000, 10)]
    rows = rows if order == "by vessel" else sorted(rows, reverse=True)
    file = table(tmp_path, *rows)
    reports, _, faults = AisTable(files=(file,)).read()
    assert len(reports) == 200
    assert not faults
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert AisTable(files=(file,)).contents()[0].notes == ("not in order of time: sorted by it (input.intake.order)",)
    as_it_stands = AisTable(files=(file,), intake={"order": "arrival"})
    reports, _, faults = as_it_stands.read()
    assert kinds(faults)["time going backwards"] == 200 - len(reports) > 90
    many = f"{200 - len(reports)} go back in time and are not used: --set input.intake.order=time sorts the file first"
    assert as_it_stands.contents()[0].notes == (many,)


def test_single_wrong_readings_of_a_clock_do_not_sort_a_table(tmp_path: Path) -> None:
    rows = [row(t if i % 10 else t - 3600.0, lat=f"50.{t:04d}") for i, t in enumerate(range(0, 1000, 10), 1)]
    reports, _, (fault,) = AisTable(files=(table(tmp_path, *rows),)).read()
    assert (fault.kind, fault.count) == ("time going backwards", 10)
    assert len(reports) == 90


def test_tables_of_plots_sorted_by_radar_are_sorted_by_time(tmp_path: Path) -> None:
    rows = [f"{T0 + t},{radar},5000,90" for radar in ("south", "north") for t in range(0, 600, 3)]
    feed = Tables(plots=(table(tmp_path, *rows, header="time,radar,range_m,azimuth_deg"),))
    recording = feed.load(sensors(), 1, PLAN)
    assert len(recording.whole().radar) == 400
    assert not recording.faults
    assert recording.contents[0].notes == ("not in order of time: sorted by it (input.intake.order)",)


def test_parquet_and_packed_csv_say_the_same_as_csv(tmp_path: Path) -> None:
    plain = table(tmp_path, *(row(3 * i, lat=f"50.7{i}") for i in range(9)))
    packed = tmp_path / "table.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    frame = pl.read_csv(plain)
    stamped = frame.with_columns(
        pl.from_epoch((pl.col("Time") * 1000).cast(pl.Int64), time_unit="ms").dt.replace_time_zone("UTC")
    )
    stamped.write_parquet(tmp_path / "table.parquet")
    want = AisTable(files=(plain,)).read()[0]
    for file in (packed, tmp_path / "table.parquet"):
        got = AisTable(files=(file,)).read()[0]
        for name in ("received_s", "position_deg", "mmsi", "sog_kn", "cog_deg"):
            np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


@pytest.mark.parametrize(
    ("name", "content"), [("empty.csv", b""), ("no.parquet", b"PAR?"), ("bad.csv.gz", b"\x1f\x8b\x08junkjunkjunk")]
)
def test_an_unreadable_file_is_named(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        AisTable(files=(tmp_path / name,)).read()


def test_a_header_alone_gives_nothing_and_is_said(tmp_path: Path) -> None:
    reports, statics, faults = AisTable(files=(table(tmp_path),)).read()
    assert (len(reports), len(statics), kinds(faults)) == (0, 0, {"table without a row under its header": 1})


TABLES = {
    "ais": "time,mmsi,lat,lon,sog,cog",
    "plots": "time,radar,range_m,azimuth_deg",
    "bearings": "time,sensor,bearing,track",
    "tracks": "time,track_id,lat,lon,sog,cog",
}


@pytest.mark.parametrize("given", TABLES)
@pytest.mark.parametrize("kind", TABLES)
def test_a_table_of_another_kind_is_refused_with_the_option_it_belongs_to(tmp_path: Path, kind: str, given: str) -> None:
    file = table(tmp_path, header=TABLES[kind])
    if kind == given:
        assert not len(Tables(**{given: (file,)}).load(sensors(), 1, PLAN).whole())
    else:
        with pytest.raises(
            ValueError, match=rf"table\.csv: given as .*, it is a table of .*: use --{kind} \(in a scenario: input"
        ):
            Tables(**{given: (file,)}).load(sensors(), 1, PLAN)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"!AIVDM,1,1,,A,33P;Tw0tjBQO22:E7dm66DrB20UP,0*2E\n", "it holds 1 VDM sentences of NMEA 0183 and no table: use --ais"),
        (b"PK\x03\x04....", "compressed by zip, .*: unpack it first"),
        (b'[{"mmsi": 1}]\n', "got JSON, needed a table in CSV or Parquet"),
        (b"<!DOCTYPE html>\n<html>\n", "got HTML or XML"),
        (b"\n \n", "got an empty file"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "plots.csv"
    file.write_bytes(content)
    with pytest.raises((OSError, ValueError), match=message):
        span_of(Tables(plots=(file,)))


def test_plots_polar_and_geodetic_are_the_same_place(tmp_path: Path) -> None:
    away = np.array([[3000.0, 4000.0], [-4000.0, 0.0]])
    polar, places = tmp_path / "polar.csv", tmp_path / "places.csv"
    polar.write_text(
        "time,radar,range_nm,azimuth_deg\n"
        f"{T0},north,{5000 / 1852},{np.degrees(np.arctan2(3, 4))}\n{T0 + 1},south,{4000 / 1852},-90\n"
    )
    at = from_plane(away, sensors().radars.site_deg)
    places.write_text(
        "time,radar,lat,lon\n" + "".join(f"{T0 + i},{n},{at[i, 0]},{at[i, 1]}\n" for i, n in enumerate(("north", "south")))
    )
    a, b = (Tables(plots=(f,)).load(sensors(), 1, PLAN).reports.radar for f in (polar, places))
    np.testing.assert_allclose(a.range_m, [5000.0, 4000.0])
    np.testing.assert_allclose(a.azimuth_deg, [36.8699, 270.0], atol=1e-4)
    np.testing.assert_allclose(b.range_m, a.range_m, atol=METRES)
    np.testing.assert_allclose(np.radians(b.azimuth_deg) * b.range_m, np.radians(a.azimuth_deg) * a.range_m, atol=METRES)
    assert a.sensor.tolist() == b.sensor.tolist() == [0, 1]
    np.testing.assert_array_equal(a.site_deg, sensors().radars.site_deg)


@pytest.mark.parametrize(
    ("factor", "swapped", "said"),
    [
        (1.0, False, None),
        (
            0.5144,
            False,
            "the positions move 1.94 times as fast as SOG says (median of 8 tracks): is it in m/s? --set input.speed_unit",
        ),
        (1.852, False, "the positions move 0.54 times as fast as SOG says (median of 8 tracks): is it in km/h?"),
        (0.95, False, None),
        (0.7, False, "the positions move 1.43 times as fast as SOG says (median of 8 tracks): in which unit is it? needed kn"),
        (1.0, True, "the positions of 8 tracks move as SOG and course say only with latitude and longitude exchanged"),
    ],
)
@pytest.mark.parametrize("part", ["tracks", "ais"])
def test_speeds_that_the_positions_do_not_have_are_doubted(
    part: str, factor: float, swapped: bool, said: str | None, tmp_path: Path
) -> None:
    rng, rows = np.random.default_rng([7, 1, 0]), []
    for step in range(30):
        course, speed_m_s = np.radians(40.0 * np.arange(8) + 2.0 * step), 4.0 + np.arange(8)
        metres = (
            5.0 * step * speed_m_s[:, None] * np.stack([np.sin(course - 0.03 * step), np.cos(course - 0.03 * step)], axis=-1)
        )
        place = from_plane(metres + rng.normal(0.0, 10.0, (8, 2)), np.array([50.8, -1.1]))
        place = place[:, ::-1] if swapped else place
        sog, cog = speed_m_s / KNOT_M_S * factor, np.degrees(course - 0.015 * step) % 360.0
        rows += [f"{T0 + 5 * step},{235000000 + k},{place[k, 0]},{place[k, 1]},{sog[k]},{cog[k]}" for k in range(8)]
    file = table(tmp_path, *rows, header="time,track,lat,lon,sog,cog" if part == "tracks" else HEADER)
    one = TrackSources(np.array(["t"], "U32"), np.full((1, 2), np.nan), *np.full((4, 1), np.nan))
    (content,) = Tables(**{part: (file,)}).load(replace(sensors(), track_sources=one), 1, PLAN).contents
    assert len(content.doubts) == (said is not None)
    assert said is None or content.doubts[0].startswith(said)


def test_velocities_in_knots_are_doubted(tmp_path: Path) -> None:
    rows = []
    for step, k in np.ndindex(30, 6):
        (place,) = from_plane(np.array([[10.0 * step * (k + 2), -20.0 * step * (k + 2)]]), np.array([50.8, -1.1]))
        rows.append(f"{T0 + 10 * step},{k},{place[0]},{place[1]},{(k + 2) / KNOT_M_S},{-2 * (k + 2) / KNOT_M_S}")
    file = table(tmp_path, *rows, header="time,track,lat,lon,ve,vn")
    one = TrackSources(np.array(["t"], "U32"), np.full((1, 2), np.nan), *np.full((4, 1), np.nan))
    (content,) = Tables(tracks=(file,), speed_unit="km/h").load(replace(sensors(), track_sources=one), 1, PLAN).contents
    wanted = "the positions move 0.51 times as fast as the velocity says (median of 6 tracks): is it in kn? needed m/s"
    assert content.doubts == (wanted,)


def test_bad_plots_and_bearings_are_counted(tmp_path: Path) -> None:
    plots, bearings = tmp_path / "plots.csv", tmp_path / "bearings.csv"
    plots.write_text(
        "time,received,radar,range_m,azimuth_deg,site_lat,site_lon\n"
        f"{T0},{T0 + 1},north,1000,10,,\n{T0},{T0 + 2},west,1000,10,,\n{T0},{T0 + 2},north,-5,10,,\n"
        f"{T0},{T0 + 2},north,1000,inf,,\n{T0},{T0 + 2},north,1000,400,,\n{T0},{T0 + 2},north,10\n{T0},{T0 + 3},south,1000,10,50.1,-1.2\n"
    )
    bearings.write_text(
        f"time,sonar,bearing_deg,contact\n{T0},hull,-10,4\n{T0 + 1},keel,5,\n{T0 + 2},mast,,\n"
        f"{T0 + 3},mast,370,\n{T0 + 4},mast,1,\n"
    )
    recording = Tables(plots=(plots,), bearings=(bearings,)).load(sensors(), 1, PLAN)
    radar, bearing = recording.reports.radar, recording.reports.bearing
    assert radar.received_s.tolist() == [T0 + 1.0, T0 + 3.0]
    assert radar.site_deg.tolist() == [[50.8, -1.1], [50.1, -1.2]]
    assert bearing.bearing_deg.tolist() == [350.0, 1.0]
    assert bearing.contact.tolist() == [4, -1]
    assert bearing.signature.tolist() == [-1, -1]
    assert {f.kind: (f.count, f.where.partition(",")[0]) for f in recording.faults} == {
        "half a line": (1, "plots.csv:7"),
        "non-finite": (1, "plots.csv:5"),
        "unknown radar": (1, "plots.csv:3"),
        "range out of range": (1, "plots.csv:4"),
        "angle out of range": (2, "plots.csv:6"),
        "empty cell": (1, "bearings.csv:4"),
        "unknown sonar": (1, "bearings.csv:3"),
    }
    assert next(f.example for f in recording.faults if f.kind == "unknown radar").startswith("west, known: ['north', 'south']")


def test_all_kinds_of_files_make_one_recording(tmp_path: Path) -> None:
    plots, wire = tmp_path / "plots.csv", tmp_path / "ais.nmea"
    plots.write_text(f"time,radar,range_m,azimuth_deg\n{T0 + 2},north,1000,10\n")
    wire.write_text("1452603734 !AIVDM,1,1,,B,14pWHb?P03rwO<F:RQOnROw<25bd,0*3E\n")
    feed = Tables(plots=(plots,), ais=(table(tmp_path, row(1)),), nmea=(wire,))
    assert span_of(feed) == (T0, T0 + 3.0)
    recording = feed.load(sensors(), 1, PLAN)
    taken = recording.reports.between(T0, T0 + 3.0)
    assert len(taken) == 3
    assert taken.ais.mmsi.tolist() == [235070762, 327801000]


def test_no_file_is_refused() -> None:
    with pytest.raises(ValidationError, match="got no file, needed at least one"):
        Tables()


def test_a_scenario_chooses_the_feed_by_its_method() -> None:
    feed = TypeAdapter(Feed).validate_python({"method": "ais_table", "files": ["a.csv"], "intake": {"lateness_s": 5}})
    assert isinstance(feed, AisTable)
    assert feed.intake.lateness_s == 5.0
    with pytest.raises(ValidationError, match=r"ais_table\.intake\.lateness"):
        TypeAdapter(Feed).validate_python({"method": "ais_table", "files": ["a.csv"], "intake": {"lateness": 5}})


def test_the_solent_table_has_the_counts_of_its_readme() -> None:
    file = DATA / "solent_ais" / "SolentAIS_20160112_130211.csv.gz"
    if not file.exists():
        pytest.skip(f"{file} is not on this machine")
    reports, _, faults = AisTable(files=(file,)).read()
    assert kinds(faults) == {"set aside: duplicate": 3, "set aside: quick repeat of one position": 85}
    assert len(reports) + 88 == 18_623
    assert len(np.unique(reports.mmsi)) == 91
    assert abs(float(reports.received_s[0]) - 1452603731.218) < 1e-3
    assert abs(float(reports.received_s[-1]) - 1452608801.924) < 1e-3
    assert float(np.diff(reports.received_s).max()) < 2.5


def test_classes_by_sound_in_a_table_of_bearings(tmp_path: Path) -> None:
    bearings = tmp_path / "bearings.csv"
    bearings.write_text(
        f"time,sonar,bearing_deg,signature\n{T0},hull,10,4\n{T0 + 1},hull,11,\n{T0 + 2},hull,12,7\n{T0 + 3},hull,13,0\n",
        "utf-8",
    )
    recording = Tables(bearings=(bearings,)).load(sensors(), 1, PLAN)
    assert recording.reports.bearing.signature.tolist() == [4, -1, -1, 0]


def test_values_that_no_message_can_hold_are_counted_by_kind(tmp_path: Path) -> None:
    file = tmp_path / "ais.csv"
    said = [
        ("12.0", "-1.0", "A"),
        ("102.3", "10.0", "B"),
        ("110", "20", "Ferry"),
        ("5", "360.0", ""),
        ("-3", "400", "class b"),
    ]
    lines = [f"{T0 + k},23507076{k},50.7,-1.2,{sog},{cog},{kind}" for k, (sog, cog, kind) in enumerate(said)]
    file.write_text("\n".join(["time,mmsi,lat,lon,sog,cog,class", *lines]) + "\n")
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.class_b.tolist() == [False, True, False, False, True]
    np.testing.assert_array_equal(reports.sog_kn, [12.0, np.nan, np.nan, 5.0, np.nan])
    np.testing.assert_array_equal(reports.cog_deg, [np.nan, 10.0, 20.0, np.nan, np.nan])
    assert {f.kind.removeprefix("set aside: "): (f.count, f.where) for f in faults} == {
        "unknown class, taken as class A": (1, "ais.csv:4, column class"),
        "SOG that no message can hold, taken as not available": (2, "ais.csv:4"),
        "COG that no message can hold, taken as not available": (2, "ais.csv:2"),
    }


COURSES = np.arange(0.0, 360.0, 5.0)


@pytest.mark.parametrize(
    ("courses", "missing"),
    [
        (np.where(COURSES >= 204.8, COURSES - 409.6, COURSES), 409.6),
        (np.append(np.where(COURSES >= 204.8, COURSES - 409.6, COURSES), -49.6), 409.6),
        (np.where(COURSES >= 180.0, COURSES - 360.0, COURSES), 360.0),
        (COURSES, 0.0),
        (np.append(COURSES, [-1.0, -7.0]), 0.0),
        (np.array([np.nan]), 0.0),
    ],
)
def test_courses_of_a_wrapped_field_are_said(courses: np.ndarray, missing: float) -> None:
    assert wrapped_cog(courses) == missing


def test_standard_deviations_of_plots_and_bearings_are_read(tmp_path: Path) -> None:
    plots, places, bearings = tmp_path / "plots.csv", tmp_path / "places.csv", tmp_path / "bearings.csv"
    plots.write_text(
        "time,radar,range_m,azimuth_deg,range_sigma_m,azimuth_sigma_deg\n"
        + "".join(f"{T0 + k},north,1000,10,{a},{b}\n" for k, (a, b) in enumerate([("7", "0.5"), ("", ""), ("0", "-1")]))
    )
    made = Tables(plots=(plots,)).load(sensors(), 1, PLAN)
    radar = made.whole().radar
    np.testing.assert_array_equal(radar.range_sigma_m, [7.0, np.nan, np.nan])
    np.testing.assert_array_equal(radar.azimuth_sigma_deg, [0.5, np.nan, np.nan])
    assert {f.kind.split(": ")[-1]: f.where for f in made.faults} == {"range": "plots.csv:4", "azimuth": "plots.csv:4"}
    site = sensors().radars.site_deg[0]
    east = from_plane(np.array([2000.0, 0.0]), site)
    places.write_text(
        "time,radar,lat,lon,covariance_east_east,covariance_east_north,covariance_north_north\n"
        f"{T0},north,{east[0]},{east[1]},100,3,1600\n"
    )
    radar = Tables(plots=(places,)).load(sensors(), 1, PLAN).whole().radar
    np.testing.assert_allclose(radar.range_sigma_m, 10.0, rtol=1e-3)
    np.testing.assert_allclose(np.radians(radar.azimuth_sigma_deg) * 2000.0, 40.0, rtol=1e-3)
    bearings.write_text(f"time,sonar,bearing_deg,bearing_sigma_deg\n{T0},mast,10,2.5\n{T0 + 1},mast,11,\n{T0 + 2},mast,12,0\n")
    bearing = Tables(bearings=(bearings,)).load(sensors(), 1, PLAN).whole().bearing
    np.testing.assert_array_equal(bearing.bearing_sigma_deg, [2.5, np.nan, np.nan])


def test_senders_that_are_no_vessel_are_set_aside_by_class_or_number(tmp_path: Path) -> None:
    said = [
        ("219000001", "Class A"),
        ("219000002", "Base Station"),
        ("219000003", "AtoN"),
        ("219000004", "SAR Airborne"),
        ("970123456", "Search and Rescue Transponder"),
        ("972123456", "Man Overboard Device"),
        ("2190001", ""),
        ("992190001", ""),
        ("111219001", ""),
        ("1193046", "Class B"),
        ("1073741823", "Class A"),
    ]
    file = tmp_path / "ais.csv"
    lines = [f"{T0 + k},{mmsi},55.{k},11,5,90,{kind}" for k, (mmsi, kind) in enumerate(said)]
    file.write_text("\n".join(["# Timestamp,MMSI,Latitude,Longitude,SOG,COG,Type of mobile", *lines]) + "\n")
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.mmsi.tolist() == [219000001, 970123456, 972123456, 1193046, 1073741823]
    assert kinds(faults) == {
        "set aside: coast station": 2,
        "set aside: aid to navigation": 2,
        "set aside: search and rescue aircraft": 2,
    }


def test_status_accuracy_and_covariance_of_a_row_are_read(tmp_path: Path) -> None:
    header = "time,mmsi,lat,lon,status,accuracy,raim,position_sigma_m,covariance_east_east,covariance_north_north"
    cells = [
        "At anchor,1,0,,,",
        "2,0,1,,,",
        "Restricted maneuverability,0,0,25,,",
        ",,,3,16,9",
        "Unknown value,high,,-4,,",
        "adrift,low,true,,,",
    ]
    file = tmp_path / "ais.csv"
    lines = [f"{T0 + k},21900000{k},55.{k},11,{cell}" for k, cell in enumerate(cells)]
    file.write_text("\n".join([header, *lines]) + "\n")
    reports, _, faults = AisTable(files=(file,)).read()
    assert reports.nav_status.tolist() == [1, 2, 3, -1, 15, -1]
    assert reports.accuracy.tolist() == [1, 2, 0, -1, 1, 2]
    np.testing.assert_array_equal(reports.covariance[2], 625.0 * np.eye(2))
    np.testing.assert_array_equal(reports.covariance[3], np.diag([16.0, 9.0]))
    assert np.isnan(reports.covariance[[0, 1, 4, 5]]).all()
    assert kinds(faults) == {
        "set aside: unknown navigational status, taken as not sent": 1,
        "set aside: no covariance of a position, that of the accuracy taken": 1,
    }
