"""Plain data as a tree of JSON values and a list of arrays, and back: for checkpoints, and for other processes.

Plain data is None, bool, int, float, str, an array, a numpy scalar, or a tuple, list, dict, dataclass or named tuple of plain data.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np

from coastwatch.batches.struct import Array

Modules = tuple[str, ...]
"""Modules, and packages with their modules, whose dataclasses and named tuples a tree may name. No other class is made."""


class TreeError(ValueError):
    """A tree from which no value can be made, with the reason."""


def to_tree(value: Any, modules: Modules) -> tuple[Any, list[Array]]:
    """The value as JSON, with each array replaced by its number in the list. Raises: TypeError: it is not plain data of these modules."""
    arrays: list[Array] = []
    return _to_tree(value, arrays, modules), arrays


def from_tree(tree: Any, arrays: Sequence[Array], modules: Modules) -> Any:
    """The value of which `to_tree` made this tree, with these arrays. Only classes of these modules are called.

    Raises: TreeError: the tree names a class or a field that does not exist, or the arrays hold a row number that is out of range.
    """
    if isinstance(tree, list):
        return [from_tree(item, arrays, modules) for item in tree]
    if not isinstance(tree, dict):
        return tree
    match tree:
        case {"array": number}:
            return arrays[number]
        case {"scalar": number}:
            return arrays[number][()]
        case {"tuple": items}:
            return tuple(from_tree(item, arrays, modules) for item in items)
        case {"dict": items}:
            return {from_tree(key, arrays, modules): from_tree(item, arrays, modules) for key, item in items}
        case {"class": str(name), "fields": dict(given)}:
            made = _class_named(name, modules)
            if made is None:
                raise TreeError(f"it names the class {name}, which is not one of this version's")
            if tuple(given) != _fields_of(made):
                raise TreeError(f"{name}: got the fields {', '.join(given)}, needed {', '.join(_fields_of(made))}")
            return _checked(made(**{field: from_tree(item, arrays, modules) for field, item in given.items()}))
    raise TreeError(f"it has a part of unknown kind: {', '.join(map(str, tree))}")


def _to_tree(value: Any, arrays: list[Array], modules: Modules) -> Any:
    """As `to_tree`. Args: arrays: the arrays of the value are appended to it."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_to_tree(item, arrays, modules) for item in value]
    if kind is tuple:
        return {"tuple": [_to_tree(item, arrays, modules) for item in value]}
    if kind is dict:
        return {"dict": [[_to_tree(key, arrays, modules), _to_tree(item, arrays, modules)] for key, item in value.items()]}
    if kind is np.ndarray or isinstance(value, np.generic):
        if value.dtype.hasobject:
            raise TypeError("plain data: got an array of objects, needed numbers, texts or records of them")
        arrays.append(np.asarray(value))
        return {"array" if kind is np.ndarray else "scalar": len(arrays) - 1}
    name = f"{kind.__module__}.{kind.__qualname__}"
    if _class_named(name, modules) is not kind:
        raise TypeError(f"plain data: got a {name}, needed an array, a number, a text or a dataclass of {', '.join(modules)}")
    return {"class": name, "fields": {field: _to_tree(getattr(value, field), arrays, modules) for field in _fields_of(kind)}}


def _checked(value: Any) -> Any:
    """A value whose row numbers are in range: kernels take them on trust. Raises: TreeError that names the field."""
    check = getattr(value, "check_rows", None)
    if check is not None:
        try:
            check()
        except ValueError as error:
            raise TreeError(f"it is damaged: {error}") from error
    return value


def _fields_of(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else tuple(kind._fields)  # type: ignore[attr-defined]


@cache
def _class_named(name: str, modules: Modules) -> type | None:
    """The dataclass or named tuple of this full name that one of the modules defines; None if there is none."""
    module, _, attribute = name.rpartition(".")
    if module not in _with_their_modules(modules):
        return None
    found = getattr(importlib.import_module(module), attribute, None)
    if not isinstance(found, type) or found.__module__ != module:
        return None
    return found if is_dataclass(found) or (issubclass(found, tuple) and hasattr(found, "_fields")) else None


@cache
def _with_their_modules(names: Modules) -> frozenset[str]:
    """The modules of these names and those in their packages, listed from their folders."""
    inside = []
    for name in names:
        folder = getattr(importlib.import_module(name), "__path__", None)
        inside += [module.name for module in pkgutil.walk_packages(folder, f"{name}.")] if folder else []
    return frozenset((*names, *inside))
