"""Plain data as a tree of JSON values and a list of arrays, and back: for checkpoints, and for other processes.

Plain data is None, bool, int, float, str, an array, a numpy scalar, or a tuple, list, dict, dataclass or named tuple of plain data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np

from coastwatch.kernels.arrays import Array

Classes = frozenset[type]
"""Dataclasses and named tuples that a tree may name. No other class is made."""

FORMER_NAMES = {
    "coastwatch.tracks.ais.out_of_sequence.Memory": "coastwatch.tracks.ais.out_of_sequence.AisMemory",
    "coastwatch.tracks.bearing.BearingMemory": "coastwatch.tracks.bearing.memory.BearingMemory",
}
"""Names in trees of earlier versions, and what the classes are called now: a run goes on over an upgrade."""


def classes_in(*kinds: object) -> Classes:
    """The dataclasses and named tuples that values of these types may hold: of fields and of items, however deep."""
    found: set[type] = set()
    rest = list(kinds)
    while rest:
        kind = rest.pop()
        rest += get_args(kind)
        if isinstance(kind, type) and kind not in found and (is_dataclass(kind) or hasattr(kind, "_fields")):
            found.add(kind)
            rest += get_type_hints(kind).values()
    return frozenset(found)


class TreeError(ValueError):
    """A tree from which no value can be made, with the reason."""


def to_tree(value: object, classes: Classes) -> tuple[object, list[Array]]:
    """The value as JSON, with each array replaced by its number in the list. Raises: TypeError: it is not plain data of these classes."""
    arrays: list[Array] = []
    return _to_tree(value, arrays, classes), arrays


def from_tree(tree: object, arrays: Sequence[Array], classes: Classes) -> Any:
    """The value of which `to_tree` made this tree, with these arrays. Only these classes are called.

    A field that the tree lacks has its default: it is newer than the tree.
    Raises: TreeError: the tree names a class or a field that does not exist, or the arrays hold a row number that is out of range.
    """
    if isinstance(tree, list):
        return [from_tree(item, arrays, classes) for item in tree]
    if not isinstance(tree, dict):
        return tree
    match tree:
        case {"array": number}:
            return arrays[number]
        case {"scalar": number}:
            return arrays[number][()]
        case {"tuple": items}:
            return tuple(from_tree(item, arrays, classes) for item in items)
        case {"dict": items}:
            return {from_tree(key, arrays, classes): from_tree(item, arrays, classes) for key, item in items}
        case {"class": str(name), "fields": dict(given)}:
            made = _by_name(classes).get(FORMER_NAMES.get(name, name))
            if made is None:
                raise TreeError(f"it names the class {name}, which is not one of this version's")
            absent, unknown = _needed_of(made) - given.keys(), given.keys() - _fields_of(made)
            if absent or unknown:
                raise TreeError(f"{name}: got the fields {', '.join(given)}, needed {', '.join(_fields_of(made))}")
            value = made(**{field: from_tree(item, arrays, classes) for field, item in given.items()})
            try:
                getattr(value, "check_rows", lambda: None)()  # kernels take row numbers on trust
            except ValueError as error:
                raise TreeError(f"it is damaged: {error}") from error
            return value
    raise TreeError(f"it has a part of unknown kind: {', '.join(map(str, tree))}")


def _to_tree(value: Any, arrays: list[Array], classes: Classes) -> object:
    """As `to_tree`. Args: arrays: the arrays of the value are appended to it."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_to_tree(item, arrays, classes) for item in value]
    if kind is tuple:
        return {"tuple": [_to_tree(item, arrays, classes) for item in value]}
    if kind is dict:
        return {"dict": [[_to_tree(key, arrays, classes), _to_tree(item, arrays, classes)] for key, item in value.items()]}
    if kind is np.ndarray or isinstance(value, np.generic):
        if value.dtype.hasobject:
            raise TypeError("plain data: got an array of objects, needed numbers, texts or records of them")
        arrays.append(np.asarray(value))
        return {"array" if kind is np.ndarray else "scalar": len(arrays) - 1}
    if kind not in classes:
        raise TypeError(f"plain data: got a {_name(kind)}, needed an array, a number, a text or a declared dataclass")
    return {
        "class": _name(kind),
        "fields": {field: _to_tree(getattr(value, field), arrays, classes) for field in _fields_of(kind)},
    }


def _fields_of(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else tuple(kind._fields)  # type: ignore[attr-defined]


@cache
def _needed_of(kind: type) -> frozenset[str]:
    """The fields without a default."""
    if is_dataclass(kind):
        return frozenset(f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING)
    return frozenset(set(_fields_of(kind)) - set(kind._field_defaults))  # type: ignore[attr-defined]


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


@cache
def _by_name(classes: Classes) -> dict[str, type]:
    return {_name(kind): kind for kind in classes}
