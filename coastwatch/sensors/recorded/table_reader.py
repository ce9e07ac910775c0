"""CSV and Parquet files to columns of numbers and texts. Lines of the wrong shape and unreadable cells are counted."""

from __future__ import annotations

import gzip
import io
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import lazy_loader
import numpy as np

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.sensors.recorded.faults import Tally
from coastwatch.sensors.recorded.timestamps import MICROSECONDS_FROM, MILLISECONDS_FROM, NANOSECONDS_FROM

if TYPE_CHECKING:
    import polars as pl
else:
    pl = lazy_loader.load("polars")  # 50 MB of memory that only a feed of tables needs

HALF_A_LINE = "half a line"
RAGGED = "line with too many cells"
QUOTE = "quotation without end"
CUT_FILE = "file cut short"

GZIP_MAGIC = b"\x1f\x8b"
LINE_BREAKER = "\x1f"  # the ASCII unit separator, which no line of a table contains
WRITTEN_TIMES = ("%Y-%m-%d %H:%M:%S%.f", "%Y-%m-%d %H:%M", "%d/%m/%Y %H:%M:%S%.f")
ZONED_TIME = "%Y-%m-%d %H:%M:%S%.f%:z"


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of a file that have the right number of cells, and their line numbers."""

    name: str
    frame: pl.DataFrame
    row: Ints  # line of a CSV file, row of a Parquet file, from 1

    def __len__(self) -> int:
        return len(self.row)

    def location(self, i: int, column: str = "") -> str:
        """Location of row i of the frame: file and line."""
        where = f"{self.name}, row {self.row[i]}" if self.name.endswith(".parquet") else f"{self.name}:{self.row[i]}"
        return f"{where}, column {column}" if column else where

    def example(self, i: int) -> str:
        """The cells of row i of the frame."""
        return ",".join("" if v is None else str(v) for v in self.frame.row(i))

    def at(self, rows: Array) -> Table:
        """The rows under a mask or at indices."""
        keep = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return Table(self.name, self.frame[keep], self.row[keep])

    def find(self, wanted: str | None, known: tuple[str, ...]) -> str | None:
        """The name of a column: `wanted`, or the first that has one of the known names; None if there is none.

        Raises: ValueError if `wanted` is not a column.
        """
        if wanted is not None:
            if wanted not in self.frame.columns:
                raise ValueError(f"{self.name}: got columns {self.frame.columns}, needed {wanted!r}")
            return wanted
        plain = {plain_name(c): c for c in reversed(self.frame.columns)}
        return next((plain[k] for k in known if k in plain), None)

    def need(self, wanted: str | None, known: tuple[str, ...]) -> str:
        """As `find`, for a required column.

        Raises: ValueError that names the columns of the file and the known names.
        """
        column = self.find(wanted, known)
        if column is None:
            raise ValueError(f"{self.name}: got columns {self.frame.columns}, needed one of {list(known)}")
        return column

    def numbers(self, column: str | None) -> tuple[Floats, Bools]:
        """The numbers of a column, NaN for an empty cell or a missing column, and which cells are no number."""
        if column is None:
            return np.full(len(self), np.nan), np.zeros(len(self), np.bool_)
        cells = self.frame[column]
        made = cells.str.strip_chars().cast(pl.Float64, strict=False) if cells.dtype == pl.String else cells.cast(pl.Float64)
        return made.fill_null(float("nan")).to_numpy(), (made.is_null() & ~self.empty(column)).to_numpy()

    def times(self, column: str | None, pattern: str) -> tuple[Floats, Bools]:
        """The times of a column in seconds since the epoch, and which cells are no time.

        Args: pattern: "auto": Unix time in any unit or a written date; else as for strptime, UTC if it has no zone.
        """
        if column is None:
            return np.full(len(self), np.nan), np.zeros(len(self), np.bool_)
        cells = self.frame[column]
        if cells.dtype in (pl.Datetime, pl.Date):
            made = _epoch_s(cells.cast(pl.Datetime("us", getattr(cells.dtype, "time_zone", None))))
        elif cells.dtype == pl.String:
            made = _written(cells.str.strip_chars(), pattern)
        else:
            made = _seconds(cells.cast(pl.Float64))
        return made.fill_null(float("nan")).to_numpy(), (made.is_null() & ~self.empty(column)).to_numpy()

    def texts(self, column: str | None) -> list[str]:
        """The texts of a column, empty for an empty cell or a missing column."""
        if column is None:
            return [""] * len(self)
        return self.frame[column].cast(pl.String).fill_null("").str.strip_chars().to_list()

    def empty(self, column: str) -> pl.Series:
        """Which cells of a column are empty."""
        cells = self.frame[column]
        return cells.is_null() | (cells.str.strip_chars() == "") if cells.dtype == pl.String else cells.is_null()


def read_table(path: Path, separator: str, tally: Tally) -> Table:
    """The table in a file. Lines of the wrong shape are counted and left out.

    Raises: OSError that names the file if it is not a table.
    """
    try:
        if path.suffix == ".parquet":
            frame = pl.read_parquet(path)
            return Table(path.name, frame, np.arange(1, len(frame) + 1))
        return _read_csv(path, separator, tally)
    except (pl.exceptions.PolarsError, zlib.error) as error:
        raise OSError(f"{path}: got {str(error).splitlines()[0]}, needed a CSV or Parquet table") from error


def _read_csv(path: Path, separator: str, tally: Tally) -> Table:
    lines = _lines(_unpacked(path, tally))
    row = np.flatnonzero((lines.str.strip_chars() != "").to_numpy()) + 1
    if not len(row):
        raise OSError(f"{path}: got no line, needed a table with a header")
    lines = lines[row - 1]
    bare = lines.str.replace_all('"[^"]*"', "")
    cells = bare.str.count_matches(separator, literal=True)
    need = cells[0]
    torn = bare.str.contains('"', literal=True)
    wrong = {QUOTE: torn, HALF_A_LINE: ~torn & (cells < need), RAGGED: ~torn & (cells > need)}
    good = np.ones(len(lines), np.bool_)
    for kind, mask in wrong.items():
        bad = mask.to_numpy()
        tally.add_rows(kind, bad, lambda i: f"{path.name}:{row[i]}", lambda i: str(lines[i]))
        good &= ~bad
    text = lines.filter(pl.Series(good)).str.join("\n")[0] + "\n"
    frame = pl.read_csv(io.BytesIO(text.encode()), separator=separator, infer_schema=False)
    return Table(path.name, frame, row[good][1:])


def _lines(content: bytes) -> pl.Series:
    frame = pl.read_csv(
        io.BytesIO(content),
        has_header=False,
        separator=LINE_BREAKER,
        quote_char=None,
        truncate_ragged_lines=True,
        encoding="utf8-lossy",
        infer_schema=False,
        new_columns=["line"],
    )
    return frame["line"].fill_null("").str.strip_chars_end("\r")


def first_line(path: Path) -> bytes:
    """The header of a CSV file, compressed or not. Raises: OSError."""
    with path.open("rb") as plain:
        packed = plain.read(2) == GZIP_MAGIC
    with gzip.open(path, "rb") if packed else path.open("rb") as stream:
        try:
            return next((line for line in stream if line.strip()), b"")
        except (EOFError, zlib.error):
            return b""


def _unpacked(path: Path, tally: Tally) -> bytes:
    """The content of a file, decompressed if needed; of a truncated compressed file the part that is there."""
    content = path.read_bytes()
    out = b""
    while content[:2] == GZIP_MAGIC:
        inflate = zlib.decompressobj(wbits=31)
        out += inflate.decompress(content)
        if not inflate.eof:
            tally.add(CUT_FILE, path.name)
        content = inflate.unused_data
    return out or content


def plain_name(name: str) -> str:
    """The name of a column as it is compared: lower case, no blanks, no byte order mark."""
    return name.strip(" #\ufeff\"'").lower().replace(" ", "_")


def _seconds(number: pl.Series) -> pl.Series:
    size = number.abs()
    divisor = np.select(
        [(size >= limit).fill_null(False).to_numpy() for limit in (NANOSECONDS_FROM, MICROSECONDS_FROM, MILLISECONDS_FROM)],
        [1e9, 1e6, 1e3],
        1.0,
    )
    return number / pl.Series(divisor)


def _epoch_s(moments: pl.Series) -> pl.Series:
    return moments.dt.epoch("us").cast(pl.Float64) / 1e6


def _written(cells: pl.Series, pattern: str) -> pl.Series:
    if pattern != "auto":
        zone = "UTC" if "%z" in pattern or "%:z" in pattern or "%#z" in pattern else None
        return _epoch_s(cells.str.to_datetime(pattern, strict=False, time_unit="us", time_zone=zone))
    made = _seconds(cells.cast(pl.Float64, strict=False))
    if not made.null_count():
        return made
    plain = cells.str.replace("T", " ", literal=True).str.replace(r" ?(Z|UTC|GMT)$", "")
    for form in WRITTEN_TIMES:
        made = made.fill_null(_epoch_s(plain.str.to_datetime(form, strict=False, time_unit="us")))
        if not made.null_count():
            return made
    return made.fill_null(_epoch_s(plain.str.to_datetime(ZONED_TIME, strict=False, time_unit="us", time_zone="UTC")))
