"""Static data of vessels in tables of AIS: names, call signs, types in numbers or words, and sizes."""

from __future__ import annotations

import re

import numpy as np

from coastwatch.batches import AisStatics, Array, Bools, Floats, Ints
from coastwatch.formats.intake.ais_validation import StaticRows
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.tables.reader import NO_VALUE, Table
from coastwatch.sensors.recorded.tables.rows import ANTENNA

UNKNOWN_TYPE = SET_ASIDE + "unknown ship type, taken as not sent"
NOT_SENT = -1
MOST_SIDES_M = np.array([[511.0], [511.0], [63.0], [63.0]])  # ANTENNA, that a message can hold: ITU-R M.1371-5, annex 8, 3.3.3
LONGEST_TEXT = 64  # characters of a name or a word of a type that are looked at
TYPE_WORDS = {
    "wig": 20,
    "wing in ground": 20,
    "fishing": 30,
    "towing": 31,
    "towing long/wide": 32,
    "dredging": 33,
    "dredger": 33,
    "diving": 34,
    "military": 35,
    "sailing": 36,
    "pleasure": 37,
    "reserved": 38,
    "hsc": 40,
    "high speed": 40,
    "pilot": 50,
    "sar": 51,
    "search and rescue": 51,
    "tug": 52,
    "port tender": 53,
    "anti-pollution": 54,
    "law enforcement": 55,
    "spare 1": 56,
    "spare 2": 57,
    "medical": 58,
    "not party to conflict": 59,
    "passenger": 60,
    "cargo": 70,
    "tanker": 80,
    "other": 90,
}
"""Codes of ITU-R M.1371 by the words of the Danish Maritime Authority, and some of other authorities."""
MORE_WORDS = r"(,| - | ?\().*$|[ _](vessel|ship|craft|boat|type)s?$"
"""What may follow these: "Cargo, hazardous category A", "Tanker (all)", "Fishing vessel"."""


def static_data(
    table: Table,
    column: dict[str, str | None],
    values: dict[str, Floats],
    mmsi: Ints,
    stamp: Floats,
    without_position: Bools,
    tally: Tally,
) -> tuple[AisStatics, StaticRows]:
    """Static data of the rows that say something new of their vessel, and of those that say nothing else.

    What a row leaves out is as in the row before.
    Args: values, mmsi, stamp, without_position: (M,) of the rows of the table.
    """
    code = ship_types(table, column["ship_type"], values["ship_type"], tally)
    of_antenna = np.stack([values[key] for key in ANTENNA])
    possible = ((of_antenna >= 0.0) & (of_antenna <= MOST_SIDES_M)).all(axis=0)
    of_antenna[:, ~(possible & (of_antenna[0] + of_antenna[1] > 0.0))] = np.nan  # zeros: not sent
    to_bow, to_stern, to_port, to_starboard = of_antenna
    length, beam = (
        np.where(values[k] > 0.0, values[k], np.where(whole > 0.0, whole, np.nan))
        for k, whole in (("length", to_bow + to_stern), ("beam", to_port + to_starboard))
    )
    cells: tuple[Array, ...] = (
        _names(table, column["name"], "U20"),
        _names(table, column["call_sign"], "U7"),
        np.where(code > 0, code, NOT_SENT),
        length,
        beam,
        *of_antenna,
    )
    stated = [cells[0] != "", cells[1] != "", cells[2] > 0, *(np.isfinite(size) for size in cells[3:])]
    order = np.argsort(mmsi, kind="stable")
    order = order[np.logical_or.reduce(stated)[order]]
    begins = np.ones(len(order), np.bool_)
    begins[1:] = mmsi[order[1:]] != mmsi[order[:-1]]
    filled = [cell[order[_last_stated(known[order], begins)]] for cell, known in zip(cells, stated, strict=True)]
    differs = begins | without_position[order]
    for cell in filled:
        comparable = np.nan_to_num(cell) if cell.dtype == np.float64 else cell
        differs[1:] |= comparable[1:] != comparable[:-1]
    kept = np.flatnonzero(differs)
    kept = kept[np.argsort(order[kept])]
    rows = order[kept]
    statics = AisStatics(stamp[rows], mmsi[rows], *(cell[kept] for cell in filled))
    number = np.arange(len(rows), dtype=np.int64)
    return statics, StaticRows(row=table.row[rows], stamp_s=stamp[rows], digest=number, static=number)


def _last_stated(known: Bools, begins: Bools) -> Ints:
    """The last row, up to each, of the same vessel that states a value; the row itself where none does. Args: begins: of a vessel."""
    row = np.arange(len(known))
    last = np.maximum.accumulate(np.where(known, row, -1))
    return np.where(last >= np.maximum.accumulate(np.where(begins, row, 0)), last, row)


def _names(table: Table, column: str | None, kind: str) -> Array:
    """The texts of a column, empty where they stand for no value."""
    texts = np.array([text[:LONGEST_TEXT] for text in table.texts(column)], "U")  # an array is as wide as its longest text
    if column is not None:
        found, at = np.unique(texts, return_inverse=True)
        texts = np.array([re.sub(NO_VALUE, "", text) for text in found.tolist()], "U")[at.reshape(-1)]
    return texts.astype(kind)


def ship_types(table: Table, column: str | None, number: Floats, tally: Tally) -> Ints:
    """The code of ITU-R M.1371 of each row, NOT_SENT where it has none. A word that names no type is counted."""
    code = np.nan_to_num(number, nan=NOT_SENT, posinf=NOT_SENT, neginf=NOT_SENT).astype(np.int64)
    worded = np.flatnonzero(np.isnan(number))
    if column is None or not len(worded):
        return code
    words, at = np.unique(_names(table.at(worded), column, "U"), return_inverse=True)
    of_word = np.array([_type_of(word) for word in words.tolist()], np.int64)
    code[worded] = of_word[at.reshape(-1)]
    unknown = np.zeros(len(table), np.bool_)
    unknown[worded] = ((of_word == NOT_SENT) & (words != ""))[at.reshape(-1)]
    tally.add_rows(UNKNOWN_TYPE, unknown, lambda i: table.location(i, column), table.example, used=True)
    return code


def _type_of(word: str) -> int:
    text = word.lower()
    return TYPE_WORDS.get(text, TYPE_WORDS.get(re.sub(MORE_WORDS, "", re.sub(MORE_WORDS, "", text)), NOT_SENT))
