"""Rows as an operator wants them: sorted, some of them, some of their columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.errors import InputError
from coastwatch.operators import presentation
from coastwatch.operators.columns import digits_of
from coastwatch.spelling import did_you_mean
from coastwatch.store import INSTANTS, Rows, Table


def selected(rows: Rows, sort: Sequence[str], limit: int | None, columns: Sequence[str]) -> Rows:
    """The rows sorted by some columns, the first of them, with these columns.

    Args: sort: names of columns, -NAME for descending; absent values come last. columns: none: all.
    Raises: InputError that names a column that is unknown, or that `columns` has twice.
    """
    names, kept = list(rows.columns), list(rows.rows)
    for key in reversed(sort):
        at, down = _at(names, key.removeprefix("-"), "--sort"), key.startswith("-")
        kept.sort(key=lambda row: (isinstance(row[at], str), 0 if row[at] is None else row[at]), reverse=down)  # texts apart
        kept.sort(key=lambda row: row[at] in (None, ""))
    places = [_at(names, name, "--columns") for name in columns] or range(len(names))
    for k, name in enumerate(columns):
        if name in columns[:k]:
            raise InputError(f"--columns: got {name!r} twice, needed each column once")
    return Rows(tuple(names[k] for k in places), [tuple(row[k] for k in places) for row in kept[:limit]])


def order(column: Callable[[str], Array], columns: Sequence[str], sort: Sequence[str]) -> Ints:
    """Row numbers in the order in which `selected` sorts the same rows for people: only the columns are read, and no row is formatted.

    Args: column: gives a column as the store has it; columns: their names; sort: names for people, -NAME for descending.
    Raises: InputError that names an unknown column.
    """
    names = [presentation.name_in_operator_units(name) for name in columns]
    keys = [(columns[_at(names, key.removeprefix("-"), "--sort")], key.startswith("-")) for key in sort]
    rows: Ints = np.arange(len(column(columns[0])))
    for name, down in reversed(keys):
        value, absent = _ranked(name, column(name)[rows])
        rows = rows[np.lexsort((-value if down else value, absent))]
    return rows


def _ranked(name: str, values: Array) -> tuple[Array, Array]:
    """Numbers that sort as the values do for people, and which values are absent. (N,), (N,)"""
    if values.dtype.kind == "f":
        absent = np.isnan(values)
        if name in INSTANTS:
            return np.floor(np.where(absent, 0.0, values) * 1e3), absent
        digits = np.round(np.where(absent, 0.0, values), digits_of(name))
        return digits % 360.0 if name in presentation.COURSES else digits, absent
    if values.dtype.kind in "iu" and name not in presentation.WORDS:
        return values, values == -1
    if values.dtype.kind in "iu":  # few different ones
        values, which = np.unique(values, return_inverse=True)
        words = [row[0] or "" for row in presentation.in_operator_units(Table((name,), (values,))).rows]
        texts = np.array(words, "U")[which]
    else:
        texts = np.where(values == np.array(None), "", values).astype("U")
    return np.unique(texts, return_inverse=True)[1], texts == ""


def _at(names: Sequence[str], name: str, option: str) -> int:
    if name not in names:
        raise InputError(f"{option}: got {name!r}, needed some of {', '.join(names)}{did_you_mean(name, names)}")
    return names.index(name)
