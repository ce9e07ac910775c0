"""Cells of AIS tables that name a class, a navigational status or an accuracy, or give the covariance of a position."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, NavStatus, PositionAccuracy, nav_status_text
from coastwatch.formats.intake.ais_validation import StationKind
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.tables.reader import Table
from coastwatch.sensors.recorded.tables.rows import POSITION_ENTRIES

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
