"""Rows as table, CSV, GeoJSON and Parquet, and what the arguments of moments and boxes accept."""

import argparse
import csv
import io
import json
from collections import namedtuple
from pathlib import Path

import polars
import pytest

from coastwatch.operators import export
from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli import arguments

Rows = namedtuple("Rows", ["columns", "rows"])
SHIPS = Rows(
    ("vessel_id", "latitude_deg", "longitude_deg", "mmsi", "name"),
    [(1, -22.9, -43.1, "002320001", 'A "B", C'), (23, 10.5, 179.9, None, None), (4, float("nan"), float("nan"), None, "D")],
)


def test_a_table_aligns_and_shows_what_is_absent() -> None:
    lines = export.as_table(SHIPS).splitlines()
    assert lines[0].split() == list(SHIPS.columns)
    assert lines[2].startswith("        1         -22.9")
    assert lines[3].split() == ["23", "10.5", "179.9", "-", "-"]
    assert "no rows" in export.as_table(Rows(("a",), []))


def test_csv_reads_back() -> None:
    back = list(csv.reader(io.StringIO(export.as_csv(SHIPS))))
    assert back[0] == list(SHIPS.columns)
    assert back[1] == ["1", "-22.9", "-43.1", "002320001", 'A "B", C']
    assert back[3] == ["4", "", "", "", "D"]


def test_geojson_puts_longitude_first_and_nothing_where_there_is_no_position() -> None:
    features = json.loads(export.as_geojson(SHIPS))["features"]
    assert features[0]["geometry"] == {"type": "Point", "coordinates": [-43.1, -22.9]}
    assert features[0]["properties"] == {"vessel_id": 1, "mmsi": "002320001", "name": 'A "B", C'}
    assert features[2]["geometry"] is None
    with pytest.raises(BadInput, match="latitude_deg"):
        export.as_geojson(Rows(("stage", "median_ms"), [("tracks", 1.0)]))


def test_parquet_keeps_types_and_needs_a_file(tmp_path: Path) -> None:
    path = tmp_path / "picture.parquet"
    export.write(SHIPS, "parquet", str(path))
    back = polars.read_parquet(path)
    assert back["vessel_id"].to_list() == [1, 23, 4]
    assert back.schema["latitude_deg"] == polars.Float64
    assert back["mmsi"].to_list() == ["002320001", None, None]
    with pytest.raises(BadInput, match="--output"):
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
