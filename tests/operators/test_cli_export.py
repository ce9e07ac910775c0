"""Rows as table, CSV, GeoJSON and Parquet, and what the arguments of moments and boxes accept."""

import argparse
import csv
import io
import json
import math
from pathlib import Path
from typing import IO

import polars
import pytest
import termcolor

from coastwatch import store
from coastwatch.errors import InputError
from coastwatch.operators import columns, export, presentation
from coastwatch.operators.cli import arguments
from coastwatch.operators.selection import selected
from coastwatch.reproduction import html_report
from coastwatch.spelling import printable
from coastwatch.store import Rows
from coastwatch.store.schema.database import writing

pytestmark = pytest.mark.contract

SHIPS = Rows(
    ("vessel_id", "latitude_deg", "longitude_deg", "mmsi", "name"),
    [(1, -22.9, -43.1, "002320001", 'A "B", C'), (23, 10.5, 179.9, None, None), (4, float("nan"), float("nan"), None, "D")],
)


def test_a_table_aligns_and_shows_what_is_absent() -> None:
    lines = export.as_table(SHIPS).splitlines()
    assert lines[0].split() == list(SHIPS.columns)
    assert lines[2].startswith("        1    -22.900000     -43.100000")
    assert lines[3].split() == ["23", "10.500000", "179.900000", "-", "-"]
    assert "no rows" in export.as_table(Rows(("a",), []))
    assert export.as_table(Rows(("odds",), [(1.4592605e242,)])).split()[-1] == "1.459e+242"


def test_csv_reads_back() -> None:
    back = list(csv.reader(io.StringIO(export.as_csv(SHIPS))))
    assert back[0] == list(SHIPS.columns)
    assert back[1] == ["1", "-22.9", "-43.1", "002320001", 'A "B", C']
    assert back[3] == ["4", "", "", "", "D"]


def test_geojson_puts_longitude_first_and_nothing_where_there_is_no_position() -> None:
    features = json.loads(export.as_geojson(SHIPS))["features"]
    assert features[0]["geometry"] == {"type": "Point", "coordinates": [-43.1, -22.9]}
    assert features[0]["properties"] == {"vessel_id": 1, "mmsi": "002320001", "name": 'A "B", C'}
    assert [feature["id"] for feature in features] == [1, 23, 4]
    assert features[2]["geometry"] is None
    with pytest.raises(InputError, match="latitude_deg"):
        export.as_geojson(Rows(("stage", "median_ms"), [("tracks", 1.0)]))


@pytest.mark.parametrize("form", ["csv", "table", "parquet"])
def test_a_file_of_a_full_disk_is_named_and_as_it_was_before(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(output: Path, mode: str) -> IO[bytes]:
        return io.BufferedWriter(io.FileIO("/dev/full", "w"))

    old = tmp_path / "old"
    old.write_text("old")
    old.chmod(0o640)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        for path, kept in ((old, "the old file is kept"), (tmp_path / "new", "no file is left")):
            with pytest.raises(OSError, match=f"{path}: got a full disk, needed room for the file: {kept}"):
                export.write(SHIPS, form, str(path))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("old", "old")]
    (tmp_path / "link").symlink_to(old)
    export.write(SHIPS, form, str(tmp_path / "link"))
    assert old.read_bytes()[:3] != b"old"
    assert old.stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "link").is_symlink()


def test_parquet_keeps_types_and_needs_a_file(tmp_path: Path) -> None:
    path = tmp_path / "picture.parquet"
    export.write(SHIPS, "parquet", str(path))
    back = polars.read_parquet(path)
    assert back["vessel_id"].to_list() == [1, 23, 4]
    assert back.schema["latitude_deg"] == polars.Float64
    assert back["mmsi"].to_list() == ["002320001", None, None]
    with pytest.raises(InputError, match="--output"):
        export.write(SHIPS, "parquet", None)


def test_an_empty_picture_is_still_parquet(tmp_path: Path) -> None:
    path = tmp_path / "empty.parquet"
    export.write(Rows(SHIPS.columns, []), "parquet", str(path))
    assert polars.read_parquet(path).columns == list(SHIPS.columns)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1970-01-01T00:01:00Z", 60.0),
        ("1970-01-01T00:01:00", 60.0),
        ("1970-01-01T01:00:00+01:00", 0.0),
        ("1970-01-02", 86400.0),
    ],
)
def test_an_instant_without_a_zone_is_utc(text: str, seconds: float) -> None:
    assert arguments.utc(text) == seconds


def test_a_box_may_cross_the_antimeridian() -> None:
    assert arguments.box("-20,170,-10,-170") == (-20.0, 170.0, -10.0, -170.0)
    for wrong in ("1,2,3", "10,0,5,1", "0,-181,1,1", "nan,0,1,1", "a,b,c,d"):
        with pytest.raises(argparse.ArgumentTypeError):
            arguments.box(wrong)


HOSTILE = "\x1b[2J\x9b1mEVIL\u202e\r\nCARGO\x00"
SHOWN = r"\x1b[2J\x9b1mEVIL\u202e\r\nCARGO\x00"


@pytest.mark.parametrize("form", ["table", "csv", "json", "geojson", "gpx"])
def test_no_format_passes_control_characters_on(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A ship's name must not move the cursor of a terminal or hide a line."""
    export.write(Rows(SHIPS.columns, [(1, 1.0, 2.0, None, HOSTILE)]), form, None, HOSTILE)
    out = capsys.readouterr().out
    assert "EVIL" in out
    assert printable(out.replace("\n", "")) == out.replace("\n", "")


def test_every_character_that_is_not_printable_is_shown_as_its_escape() -> None:
    assert printable(HOSTILE) == SHOWN
    assert printable("Ærø \N{SNOWMAN}") == "Ærø \N{SNOWMAN}"
    assert html_report.escape("<b>\x1b") == r"&lt;b&gt;\x1b"


@pytest.mark.parametrize("text", ["=1+1", "+41", "-2", "@SUM(A1)"])
def test_a_text_is_no_formula_of_a_spreadsheet(text: str) -> None:
    made = export.as_csv(Rows(("name", "latitude_deg"), [(text, -22.5)]))
    assert made == f"name,latitude_deg\n'{text},-22.5\n"


def test_columns_of_degrees_line_up_and_no_zero_is_negative() -> None:
    rows = store.Rows(("cog_deg", "latitude_deg", "flags"), [(-1e-9, -22.9, 0), (270.126, 5.0, 1)])
    first, second = export.as_table(presentation.in_operator_units(rows)).splitlines()[2:]
    assert (first.split(), second.split()) == (["0.00", "-22.900000", "-"], ["270.13", "5.000000", "dark"])
    assert first.index(".9") == second.index(".0", 12)


def test_parquet_has_the_same_types_with_and_without_values(tmp_path: Path) -> None:
    names = ("vessel_id", "sog_kn", "mmsi", "flags", "time_utc", "in_picture", "end_utc")
    full = Rows(names, [(1, 2.5, "219000001", "dark coasting", "2025-06-01T12:00:00.000Z", True, None)])
    frames = []
    for rows in (full, Rows(names, []), Rows(names, [(None,) * 7])):
        export.write(rows, "parquet", str(tmp_path / "x.parquet"))
        frames.append(polars.read_parquet(tmp_path / "x.parquet"))
    assert len({str(frame.schema) for frame in frames}) == 1
    assert polars.Null not in frames[0].dtypes
    assert frames[0].schema["time_utc"] == frames[0].schema["end_utc"] == polars.Datetime("us", "UTC")
    assert frames[0]["flags"].to_list() == [["dark", "coasting"]]


def test_every_column_of_every_question_has_a_type(tmp_path: Path) -> None:
    with store.open_store(str(tmp_path / "x.db")) as opened, writing(opened) as connection:
        connection.exec_driver_sql(
            "INSERT INTO run (id, scenario, title, seed, version, settings, command, started_utc, status, period_s, cycles, "
            "warmup_cycles, start_s, workers, faults) VALUES (1, 'x', '', 1, '', '{}', '', '', 'finished', 1, 1, 0, 0, 1, '[]')"
        )
    given = {"mmsi": "219000001", "latitude_deg": "0", "longitude_deg": "0"}
    with store.open_store(str(tmp_path / "x.db")) as opened:
        for name, question in store.operator_queries().items():
            asked = {key: given[key] for key, parameter in question.parameters.items() if parameter.default is None}
            assert [c for c in presentation.answer(opened, name, asked).columns if columns.kind_of(c) is None] == [], name
        assert [c for c in presentation.picture(opened, 1, None, None).columns if columns.kind_of(c) is None] == []


def test_gpx_has_a_waypoint_for_each_position_and_a_track_for_a_history() -> None:
    import gpxpy

    points = gpxpy.parse(export.as_gpx(SHIPS)).waypoints
    assert [(p.latitude, p.longitude, p.name) for p in points] == [(-22.9, -43.1, 'A "B", C'), (10.5, 179.9, "vessel 23")]
    alarms = Rows(("vessel_id", "latitude_deg", "longitude_deg"), [(45, 1.0, 2.0), (45, 1.0, 3.0), (None, 1.0, 4.0)])
    assert [p.name for p in gpxpy.parse(export.as_gpx(alarms)).waypoints] == ["vessel 45", "vessel 45", None]
    assert [feature.get("id") for feature in json.loads(export.as_geojson(alarms))["features"]] == [None] * 3
    path = Rows(("time_utc", "latitude_deg", "longitude_deg"), [("2025-06-01T12:00:00.000Z", 1.0, 2.0)] * 2)
    (track,) = gpxpy.parse(export.as_gpx_track("SHIP", [path, path])).tracks
    assert (track.name, [len(segment.points) for segment in track.segments]) == ("SHIP", [2, 2])


def test_rows_are_sorted_limited_and_cut_to_columns() -> None:
    assert [row[0] for row in selected(SHIPS, ["-vessel_id"], None, []).rows] == [23, 4, 1]
    assert [row[0] for row in selected(SHIPS, ["name"], None, []).rows] == [1, 4, 23]  # what is absent comes last
    assert [row[0] for row in selected(SHIPS, ["-name"], None, []).rows] == [4, 1, 23]
    assert selected(SHIPS, [], 1, ["mmsi", "vessel_id"]) == store.Rows(("mmsi", "vessel_id"), [("002320001", 1)])
    with pytest.raises(InputError, match=r"--sort: got 'vesel_id', needed some of .*; did you mean 'vessel_id'\?"):
        selected(SHIPS, ["vesel_id"], None, [])
    with pytest.raises(InputError, match=r"--columns: got 'mmsi' twice, needed each column once"):
        selected(SHIPS, [], None, ["mmsi", "vessel_id", "mmsi"])


@pytest.mark.parametrize(("variable", "coloured"), [("FORCE_COLOR", True), ("NO_COLOR", False)])
def test_alarms_are_red_unless_colour_is_refused_or_the_table_goes_to_a_file(
    variable: str, coloured: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("FORCE_COLOR", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, "1")
    termcolor.can_colorize.cache_clear()
    rows = Rows(("vessel_id", "flags"), [(1, "dark"), (2, "")])
    export.write(rows, "table", None)
    out = capsys.readouterr().out
    assert ("\x1b[31mdark" in out) is coloured
    assert "\x1b[31m-" not in out
    export.write(rows, "table", str(tmp_path / "x.txt"))
    assert "\x1b" not in (tmp_path / "x.txt").read_text()
    termcolor.can_colorize.cache_clear()


def test_what_a_column_holds_is_looked_up_once_for_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(export, "kind_of", lambda name: (asked.append(name), columns.kind_of(name))[1])
    rows = Rows(("vessel_id", "flags", "sog_kn", "name"), [(1, "dark coasting", 2.5, "A B"), (2, "", math.nan, None)] * 50)
    expected = [
        {"vessel_id": 1, "flags": ["dark", "coasting"], "sog_kn": 2.5, "name": "A B"},
        {"vessel_id": 2, "flags": [], "sog_kn": None, "name": None},
    ]
    assert export.as_objects(rows) == expected * 50
    assert sorted(asked) == sorted(rows.columns)
