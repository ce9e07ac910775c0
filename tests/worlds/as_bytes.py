"""Anything of batches as bytes, to compare two of them to the bit: a checkpoint holds memory alone."""

from __future__ import annotations

import json
from typing import Any

from coastwatch import batches
from coastwatch.batches.hearing import Hearing, SensorHearing
from coastwatch.batches.plain_data import classes_in, to_tree
from coastwatch.server import checkpoint


def as_bytes(value: Any) -> bytes:
    """The same for values that are equal to the bit. Args: value: plain data with batches, or memory."""
    kinds = (kind for kind in vars(batches).values() if isinstance(kind, type))
    tree, arrays = to_tree(value, classes_in(*kinds, Hearing, SensorHearing) | checkpoint.classes())
    return json.dumps(tree).encode() + b"".join(repr((a.dtype, a.shape)).encode() + a.tobytes() for a in arrays)


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal to the bit."""
    return as_bytes(one) == as_bytes(other)
