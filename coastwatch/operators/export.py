"""Rows as an aligned table, CSV, GeoJSON (RFC 7946) or Parquet."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import lazy_loader

from coastwatch.operators.bad_input import BadInput

polars = lazy_loader.load("polars")  # only Parquet needs it

LATITUDE, LONGITUDE = "latitude_deg", "longitude_deg"
FORMATS = ("table", "csv", "geojson", "parquet")


class Rows(Protocol):
    """Named columns and rows of plain values, as `coastwatch.store.Rows` has them."""

    @property
    def columns(self) -> Sequence[str]: ...

    @property
    def rows(self) -> Sequence[Sequence[Any]]: ...


def write(rows: Rows, form: str, output: str | None, heading: str = "") -> None:
    """Writes rows to a file, or to the terminal if `output` is None.

    Args: form: one of FORMATS; output: path of the file; heading: a line above a text.
    Raises: BadInput if the format needs a file, or a position that the rows do not have.
    """
    if form == "parquet":
        if output is None:
            raise BadInput("Parquet is not text: got no --output, needed --output FILE")
        as_frame(rows).write_parquet(output)
        return
    text = {"table": as_table, "csv": as_csv, "geojson": as_geojson}[form](rows)
    text = f"{heading}\n{text}" if heading else text
    if output is None:
        sys.stdout.write(text)
    else:
        Path(output).write_text(text, "utf-8")


def as_table(rows: Rows) -> str:
    """Aligned columns under their names, numbers to the right. An absent value is a dash."""
    cells = [[_cell(value) for value in row] for row in rows.rows]
    if not cells:
        return " ".join(rows.columns) + "\n(no rows)\n"
    widths = [max(len(name), *(len(row[c]) for row in cells)) for c, name in enumerate(rows.columns)]
    right = [all(isinstance(row[c], int | float | None) for row in rows.rows) for c in range(len(rows.columns))]
    lines = [list(rows.columns), ["-" * width for width in widths], *cells]
    return "".join(
        "  ".join(cell.rjust(w) if r else cell.ljust(w) for cell, w, r in zip(line, widths, right, strict=True)).rstrip() + "\n"
        for line in lines
    )


def as_csv(rows: Rows) -> str:
    """Comma-separated values with a header. An absent value is empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(rows.columns)
    writer.writerows([["" if _absent(value) else value for value in row] for row in rows.rows])
    return out.getvalue()


def as_geojson(rows: Rows) -> str:
    """A FeatureCollection: one point per row, with the other columns as its properties. An absent value is null."""
    columns = list(rows.columns)
    missing = [name for name in (LATITUDE, LONGITUDE) if name not in columns]
    if missing:
        raise BadInput(f"GeoJSON needs a position: columns {', '.join(columns)} have no {' and no '.join(missing)}")
    features = []
    for row in rows.rows:
        values = {name: None if _absent(value) else value for name, value in zip(columns, row, strict=True)}
        position = [values.pop(LONGITUDE), values.pop(LATITUDE)]
        geometry = None if None in position else {"type": "Point", "coordinates": position}
        features.append({"type": "Feature", "geometry": geometry, "properties": values})
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False) + "\n"


def as_frame(rows: Rows) -> Any:
    """A polars DataFrame of the rows."""
    columns = {name: [row[c] for row in rows.rows] for c, name in enumerate(rows.columns)}
    return polars.DataFrame(columns, strict=False)


def _absent(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _cell(value: Any) -> str:
    if _absent(value):
        return "-"
    return f"{value:.10g}" if isinstance(value, float) else str(value)
