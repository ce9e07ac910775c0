"""A run's memory as bytes: an npz file of its arrays, and a JSON tree with the rest. It holds data only, never code."""

from __future__ import annotations

import importlib
import io
import json
import pkgutil
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np

from coastwatch.batches import Array
from coastwatch.pipeline import Memory
from coastwatch.scores import Tally

MODULES_WITH_CLASSES = (
    "coastwatch.batches",
    "coastwatch.plots",
    "coastwatch.tracks",
    "coastwatch.spots",
    "coastwatch.associations",
    "coastwatch.kernels.association.history",
    "coastwatch.fused_tracks",
    "coastwatch.picture",
    "coastwatch.registration",
    "coastwatch.scores",
    "coastwatch.stage",
    "coastwatch.pipeline",
    "coastwatch.server.checkpoint",
)
"""Modules, and packages with their modules, whose dataclasses and named tuples a checkpoint may hold. No other class is made."""

TREE = "tree"  # the member of the npz file that holds the JSON text


class CheckpointError(ValueError):
    """A checkpoint that cannot be read, with the reason."""


@dataclass(frozen=True)
class Point:
    """The state of a run between two cycles: all that is needed to resume it."""

    cycle: int  # the next one
    memory: Memory
    tally: Tally


def save(value: Any) -> bytes:
    """Bytes from which `load` makes an equal value.

    Args: value: None, bool, int, float, str, array, numpy scalar, tuple, list, dict, or a dataclass or named tuple of
    MODULES_WITH_CLASSES, nested as deep as wanted. An array keeps its dtype, shape and order (C or Fortran), not what it shares.
    Raises: TypeError: anything else.
    """
    arrays: list[Array] = []
    tree = json.dumps(_to_tree(value, arrays), separators=(",", ":")).encode()
    members: dict[str, Any] = {TREE: np.frombuffer(tree, np.uint8)}
    members |= {str(number): array for number, array in enumerate(arrays)}
    out = io.BytesIO()
    np.savez(out, **members)
    return out.getvalue()


def load(saved: bytes) -> Any:
    """The value that `save` was given, with arrays of its own. Only classes of MODULES_WITH_CLASSES are called.

    Raises: CheckpointError: the bytes are not of `save`, are damaged, name a class or a field that does not exist, or hold a row
    number that is out of range.
    """
    if not saved.startswith(b"PK"):
        raise CheckpointError("it is not in the format of this version")
    try:
        with np.load(io.BytesIO(saved)) as file:  # numpy refuses arrays of objects by default
            arrays = {name: file[name] for name in file.files}
        return _from_tree(json.loads(arrays.pop(TREE).tobytes()), arrays)
    except CheckpointError:
        raise
    except Exception as error:  # any error of zipfile, numpy or json on damaged bytes
        raise CheckpointError(f"it is damaged: {type(error).__name__}: {error}") from error


def _to_tree(value: Any, arrays: list[Array]) -> Any:
    """The value as JSON, with each array replaced by its number in `arrays`, to which it is appended."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_to_tree(item, arrays) for item in value]
    if kind is tuple:
        return {"tuple": [_to_tree(item, arrays) for item in value]}
    if kind is dict:
        return {"dict": [[_to_tree(key, arrays), _to_tree(item, arrays)] for key, item in value.items()]}
    if kind is np.ndarray or isinstance(value, np.generic):
        if value.dtype.hasobject:
            raise TypeError("checkpoint: got an array of objects, needed numbers, texts or records of them")
        arrays.append(np.asarray(value))
        return {"array" if kind is np.ndarray else "scalar": len(arrays) - 1}
    name = f"{kind.__module__}.{kind.__qualname__}"
    if _class_named(name) is not kind:
        raise TypeError(f"checkpoint: got a {name}, needed an array, a number, a text or a dataclass of a stage")
    return {"class": name, "fields": {field: _to_tree(getattr(value, field), arrays) for field in _fields_of(kind)}}


def _from_tree(tree: Any, arrays: dict[str, Array]) -> Any:
    """The value of which `_to_tree` made this tree."""
    if isinstance(tree, list):
        return [_from_tree(item, arrays) for item in tree]
    if not isinstance(tree, dict):
        return tree
    match tree:
        case {"array": number}:
            return arrays[str(number)]
        case {"scalar": number}:
            return arrays[str(number)][()]
        case {"tuple": items}:
            return tuple(_from_tree(item, arrays) for item in items)
        case {"dict": items}:
            return {_from_tree(key, arrays): _from_tree(item, arrays) for key, item in items}
        case {"class": str(name), "fields": dict(given)}:
            made = _class_named(name)
            if made is None:
                raise CheckpointError(f"it names the class {name}, which is not one of this version's")
            if tuple(given) != _fields_of(made):
                raise CheckpointError(f"{name}: got the fields {', '.join(given)}, needed {', '.join(_fields_of(made))}")
            return _checked(made(**{field: _from_tree(item, arrays) for field, item in given.items()}))
    raise CheckpointError(f"it has a part of unknown kind: {', '.join(map(str, tree))}")


def _checked(value: Any) -> Any:
    """A value whose row numbers are in range: kernels take them on trust. Raises: CheckpointError that names the field."""
    check = getattr(value, "check_rows", None)
    if check is not None:
        try:
            check()
        except ValueError as error:
            raise CheckpointError(f"it is damaged: {error}") from error
    return value


def _fields_of(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else tuple(kind._fields)  # type: ignore[attr-defined]


@cache
def _class_named(name: str) -> type | None:
    """The dataclass or named tuple of this full name that one of MODULES_WITH_CLASSES defines; None if there is none."""
    module, _, attribute = name.rpartition(".")
    if module not in _modules():
        return None
    found = getattr(importlib.import_module(module), attribute, None)
    if not isinstance(found, type) or found.__module__ != module:
        return None
    return found if is_dataclass(found) or (issubclass(found, tuple) and hasattr(found, "_fields")) else None


@cache
def _modules() -> frozenset[str]:
    """MODULES_WITH_CLASSES and the modules in their packages, listed from their folders."""
    inside = []
    for name in MODULES_WITH_CLASSES:
        folder = getattr(importlib.import_module(name), "__path__", None)
        inside += [module.name for module in pkgutil.walk_packages(folder, f"{name}.")] if folder else []
    return frozenset((*MODULES_WITH_CLASSES, *inside))
