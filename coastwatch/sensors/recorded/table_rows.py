"""Rows of tables: which have readable cells, which sensor each is of, and when it arrived."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from coastwatch.batches import Array, FileContent, Floats, Ints
from coastwatch.sensors.recorded.ais_validation import NON_FINITE, AisIntake
from coastwatch.sensors.recorded.faults import Tally
from coastwatch.sensors.recorded.reception_time import reception_times
from coastwatch.sensors.recorded.table_reader import Table

EMPTY_CELL, BAD_CELL = "empty cell", "unparsable cell"
TEXTS = ("radar", "sonar", "source", "track", "name", "call_sign", "ais_class", "nav_status", "accuracy", "raim")
"""Keys of columns that hold texts."""
MAY_BE_UNREADABLE = ("name", "call_sign", "ship_type", "length", "beam")
"""Keys whose unreadable cells do not make a row unusable."""
POSITION_ENTRIES = ("covariance_east_east", "covariance_east_north", "covariance_north_north")
"""Columns of the covariance of a position, m2, as `coastwatch replay` writes them."""


def good_cells(
    table: Table, column: dict[str, str | None], required: tuple[str, ...], time_format: str, tally: Tally
) -> tuple[Table, dict[str, Floats]]:
    """The rows whose required cells all have a number and whose other cells are readable, and their numbers by key.

    Keys "time" and "received" are times; those of TEXTS are not checked.
    """
    good = np.ones(len(table), np.bool_)
    values: dict[str, Floats] = {}
    for key, name in column.items():
        if key in TEXTS:
            continue
        made, bad = table.times(name, time_format) if key in ("time", "received") else table.numbers(name)
        if key in MAY_BE_UNREADABLE:
            bad = np.zeros(len(table), np.bool_)  # an unreadable length does not invalidate the position
        empty = table.empty(name).to_numpy() if name is not None and key in required else np.zeros(len(table), np.bool_)
        infinite = np.isinf(made) | (np.isnan(made) & ~empty & ~bad if key in required else False)
        infinite = infinite & (key not in MAY_BE_UNREADABLE)
        for kind, mask in ((EMPTY_CELL, empty), (BAD_CELL, bad), (NON_FINITE, infinite)):
            tally.add_rows(kind, good & mask, partial(table.location, column=str(name)), table.example)
            good &= ~mask
        values[key] = made
    return table.at(good), {key: made[good] for key, made in values.items()}


def content_of(table: Table, kind: str, column: dict[str, str | None], time_s: Floats) -> FileContent:
    """What was taken from a table. Args: column: of the file, by our names; time_s: (M,) of the records taken."""
    read = tuple((key, name) for key, name in column.items() if name is not None)
    used = {name for _, name in read}
    first_s, last_s = (float(time_s.min()), float(time_s.max())) if len(time_s) else (math.nan, math.nan)
    ignored = tuple(name for name in table.frame.columns if name not in used)
    return FileContent(table.name, kind, len(time_s), first_s, last_s, read, ignored)


def arrived(table: Table, stamp: Floats, intake: AisIntake, tally: Tally) -> tuple[Array, Floats]:
    """The rows whose time is accepted, in order of arrival, and their reception times."""
    order = np.argsort(stamp, kind="stable") if intake.order == "time" else np.arange(len(stamp))
    arrived = reception_times(stamp[order], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in arrived.faults.items():
        tally.add_rows(kind, mask, lambda i: table.location(int(order[i])), lambda i: table.example(int(order[i])))
    return order[arrived.accepted], arrived.received_s[arrived.accepted]


def sensor_numbers(table: Table, column: str | None, names: Array, kind: str, tally: Tally) -> Ints:
    """The number of the sensor of each row, -1 for an unknown name. A single sensor needs no name."""
    if column is None and len(names) == 1:
        return np.zeros(len(table), np.int64)
    if column is None:
        tally.add_rows(EMPTY_CELL, np.ones(len(table), np.bool_), table.location, table.example)
        return np.full(len(table), -1, np.int64)
    names_found, number = np.unique(np.array(table.texts(column), "U"), return_inverse=True)
    known = {str(n): i for i, n in enumerate(names)}
    out = np.array([known.get(str(n), -1) for n in names_found], np.int64)[number]
    tally.add_rows(
        kind, out < 0, lambda i: table.location(i, column), lambda i: f"{names_found[number[i]]!s}, known: {sorted(known)}"
    )
    return out
