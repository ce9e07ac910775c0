"""Some of the rows of a cycle, with what is needed to work on them alone: numba, linear passes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks

Ints = NDArray[np.int64]
Array = NDArray[Any]


@jit
def _mark(row, rank, place):  # type: ignore[no-untyped-def]
    for at in range(len(row)):
        place[rank[row[at] if row[at] >= 0 else -1 - row[at]]] = 1


@jit
def _number(place, out):  # type: ignore[no-untyped-def]
    count = 0
    for r in range(len(place)):
        if place[r] > 0:
            out[count], place[r] = r, count
            count += 1
        else:
            place[r] = -1
    return count


def cut(row: Ints, rank: Array) -> tuple[Ints, Array]:
    """The ranks that rows of groups have, ascending.

    Args: row: (L,) rows of groups, those of a halo as -1 - row; rank: (N,) of each row.
    Returns: (n,) ranks; (N,) where each rank is among them, -1 where it is not.
    """
    place, out = np.zeros(len(rank), np.int32), np.empty(len(rank), np.int64)
    _mark(row, rank, place)
    return out[: _number(place, out)], place


@jit
def _words(low, high, words, rows, out):  # type: ignore[no-untyped-def]
    for n in range(low, high):
        for word in range(words.shape[1]):
            out[n, word] = words[rows[n], word]


def rows_of(array: Array, rows: Ints) -> Array:
    """These rows of an array. Args: array: (N, ...); rows: (n,). Returns: (n, ...)."""
    array = np.ascontiguousarray(array)
    out = np.empty((len(rows), *array.shape[1:]), array.dtype)
    if out.size:
        width = array.dtype.itemsize * (array.size // len(array))
        word = np.dtype(f"u{next(size for size in (8, 4, 2, 1) if width % size == 0)}")
        as_words = array.view(np.uint8).reshape(len(array), width).view(word)
        in_blocks(_words, len(rows), as_words, rows, out.view(np.uint8).reshape(len(rows), width).view(word))
    return out
