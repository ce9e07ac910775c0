"""Rows as an operator wants them: sorted, some of them, some of their columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.export import Rows
from coastwatch.spelling import did_you_mean
from coastwatch.store import Rows as Made


def selected(rows: Rows, sort: Sequence[str], limit: int | None, columns: Sequence[str]) -> Made:
    """The rows sorted by some columns, the first of them, with these columns.

    Args: sort: names of columns, -NAME for descending; absent values come last. columns: none: all.
    Raises: BadInput that names an unknown column.
    """
    names, made = list(rows.columns), list(rows.rows)
    for key in reversed(sort):
        at, down = _at(names, key.removeprefix("-"), "--sort"), key.startswith("-")
        made.sort(key=lambda row: _order(row[at]), reverse=down)
        made.sort(key=lambda row: row[at] in (None, ""))
    places = [_at(names, name, "--columns") for name in columns] or range(len(names))
    return Made(tuple(names[k] for k in places), [tuple(row[k] for k in places) for row in made[:limit]])


def _at(names: Sequence[str], name: str, option: str) -> int:
    if name not in names:
        raise BadInput(f"{option}: got {name!r}, needed some of {', '.join(names)}{did_you_mean(name, names)}")
    return names.index(name)


def _order(value: Any) -> tuple[bool, Any]:
    """Sorts texts apart from numbers."""
    return (isinstance(value, str), 0 if value is None else value)
