"""CSV and Parquet files to columns of numbers and texts. Lines of the wrong shape and unreadable cells are counted."""

from __future__ import annotations

import io
import re
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import lazy_loader
import numpy as np
from pydantic import Field

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.intake.timestamps import MICROSECONDS_FROM, MILLISECONDS_FROM, NANOSECONDS_FROM
from coastwatch.sensors.recorded.files import CUT_FILE, GZIP_MAGIC, as_utf8, check_table, is_parquet

if TYPE_CHECKING:
    import polars as pl
else:
    pl = lazy_loader.load("polars")  # 50 MB of memory that only a feed of tables needs

HALF_A_LINE = "half a line"
RAGGED = "line with too many cells"
QUOTE = "quotation without end"
LONGEST_COLUMN, MOST_NAMES = 60, 40  # of columns, in an error
NO_ROW = "table without a row under its header"

Separator = Annotated[str, Field(pattern=r"^(auto|.)$")]
REPEATED = "_duplicated_"  # polars names the second column of a name so, with a number
SEPARATORS = (",", ";", "\t", "|")
VALUE = re.compile(rf"[-+]?\d[-+\d.:,TZ/ ]*([eE][-+]?\d+)?({REPEATED}\d+)?")  # a number or a time, where a name should be
SAID_SEPARATOR = r"\ufeff?sep=(.)"
FIRST_LINES = 100  # of a file, by which its separator and its header are found
HIGHEST_SECOND = 63.0  # of the minute, in a message of AIS: from 60 it says why there is none
FEWEST_CELLS = 3  # of a header: time, latitude, longitude
LINE_BREAKER = "\x1f"  # the ASCII unit separator, which no line of a table contains
CLOCKS = ("%H:%M:%S%.f", "%H:%M", "%I:%M:%S%.f %p", "%I:%M %p")
DATES = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%d-%b-%Y", "%d %b %Y", "%d/%b/%Y")
WRITTEN_TIMES = (*(f"{date} {clock}" for date in DATES for clock in CLOCKS[:2]), "%Y%m%d %H%M%S", "%Y%m%d_%H%M%S")
DAY_FIRST, MONTH_FIRST = "%d/%m/%Y", "%m/%d/%Y"
ZONED_TIME = "%Y-%m-%d %H:%M:%S%.f%z"
ZONE = r"[:\d] ?(Z|UTC|GMT|[+-]\d{2}:?\d{2})$"
DANISH_TIME = "# timestamp"  # the column of the Danish Maritime Authority, whose dates are day first
FIRST_COMPACT, LAST_COMPACT = 19_000_101_000_000, 22_000_101_000_000
"""Numbers from the first to the last are 20260714033320: in milliseconds they would be after the year 2500."""
KNOWN_TIMES = "Unix time, a date and time such as 2026-07-14 03:33:20 or 14.07.2026 03:33:20, or a pattern"
NO_VALUE = r"(?i)^(null|none|nil|n/a|na|unknown|undefined|\?+|-+)?$"  # texts that stand for no value where a number should be
TWO_DIGIT_YEAR = r"^\d{1,2}([-/. ])\d{1,2}[-/. ]\d{2}([ T]\d{1,2}:|$)"
CUT_DIGITS = r"^\d\.\d+[eE]\+?\d+$"  # as a spreadsheet shows a long number
DATE_COLUMNS = ("date", "date_utc")
TIME_COLUMNS = ("time", "time_utc", "timestamp", "t")
TIME_OF_DAY = r"^\d{1,2}:\d\d(:\d\d([.,]\d+)?)?( ?[AaPp][Mm])?( ?(Z|UTC|GMT|[+-]\d\d:?\d\d))?$"
PATTERN = '--set input.time_format="%d/%m/%Y %H:%M:%S"'


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of a file that have the right number of cells, and their line numbers."""

    name: str
    frame: pl.DataFrame
    row: Ints  # line of a CSV file, row of a Parquet file, from 1
    separator: str = ","
    is_parquet: bool = False
    read: int = 0  # lines or rows of the file, with those of the wrong shape and without the header

    def __len__(self) -> int:
        return len(self.row)

    def location(self, i: int, column: str = "") -> str:
        """Location of row i of the frame: file and line."""
        where = f"{self.name}, row {self.row[i]}" if self.is_parquet else f"{self.name}:{self.row[i]}"
        return f"{where}, column {column}" if column else where

    def example(self, i: int) -> str:
        """The cells of row i of the frame."""
        return ",".join("" if v is None else str(v) for v in self.frame.row(i))

    def at(self, rows: Array) -> Table:
        """The rows under a mask or at indices."""
        keep = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return replace(self, frame=self.frame[keep], row=self.row[keep])

    def find(self, wanted: str | None, aliases: tuple[str, ...]) -> str | None:
        """The name of a column: `wanted`, or the first that has one of the aliases; None if there is none.

        Raises: InputError if `wanted` is not a column, or the column is there twice.
        """
        if wanted is not None and wanted not in self.frame.columns:
            raise self.lacks(repr(wanted))
        plain = {plain_name(c): c for c in reversed(self.frame.columns)}
        name = next((plain[k] for k in aliases if k in plain), None) if wanted is None else wanted
        if f"{name}{REPEATED}0" in self.frame.columns:
            raise InputError(f"{self.name}: got two columns {name!r}, needed one: rename or delete the other")
        return name

    def lacks(self, needed: str) -> InputError:
        """The error of a missing column: the columns that are there, or that values stand where a header should be."""
        names = [name[:LONGEST_COLUMN] for name in self.frame.columns]
        if 2 * sum(VALUE.fullmatch(name.strip()) is not None for name in names) > len(names):
            first = self.separator.join(names[:3])
            return InputError(
                f"{self.name}: got no header, its first line begins with {first!r}: needed a first line with the names of its columns"
            )
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        return InputError(f"{self.name}: got columns {', '.join(names[:MOST_NAMES])}{more}, needed {needed}")

    def numbers(self, column: str | None) -> tuple[Floats, Bools]:
        """The numbers of a column, NaN for an empty cell or a missing column, and which cells are no number."""
        if column is None:
            return np.full(len(self), np.nan), np.zeros(len(self), np.bool_)
        cells = self.frame[column]
        if cells.dtype == pl.String:
            numbers = self._with_points(cells.str.strip_chars()).cast(pl.Float64, strict=False)
        else:
            numbers = cells.cast(pl.Float64, strict=False)
        return numbers.fill_null(float("nan")).to_numpy(), (numbers.is_null() & ~self.empty(column)).to_numpy()

    def times(self, column: str | None, pattern: str) -> tuple[Floats, Bools]:
        """The times of a column in seconds since the epoch, and which cells are no time.

        Args: pattern: "auto": Unix time in any unit or a written date; else as for strptime, UTC if it has no zone.
        Raises: InputError: no cell is a time, or the dates may be day first or month first.
        """
        if column is None:
            return np.full(len(self), np.nan), np.zeros(len(self), np.bool_)
        cells = self.frame[column]
        if cells.dtype in (pl.Datetime, pl.Date):
            seconds = _epoch_s(cells.cast(pl.Datetime("us", getattr(cells.dtype, "time_zone", None))))
        elif cells.dtype == pl.String:
            seconds = self._written(column, pattern)
        else:
            seconds = _seconds(cells.cast(pl.Float64, strict=False))
        bad = (seconds.is_null() & ~self.empty(column)).to_numpy()
        if bad.any() and not seconds.is_not_null().any():
            first = int(bad.argmax())
            needed = f"{KNOWN_TIMES}: {PATTERN}" if pattern == "auto" else f"times as input.time_format says, {pattern!r}"
            if re.fullmatch(TIME_OF_DAY, str(cells[first]).strip()):
                needed = "a date too, in the same cell, or in a column `date` beside the column `time`"
            raise InputError(f"{self.location(first, column)}: got {cells[first]!r}, which is no time: needed {needed}")
        return seconds.fill_null(float("nan")).to_numpy(), bad

    def without_zone(self, column: str | None) -> bool:
        """Whether the times of a column are written without a zone, as its first cell is."""
        if column is None or not len(self):
            return False
        cells = self.frame[column]
        if cells.dtype != pl.String:
            return bool(cells.dtype == pl.Datetime and getattr(cells.dtype, "time_zone", None) is None)
        first = cells.str.strip_chars().replace("", None).drop_nulls().head(1)
        return bool((~first.str.contains(ZONE) & first.cast(pl.Float64, strict=False).is_null()).any())

    def _with_points(self, cells: pl.Series) -> pl.Series:
        """The cells with decimal points, of a table whose cells are not separated by commas."""
        if self.separator == "," or cells.str.contains(".", literal=True).any():
            return cells
        return cells.str.replace(r"^([+-]?\d*),(\d+)$", "${1}.${2}")

    def _written(self, column: str, pattern: str) -> pl.Series:
        """Seconds since the epoch, null for a cell that is no time."""
        cells = self.frame[column].str.strip_chars()
        if pattern != "auto":
            zone = "UTC" if "%z" in pattern or "%:z" in pattern or "%#z" in pattern else None
            return _epoch_s(cells.str.to_datetime(pattern, strict=False, time_unit="us", time_zone=zone))
        seconds = _seconds(self._with_points(cells).cast(pl.Float64, strict=False))
        if not seconds.null_count():
            return seconds
        short = cells.str.contains(TWO_DIGIT_YEAR).fill_null(value=False)
        if _most(short):
            raise InputError(
                f"{self.name}, column {column}: got {cells.filter(short)[0]!r}, whose year has two digits: needed to know which number is "
                f"which: {PATTERN.replace('%Y', '%y')}, with %m/%d/%y, or with %y-%m-%d"
            )
        plain = (
            cells.set(short, None)
            .str.replace(r"(\d)T(\d)", "${1} ${2}")
            .str.replace(r" ?(Z|UTC|GMT)$", "")
            .str.replace(r":(\d\d),(\d+)", ":${1}.${2}")
        )
        for form in (*WRITTEN_TIMES, *self._slashed(column, plain)):
            seconds = seconds.fill_null(_epoch_s(plain.str.to_datetime(form, strict=False, time_unit="us")))
            if not seconds.null_count():
                return seconds
        return seconds.fill_null(_epoch_s(plain.str.to_datetime(ZONED_TIME, strict=False, time_unit="us", time_zone="UTC")))

    def _slashed(self, column: str, cells: pl.Series) -> list[str]:
        """How dates such as 31/12/2026 are written: day first or month first, as the whole column shows.

        Raises: InputError if it may be both.
        """
        parts = [cells.str.extract(r"^(\d{1,2})/(\d{1,2})/\d{4}", k).cast(pl.Int64) for k in (1, 2)]
        first, second = (part.fill_null(0).to_numpy().max(initial=0) for part in parts)
        danish = column.strip(" \ufeff").lower() == DANISH_TIME
        if first and first <= 12 and second <= 12 and not danish:
            got = cells.filter(parts[0].is_not_null())[0]
            pattern = PATTERN.replace("%H:%M:%S", "%I:%M:%S %p") if got[-1] in "Mm" else PATTERN
            raise InputError(
                f"{self.name}, column {column}: got {got!r}, which may be day first or month first in every row: needed to know which: "
                f"{pattern} or with %m/%d/%Y"
            )
        date = MONTH_FIRST if second > 12 else DAY_FIRST
        return [f"{date} {clock}" for clock in CLOCKS] if first else []

    def texts(self, column: str | None) -> list[str]:
        """The texts of a column, empty for an empty cell or a missing column."""
        if column is None:
            return [""] * len(self)
        return self.frame[column].cast(pl.String).fill_null("").str.strip_chars().to_list()

    def cut_digits(self, column: str | None) -> Bools:
        """Which cells are a whole number as a spreadsheet writes it, 2.350699e+08: different ones are the same now. (N,)

        Raises: InputError: most are.
        """
        if column is None or (cells := self.frame[column]).dtype != pl.String:
            return np.zeros(len(self), np.bool_)
        cut = cells.str.strip_chars().str.contains(CUT_DIGITS).fill_null(value=False)
        if _most(cut):
            first = int(cut.to_numpy().argmax())
            raise InputError(
                f"{self.location(first, column)}: got {cells[first]!r}, a number whose digits a spreadsheet has cut: needed all of them: "
                "format the column as a whole number before it is saved"
            )
        return np.asarray(cut.to_numpy(), np.bool_)

    def is_second_of_minute(self, column: str) -> bool:
        """Whether the first cells of a column are all whole numbers from 0 to 63: seconds, or a code of a message of AIS for none."""
        first = self.frame[column].head(FIRST_LINES)
        if first.dtype != pl.String and not first.dtype.is_integer():
            return False
        numbers = first.cast(pl.Float64, strict=False)
        return bool(
            len(first) and (numbers.is_between(0.0, HIGHEST_SECOND) & (numbers == numbers.floor())).fill_null(value=False).all()
        )

    def may_hold(self, column: str, times: bool) -> bool:
        """Whether the first cells of a column are numbers, or times."""
        head = self.at(np.arange(min(len(self), FIRST_LINES)))
        kind = self.frame[column].dtype
        if kind != pl.String and not kind.is_numeric() and not (times and kind.is_temporal()):
            return False
        try:
            values, bad = head.times(column, "auto") if times else head.numbers(column)
        except InputError:
            return False
        return bool(np.isfinite(values).any() and not bad.any())

    def begins_with(self, column: str, letter: str) -> Bools:
        """Which cells begin with a letter, capital or small. (N,)"""
        cells = self.frame[column].cast(pl.String).str.strip_chars().str.to_uppercase()
        return np.asarray(cells.str.starts_with(letter).fill_null(value=False).to_numpy(), np.bool_)

    def empty(self, column: str) -> pl.Series:
        """Which cells of a column are empty, or hold a text that stands for no value."""
        cells = self.frame[column]
        return cells.is_null() | cells.str.strip_chars().str.contains(NO_VALUE) if cells.dtype == pl.String else cells.is_null()


def _most(cells: pl.Series) -> bool:
    """Whether more than half of the cells are so: then the whole column is written so, else they are wrong cells."""
    return int(cells.sum()) > len(cells) / 2


def read_table(path: Path, separator: str, tally: Tally) -> Table:
    """The table in a file. Lines of the wrong shape are counted and left out.

    Args: separator: one character, or "auto".
    Raises: InputError that names the file if it is not a table.
    """
    check_table(path)
    try:
        if is_parquet(path):
            frame = pl.read_parquet(path)
            table = Table(path.name, frame, np.arange(1, len(frame) + 1), is_parquet=True, read=len(frame))
        else:
            table = _read_csv(path, separator, tally)
    except (pl.exceptions.PolarsError, zlib.error) as error:
        raise InputError(f"{path}: got {str(error).splitlines()[0]}, needed a CSV or Parquet table") from error
    if not len(table):
        tally.add(NO_ROW, path.name, used=True)
    return _with_dates(table)


def _with_dates(table: Table) -> Table:
    """The table whose column of times of day, if it has one, has the dates of the column beside it too."""
    plain = {plain_name(column): column for column in reversed(table.frame.columns)}
    dates, times = (next((plain[name] for name in names if name in plain), None) for names in (DATE_COLUMNS, TIME_COLUMNS))
    if dates is None or times is None:
        return table
    date, time = (table.frame[column].cast(pl.String).str.strip_chars() for column in (dates, times))
    some = date.is_not_null() & (date != "") & time.is_not_null() & (time != "")
    first = next(zip(date.filter(some).head(1), time.filter(some).head(1), strict=True), ("", ""))
    if ":" in first[0] or not re.fullmatch(TIME_OF_DAY, first[1]):
        return table
    joined = pl.select(pl.when(some).then(pl.concat_str(date, time, separator=" "))).to_series().alias(times)
    return replace(table, frame=table.frame.with_columns(joined).drop(dates))


def _read_csv(path: Path, separator: str, tally: Tally) -> Table:
    lines = _lines(_unpacked(path, tally))
    row = np.flatnonzero((lines.str.strip_chars() != "").to_numpy()) + 1
    if not len(row):
        raise InputError(f"{path}: got no line, needed a table with a header")
    lines = lines[row - 1]
    if said := re.fullmatch(SAID_SEPARATOR, lines[0]):  # for a spreadsheet
        separator = said[1] if separator == "auto" else separator
    above, separator = _header(lines.head(FIRST_LINES), separator)
    lines, row = lines[above:], row[above:]
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
    return Table(path.name, frame, row[good][1:], separator, read=len(lines) - 1)


def _header(lines: pl.Series, separator: str) -> tuple[int, str]:
    """Which line is the header, and its separator: what it has most often outside quotations, a comma where it has none.

    Titles and comments above it are passed over: a line of few cells, or one that begins with # and has not as many as most
    lines, or no values below it.
    Args: lines: the first; separator: one character, or "auto".
    """
    bare = lines.str.replace_all('"[^"]*"', "")
    for row, line in enumerate(bare):
        best = max(SEPARATORS, key=line.count) if separator == "auto" else separator
        cells = bare.str.count_matches(best, literal=True) + 1
        usual = cells[row + 1 :].mode()
        below = bare[row + 1].split(best) if row + 1 < len(bare) else []
        is_header = cells[row] in usual and any(VALUE.fullmatch(cell.strip()) for cell in below)
        if cells[row] >= FEWEST_CELLS and (not line.startswith("#") or is_header):
            return row, best
    return 0, max(SEPARATORS, key=bare[0].count) if separator == "auto" else separator


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


def _unpacked(path: Path, tally: Tally) -> bytes:
    """The content of a file, decompressed if needed; of a truncated compressed file the part that is there."""
    content = path.read_bytes()
    unpacked = b""
    while content[:2] == GZIP_MAGIC:
        inflate = zlib.decompressobj(wbits=31)
        unpacked += inflate.decompress(content)
        if not inflate.eof:
            tally.add(CUT_FILE, path.name, used=True)
        content = inflate.unused_data
    return as_utf8(unpacked or content)


def plain_name(name: str) -> str:
    """The name of a column as it is compared: lower case, no blanks, no byte order mark."""
    return name.strip(" #\ufeff\"'").lower().replace(" ", "_")


def _seconds(number: pl.Series) -> pl.Series:
    if (compact := number.is_between(FIRST_COMPACT, LAST_COMPACT)).any():
        texts = number.filter(compact).cast(pl.Int64).cast(pl.String)
        written = _epoch_s(texts.str.to_datetime("%Y%m%d%H%M%S", strict=False, time_unit="us"))
        number = number.scatter(compact.arg_true(), written)
    size = number.abs()
    divisor = np.select(
        [(size >= limit).fill_null(False).to_numpy() for limit in (NANOSECONDS_FROM, MICROSECONDS_FROM, MILLISECONDS_FROM)],
        [1e9, 1e6, 1e3],
        1.0,
    )
    return number / pl.Series(divisor)


def _epoch_s(moments: pl.Series) -> pl.Series:
    return moments.dt.epoch("us").cast(pl.Float64) / 1e6
