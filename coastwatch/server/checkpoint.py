"""A run's memory as bytes: an npz file of its arrays, and a JSON tree with the rest. It holds data only, never code."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.batches.plain_data import TreeError, from_tree, to_tree
from coastwatch.pipeline import Memory
from coastwatch.scores import Tally

MODULES_WITH_CLASSES = (
    "coastwatch.batches",
    "coastwatch.plots",
    "coastwatch.tracks",
    "coastwatch.spots",
    "coastwatch.associations",
    "coastwatch.kernels.association.history",
    "coastwatch.kernels.fusion.cross_covariance",
    "coastwatch.fused_tracks",
    "coastwatch.picture",
    "coastwatch.registration",
    "coastwatch.cover",
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

    Args: value: plain data (`coastwatch.batches.plain_data`) with classes of MODULES_WITH_CLASSES. An array keeps its dtype, shape and
    order (C or Fortran), not what it shares.
    Raises: TypeError: anything else.
    """
    tree, arrays = to_tree(value, MODULES_WITH_CLASSES)
    text = json.dumps(tree, separators=(",", ":")).encode()
    members: dict[str, Any] = {TREE: np.frombuffer(text, np.uint8)}
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
            members = {name: file[name] for name in file.files}
        tree = json.loads(members.pop(TREE).tobytes())
        return from_tree(tree, [members[str(number)] for number in range(len(members))], MODULES_WITH_CLASSES)
    except TreeError as error:
        raise CheckpointError(str(error)) from error
    except Exception as error:  # any error of zipfile, numpy or json on damaged bytes
        raise CheckpointError(f"it is damaged: {type(error).__name__}: {error}") from error
