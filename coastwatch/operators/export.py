"""Rows as an aligned table, CSV, JSON, GeoJSON (RFC 7946), GPX (1.1) or Parquet."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Callable, Iterable
from datetime import datetime
from typing import TYPE_CHECKING

import lazy_loader

from coastwatch.errors import InputError
from coastwatch.operators.columns import Kind, digits_of, kind_of, rounded
from coastwatch.operators.output_file import written
from coastwatch.spelling import printable
from coastwatch.store import Rows

if TYPE_CHECKING:
    import polars

    from coastwatch.operators.presentation import Vessel
else:
    polars = lazy_loader.load("polars")  # only Parquet needs it
gpxpy = lazy_loader.load("gpxpy")  # only GPX needs it
termcolor = lazy_loader.load("termcolor")  # only a table needs it

LATITUDE, LONGITUDE = "latitude_deg", "longitude_deg"
LONGEST = 1e12  # numbers of a table from there on have an exponent
ALARMING = {"flags", "status", "verdict"}
"""Columns of a table that are red on a terminal, where they say other than GOOD."""

GOOD = {"-", "finished", "running", "good", "coasting", "stationary"}
KEYS = ("alarm_id", "vessel_id", "track_id")
"""Columns that identify a row, if they are there and different in all."""

INSTANT = "%Y-%m-%dT%H:%M:%S%.fZ"
FORMULA = ("=", "+", "-", "@")
"""A spreadsheet computes a cell that begins so."""


def write(rows: Rows, form: str, output: str | None, heading: str = "") -> None:
    """Writes rows to a file, or to the terminal if `output` is None.

    Args: form: table, csv, json, geojson, gpx or parquet; output: path of the file; heading: a line above a table.
    Raises: InputError if the format needs a file, or a position that the rows do not have.
    """
    if form == "parquet":
        write_parquet(as_frame(rows), output)
        return
    if form == "table":
        text = as_table(rows, coloured=output is None)
        write_text(f"{printable(heading)}\n{text}" if heading else text, output)
        return
    text = {"csv": as_csv, "json": as_json, "geojson": as_geojson, "gpx": as_gpx}[form](rows)
    write_text(text, output)


def csv_cell(text: str) -> str:
    """The text as a cell of CSV: printable, and behind an apostrophe where a spreadsheet would take it for a formula."""
    text = printable(text)
    return f"'{text}" if text.startswith(FORMULA) else text


def write_text(text: str, output: str | None) -> None:
    """Writes a text to a file, or to the terminal if `output` is None."""
    if output is None:
        sys.stdout.write(text)
    else:
        with written(output) as file:
            file.write(text.encode())


def write_parquet(frame: polars.DataFrame, output: str | None) -> None:
    """Writes a polars DataFrame. Raises: InputError if there is no path."""
    if output is None:
        raise InputError("Parquet is not text: got no --output, needed --output FILE")
    whole = io.BytesIO()  # polars hides what a disk answers
    frame.write_parquet(whole)
    with written(output) as file:
        file.write(whole.getbuffer())


def as_table(rows: Rows, coloured: bool = False) -> str:
    """Aligned columns under their names, numbers to the right. An absent value is a dash.

    Args: coloured: names are bold and alarms red, if stdout is a terminal and NO_COLOR is not set.
    """
    cells = [[cell(name, value) for name, value in zip(rows.columns, row, strict=True)] for row in rows.rows]
    if not cells:
        return "  ".join(rows.columns) + "\n(no rows)\n"
    widths = [max(len(name), *(len(row[c]) for row in cells)) for c, name in enumerate(rows.columns)]
    right = [all(_absent(row[c]) or isinstance(row[c], int | float) for row in rows.rows) for c in range(len(rows.columns))]
    lines = [list(rows.columns), ["-" * width for width in widths], *cells]
    padded_lines = []
    for number, line in enumerate(lines):
        padded = [text.rjust(w) if r else text.ljust(w) for text, w, r in zip(line, widths, right, strict=True)]
        padded[-1] = padded[-1].rstrip()
        if coloured and number == 0:
            padded = [termcolor.colored(text, attrs=["bold"]) for text in padded]
        elif coloured and number > 1:
            padded = [
                termcolor.colored(text, "red") if name in ALARMING and not GOOD.issuperset(words.split()) else text
                for text, words, name in zip(padded, line, rows.columns, strict=True)
            ]
        padded_lines.append("  ".join(padded) + "\n")
    return "".join(padded_lines)


def cell(name: str, value: object) -> str:
    """A value of a column as text for a terminal: numbers with the decimals of the column, a dash for an absent one."""
    if _absent(value):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return printable(str(value))
    digits = digits_of(name)
    if abs(value) >= LONGEST:
        return f"{value:.4g}"
    return f"{rounded(value, digits):.{digits}f}" if kind_of(name) == "number" else f"{value:.10g}"


def as_csv(rows: Rows) -> str:
    """Comma-separated values with a header. An absent value is empty, and no text starts a formula."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(rows.columns)
    for row in rows.rows:
        writer.writerow(["" if _absent(value) else csv_cell(value) if isinstance(value, str) else value for value in row])
    return file.getvalue()


def as_json(rows: Rows) -> str:
    """A JSON list: one object per row."""
    return json.dumps(as_objects(rows), allow_nan=False) + "\n"


def as_objects(rows: Rows) -> list[dict[str, object]]:
    """One object per row. An absent value is None, flags are a list of words."""
    plain = [(name, _plain_as(kind_of(name))) for name in rows.columns]
    return [{name: convert(value) for (name, convert), value in zip(plain, row, strict=True)} for row in rows.rows]


def as_vessel(vessel: Vessel, cut: Callable[[Rows], Rows] = lambda rows: rows) -> dict[str, object]:
    """Details, tables and meanings of the statistics of a vessel. Args: cut: leaves out rows of a table."""
    details = {name: _plain_as(kind_of(name))(value) for name, value in vessel.details.items()}
    tables = {key.replace(" ", "_"): as_objects(cut(rows)) for key, rows in vessel.tables.items()}
    return {**details, **tables, "statistics": {key.replace(" ", "_"): text for key, text in vessel.meanings.items()}}


def as_geojson(rows: Rows) -> str:
    """A FeatureCollection: one point per row, and the other columns as its properties. An absent value is null.

    A feature has an id where a column of KEYS identifies the rows: the number of a row would be taken for a vessel's.
    """
    _needs_position(rows, "GeoJSON")
    features = []
    for key, values in zip(_ids(rows), as_objects(rows), strict=True):
        position = [values.pop(LONGITUDE), values.pop(LATITUDE)]
        geometry = None if None in position else {"type": "Point", "coordinates": position}
        features.append({"type": "Feature", **key, "geometry": geometry, "properties": values})
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False) + "\n"


def as_gpx(rows: Rows) -> str:
    """One waypoint per row that has a position, with the other columns as its description."""
    _needs_position(rows, "GPX")
    document = gpxpy.gpx.GPX()
    document.creator = "Coastwatch"
    for values in as_objects(rows):
        latitude, longitude, when = values.pop(LATITUDE), values.pop(LONGITUDE), values.pop("time_utc", None)
        if latitude is None or longitude is None:
            continue
        vessel = values.get("vessel_id")
        name = values.get("name") or values.get("mmsi") or (None if vessel is None else f"vessel {vessel}")
        texts = {column: " ".join(value) if isinstance(value, list) else value for column, value in values.items()}
        about = ", ".join(f"{column} {text}" for column, text in texts.items() if text not in (None, ""))
        shown = None if name is None else printable(str(name))
        point = gpxpy.gpx.GPXWaypoint(latitude, longitude, time=_time(when), name=shown, description=printable(about))
        document.waypoints.append(point)
    return str(document.to_xml()) + "\n"


def as_gpx_track(name: str, paths: Iterable[Rows]) -> str:
    """A track with one segment per path. Args: paths: rows with position and `time_utc`, oldest first."""
    document, track = gpxpy.gpx.GPX(), gpxpy.gpx.GPXTrack(name=printable(name))
    document.creator = "Coastwatch"
    document.tracks.append(track)
    for path in paths:
        values = as_objects(path)
        points = [gpxpy.gpx.GPXTrackPoint(row[LATITUDE], row[LONGITUDE], time=_time(row["time_utc"])) for row in values]
        track.segments.append(gpxpy.gpx.GPXTrackSegment(points))
    return str(document.to_xml()) + "\n"


def as_frame(rows: Rows) -> polars.DataFrame:
    """A polars DataFrame of the rows. The type of a column follows from its name: it is the same if the column has no value."""
    types: dict[Kind, polars.DataType | type[polars.DataType]] = {
        "text": polars.String,
        "whole": polars.Int64,
        "number": polars.Float64,
        "yes_no": polars.Boolean,
        "instant": polars.String,
        "flags": polars.List(polars.String),
    }
    columns = []
    for c, name in enumerate(rows.columns):
        kind = kind_of(name)
        plain = _plain_as(kind)
        values = [plain(row[c]) for row in rows.rows]
        column = polars.Series(name, values, dtype=types[kind] if kind else None, strict=False)
        if kind == "instant":
            column = column.str.to_datetime(INSTANT, time_unit="us", time_zone="UTC")
        columns.append(column.cast(polars.String) if column.dtype == polars.Null else column)
    return polars.DataFrame(columns)


def as_parquet(rows: Rows) -> bytes:
    """The rows as a Parquet file. What is a list or an object in JSON, but flags, is JSON text here."""
    columns = [
        [json.dumps(value, default=str) if isinstance(value, dict | list | tuple) else value for value in column]
        for column in zip(*rows.rows, strict=True)
    ]
    file = io.BytesIO()
    as_frame(Rows(rows.columns, list(zip(*columns, strict=True)))).write_parquet(file)
    return file.getvalue()


def _needs_position(rows: Rows, form: str) -> None:
    missing = [name for name in (LATITUDE, LONGITUDE) if name not in rows.columns]
    if missing:
        raise InputError(f"{form} needs a position: columns {', '.join(rows.columns)} have no {' and no '.join(missing)}")


def _ids(rows: Rows) -> list[dict[str, object]]:
    """The `id` of each row: of the first column of KEYS that is different in all; none: there is no such column."""
    for key in KEYS:
        values = rows.column(key) if key in rows.columns else []
        if values and len({value for value in values if not _absent(value)}) == len(values):
            return [{"id": value} for value in values]
    return [{}] * len(rows.rows)


def _absent(value: object) -> bool:
    return value is None or value == "" or (isinstance(value, float) and not math.isfinite(value))


def _plain_as(kind: Kind | None) -> Callable[[object], object]:
    """What makes the value for JSON and Parquet of a value of a column. Args: kind: of the column."""
    return _words if kind == "flags" else _finite


def _words(value: object) -> object:
    return value.split() if isinstance(value, str) else _finite(value)


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _time(text: object) -> datetime | None:
    return None if text is None else datetime.fromisoformat(str(text))
