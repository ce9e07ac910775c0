"""The feed `ais_table`: decoded AIS in CSV or Parquet, with any column names; class, status and accuracy in numbers or words."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import (
    AisReports,
    AisStatics,
    Bools,
    Fault,
    FileContent,
    Floats,
    Ints,
    NavStatus,
    PositionAccuracy,
    Recording,
    Reports,
    Sensors,
    nav_status_text,
)
from coastwatch.formats.intake.ais_validation import HIGHEST_SOG_KN, Acceptance, AisIntake, AisRows, StationKind, of_table
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.geodesy import KNOT_M_S
from coastwatch.sensors.recorded.files import Fingerprint, fingerprint
from coastwatch.sensors.recorded.merging import by_arrival, span_of
from coastwatch.sensors.recorded.tables.reader import Separator, Table, read_table
from coastwatch.sensors.recorded.tables.rows import (
    EMPTY_CELL,
    POSITION,
    POSITION_ENTRIES,
    content_of,
    find_columns,
    good_cells,
    need_columns,
    order_notes,
    stamps_of,
)
from coastwatch.sensors.recorded.tables.stated_motion import SPEED_KN, SpeedUnit, doubts
from coastwatch.sensors.recorded.tables.stated_units import angle_doubts, speed_doubts
from coastwatch.sensors.recorded.tables.static_data import static_data
from coastwatch.stage import Method, Plan, Settings

WRAPPED_COG = SET_ASIDE + "COG of a wrapped field: "
FULL_CIRCLE_DEG = 360.0
SIGNED_COG = "COG from -180 to 180 degrees: 360 is added to what is negative"
LEAST_WRAPPED_SHARE = 0.02  # of the courses of a file

REQUIRED = ("time", "mmsi", *POSITION)
MOTION = (*POSITION, "sog", "cog")

UNKNOWN_CLASS = SET_ASIDE + "unknown class, taken as class A"
UNKNOWN_STATUS = SET_ASIDE + "unknown navigational status, taken as not sent"
NO_COVARIANCE = SET_ASIDE + "no covariance of a position, that of the accuracy taken"

STATIONS = {
    StationKind.BASE: r"^base",
    StationKind.AID_TO_NAVIGATION: r"^(aton|aid)",
    StationKind.AIRCRAFT: r"^sar (airborne|aircraft)|aircraft",
}
"""What the text of a class begins with where the sender is no vessel."""
VESSEL = r"^((class )?[ab]\b.*|search and rescue transponder|ais-sart|sart|mob.*|man overboard.*|epirb.*)$"

STATUS_WORDS = {nav_status_text(status): int(status) for status in NavStatus} | {
    "under way": 0,
    "anchored": 1,
    "restricted maneuverability": 3,
    "restricted manoeuverability": 3,
    "constrained by her draught": 4,
    "fishing": 7,
    "sailing": 8,
    "ais-sart": 14,
    "not defined": 15,
    "unknown value": 15,
    "unknown": 15,
    "default": 15,
}
"""Words for each NavStatus, as tables of several authorities have them."""


class AisColumns(Settings):
    """Names of the columns; a column without a setting is found by its usual names."""

    time: str | None = None  # time of the fix, or of reception if there is no `received`
    received: str | None = None  # time of reception
    mmsi: str | None = None  # number of the vessel, 9 digits
    latitude: str | None = None  # deg, north positive
    longitude: str | None = None  # deg, east positive
    sog: str | None = None  # speed over ground, in the unit of `speed_unit`
    cog: str | None = None  # course over ground, deg true; 360 is not available
    heading: str | None = None  # of the bow, deg true; 511 is not available
    ais_class: str | None = None  # of the transponder: "B" or "Class B" is class B; "Base Station", "AtoN", "SAR Airborne"
    nav_status: str | None = None  # navigational status: 0 to 15, or in words, "At anchor"
    accuracy: str | None = None  # of the position: 1, "true" or "high" is 10 m or better
    raim: str | None = None  # whether the receiver monitors its integrity: 1 or "true"
    position_sigma_m: str | None = None  # m per axis, of this position, instead of `ais_tracks.position_sigma_m`
    name: str | None = None  # of the vessel
    call_sign: str | None = None  # of the vessel
    ship_type: str | None = None  # code of ITU-R M.1371, or in words, "Cargo"
    length: str | None = None  # m
    beam: str | None = None  # m
    to_bow: str | None = None  # m, from the antenna of the ship's GNSS receiver; so are the next three
    to_stern: str | None = None  # m
    to_port: str | None = None  # m
    to_starboard: str | None = None  # m


class AisTable(Method):
    """AIS from decoded tables."""

    method: Literal["ais_table"] = "ais_table"
    files: Annotated[tuple[Path, ...], Field(min_length=1)]  # compressed (gzip) or not
    columns: AisColumns = AisColumns()  # names of the columns
    time_format: str = "auto"
    """Of times. "auto": Unix time in s, ms, us or ns, or a written date; a date with points is day first. Else a pattern of strptime,
    e.g. "%d/%m/%Y %H:%M:%S" for 31/12/2025 23:59:59. A time without a zone is UTC; with "%z" the zone is read, e.g.
    "%Y-%m-%d %H:%M:%S%z" for 2025-12-31 23:59:59+0100."""
    separator: Separator = "auto"  # one character between the cells of a CSV file, e.g. ";"; "auto": by the header
    speed_unit: SpeedUnit = "kn"  # of the column of SOG, e.g. "m/s" for 5.14, "0.1 kn" for 100, where a ship makes 10 kn
    intake: AisIntake = AisIntake()  # which records are accepted

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """AIS reports and static data of all files in order of arrival, and the faults.

        Raises: FileNotFoundError, InputError that names the file.
        """
        reports, statics, faults = self.read()
        feeds = tuple(path.name for path in self.files)
        return Recording(Reports(ais=reports, statics=statics), faults=faults, contents=self.contents(), feeds=feeds)

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """Whole seconds before the first and after the last time of reception.

        Raises: InputError if no record is usable.
        """
        reports, statics, faults = self.read()
        return span_of(reports.received_s, statics.received_s, faults=faults)

    def read(self) -> tuple[AisReports, AisStatics, tuple[Fault, ...]]:
        """Reports and static data of all tables in order of arrival, and the faults."""
        reports, statics, tally = _read_files(self, fingerprint(self.files))
        return reports, statics, tally.faults()

    def contents(self) -> tuple[FileContent, ...]:
        """What was taken from each table."""
        return _read_files(self, fingerprint(self.files))[2].contents()


@lru_cache(maxsize=1)
def _read_files(settings: AisTable, files: Fingerprint) -> tuple[AisReports, AisStatics, Tally]:
    tally = Tally()
    parts = [_one_file(settings, path, feed, tally) for feed, (path, _, _) in enumerate(files)]
    reports, statics = by_arrival([p[0] for p in parts]), by_arrival([p[1] for p in parts])
    return reports, statics, tally


def _one_file(settings: AisTable, path: Path, feed: int, tally: Tally) -> tuple[AisReports, AisStatics]:
    table = read_table(path, settings.separator, tally)
    column = find_columns(table, "ais", settings.columns)
    need_columns(table, "ais", column, REQUIRED)
    table, values = good_cells(table, column, REQUIRED, settings.time_format, tally, _all_empty(table, column, MOTION))
    placed = np.isfinite(values["latitude"])
    received = values["received"]
    stamp, number = stamps_of(values), values["mmsi"]
    is_whole = (number == np.floor(number)) & (np.abs(number) < 1e12)
    mmsi = np.where(is_whole, number, -1.0).astype(np.int64)  # -1 is no MMSI
    class_b, station = classes(table, column["ais_class"], tally)
    of_courses = () if column["cog"] is None else angle_doubts(values["cog"], column["cog"], "course")
    missing = wrapped_cog(values["cog"])
    if missing == FULL_CIRCLE_DEG:
        values["cog"] = np.where(values["cog"] < 0.0, values["cog"] + FULL_CIRCLE_DEG, values["cog"])
    rows = AisRows(
        row=table.row,
        stamp_s=stamp,
        fix_s=np.where(np.isnan(received), np.nan, values["time"]),
        second=np.full(len(table), -1, np.int64),
        mmsi=mmsi,
        position_deg=np.stack([values["latitude"], values["longitude"]], axis=-1),
        sog_kn=values["sog"] * SPEED_KN[settings.speed_unit],
        cog_deg=values["cog"],
        class_b=class_b,
        digest=_digest(values),
        nav_status=nav_statuses(table, column["nav_status"], tally),
        accuracy=accuracies(table, column["accuracy"], column["raim"]),
        covariance=covariances(values, table, tally),
        station=station,
        heading_deg=values["heading"],
    ).take(placed)
    if missing and missing != FULL_CIRCLE_DEG:
        tally.add_rows(f"{WRAPPED_COG}{missing:g} is missing", values["cog"] < 0.0, table.location, table.example, used=True)
    statics, static_rows = static_data(table, column, values, mmsi, stamp, ~placed, tally)
    alone = np.isin(table.row, static_rows.row) & ~placed
    empty_at = partial(table.location, column=str(column["latitude"]))
    tally.add_rows(EMPTY_CELL, ~placed & ~alone, empty_at, table.example)
    intake = of_table(settings.intake, stamp)
    stream = Acceptance(intake, tally, lambda row: table.location(int(np.searchsorted(table.row, row))), feed)
    reports, static = stream.block(rows, statics, static_rows)
    course = np.radians(reports.cog_deg)
    velocity = (reports.sog_kn * KNOT_M_S)[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    of_speeds = doubts(reports.mmsi, reports.time_s, reports.position_deg, velocity, settings.speed_unit, "SOG")
    names = len(static_rows) - int(alone.sum()), len(static)
    notes = order_notes(settings.intake, intake, stream.backwards) + ((SIGNED_COG,) if missing == FULL_CIRCLE_DEG else ())
    if not of_speeds and column["sog"] is not None:
        of_speeds = speed_doubts(rows.sog_kn, HIGHEST_SOG_KN, settings.speed_unit, column["sog"])
    doubtful = of_speeds + of_courses
    tally.add_file(content_of(table, "AIS reports", column, reports.time_s, reports.position_deg, doubtful, names, notes))
    return reports, static


def wrapped_cog(cog_deg: Floats) -> float:
    """What is missing from negative courses that plainly are of a wrapped field: 409.6 (a signed number of 12 bits), 360, or 0.

    In twelve signed bits of a tenth of a degree the courses from 204.8 are negative, and "not available" is -49.6. So none lies
    between -49.6 and 0.
    """
    courses = cog_deg[np.isfinite(cog_deg)]
    negative = courses[courses < 0.0]
    if len(negative) < max(LEAST_WRAPPED_SHARE * len(courses), 2):
        return 0.0
    low, high, newest = float(courses.min()), float(courses.max()), float(negative.max())
    if low >= -204.85 and high <= 204.75 and newest <= -49.55:
        return 409.6
    return FULL_CIRCLE_DEG if low >= -180.05 and high <= 180.05 else 0.0


def _digest(values: dict[str, Floats]) -> Ints:
    """A number that is equal for equal time, position, SOG and COG."""
    cells = np.stack([np.nan_to_num(values[k], nan=-1.0) for k in ("time", "latitude", "longitude", "sog", "cog")], axis=-1)
    if not len(cells):
        return np.zeros(0, np.int64)
    order = np.lexsort(cells.T)
    new = np.concatenate([[True], (cells[order[1:]] != cells[order[:-1]]).any(axis=1)])
    number = np.empty(len(cells), np.int64)
    number[order] = np.cumsum(new)
    return number


def _all_empty(table: Table, column: dict[str, str | None], keys: tuple[str, ...]) -> Bools:
    """Which rows are empty in all of these columns, as far as the table has them. (M,)"""
    of_column = [table.empty(name).to_numpy() for key in keys if (name := column[key]) is not None]
    return np.asarray(np.logical_and.reduce(of_column), np.bool_)


def _cells(table: Table, column: str) -> Any:
    """The texts of a column in lower case, without blanks around them; empty where there is none."""
    return table.frame[column].cast(str).fill_null("").str.strip_chars().str.to_lowercase()


def classes(table: Table, column: str | None, tally: Tally) -> tuple[Bools, Ints]:
    """Which rows are of class B, and the StationKind of each. A text that names no class is counted, and taken as class A."""
    station = np.full(len(table), StationKind.UNKNOWN, np.int64)
    if column is None:
        return np.zeros(len(table), np.bool_), station
    cells = _cells(table, column)
    for kind, pattern in STATIONS.items():
        station[cells.str.contains(pattern).to_numpy()] = kind
    unknown = (station == StationKind.UNKNOWN) & ~cells.str.contains(VESSEL).to_numpy() & (cells != "").to_numpy()
    tally.add_rows(UNKNOWN_CLASS, unknown, lambda i: table.location(i, column), table.example, used=True)
    return cells.str.contains(r"^(class )?b\b").to_numpy(), station


def nav_statuses(table: Table, column: str | None, tally: Tally) -> Ints:
    """The NavStatus of each row, -1 where there is none. A cell that is none is counted."""
    if column is None:
        return np.full(len(table), -1, np.int64)
    cells = _cells(table, column)
    texts, at = np.unique(cells.to_numpy().astype("U"), return_inverse=True)
    status = np.array([_nav_status(text) for text in texts.tolist()], np.int64)[at.reshape(-1)]
    unknown = (status < 0) & (cells != "").to_numpy()
    tally.add_rows(UNKNOWN_STATUS, unknown, lambda i: table.location(i, column), table.example, used=True)
    return status


def _nav_status(text: str) -> int:
    try:
        number = int(float(text))
    except ValueError:
        return STATUS_WORDS.get(text.split(" (")[0], 15 if text.startswith("reserved") else -1)
    return number if 0 <= number <= NavStatus.UNDEFINED else -1


def accuracies(table: Table, accuracy: str | None, raim: str | None) -> Ints:
    """The PositionAccuracy of each row, -1 where nothing is stated."""
    accuracy_of_row = np.full(len(table), -1, np.int64)
    if accuracy is None:
        return accuracy_of_row
    yes, no = r"^(1|1\.0|true|yes|high)$", r"^(0|0\.0|false|no|low)$"
    cells = _cells(table, accuracy)
    monitored = np.zeros(len(table), np.bool_) if raim is None else _cells(table, raim).str.contains(yes).to_numpy()
    low = cells.str.contains(no).to_numpy()
    accuracy_of_row[low] = np.where(monitored[low], PositionAccuracy.LOW, PositionAccuracy.UNAIDED)
    accuracy_of_row[cells.str.contains(yes).to_numpy()] = PositionAccuracy.HIGH
    return accuracy_of_row


def covariances(values: dict[str, Floats], table: Table, tally: Tally) -> Floats:
    """The covariance of each position, NaN where the row has none; what is no covariance is counted. (M, 2, 2) m2"""
    ee, en, nn = (values[name] for name in POSITION_ENTRIES)
    square = np.sign(values["position_sigma_m"]) * values["position_sigma_m"] ** 2
    ee, nn, en = np.where(np.isnan(ee), square, ee), np.where(np.isnan(nn), square, nn), np.where(np.isnan(en), 0.0, en)
    is_stated = np.isfinite(ee) | np.isfinite(nn)
    good = (ee > 0.0) & (nn > 0.0) & (en**2 < ee * nn)
    tally.add_rows(NO_COVARIANCE, is_stated & ~good, table.location, table.example, used=True)
    covariance = np.stack([ee, en, en, nn], axis=-1).reshape(-1, 2, 2)
    covariance[~good] = np.nan
    return covariance
