"""Of many rows in time the newest of each number that names something."""

import numpy as np

from coastwatch.kernels.jit import jit

SPREAD = 16
"""Numbers a row up to which each number has a place of its own, which costs one look into memory where hashing costs three."""


@jit
def newest_rows(number, when, out):  # type: ignore[no-untyped-def]
    """The row of each number with the greatest time, the later row of equals; returns how many there are.

    Args: number: (N,), when: (N,) int64; out: (N,) rows, in the order of their numbers where these lie close together, else in that
    in which they first came.
    """
    if len(number) == 0:
        return 0
    low, high = number.min(), number.max()
    if high - low < SPREAD * len(number):
        return _by_place(number, when, low, np.full(high - low + 1, -1, np.int32), out)
    return _by_hash(number, when, out)


@jit
def _by_place(number, when, low, row, out):  # type: ignore[no-untyped-def]
    """Args: row: (numbers from `low` on,) all -1."""
    for i in range(len(number)):
        before = row[number[i] - low]
        if before < 0 or when[i] >= when[before]:
            row[number[i] - low] = i
    count = 0
    for k in range(len(row)):
        if row[k] >= 0:
            out[count] = row[k]
            count += 1
    return count


@jit
def _by_hash(number, when, out):  # type: ignore[no-untyped-def]
    size = 1
    while size < 2 * len(number):
        size *= 2
    slot = np.full(size, -1, np.int64)
    count = 0
    for i in range(len(number)):
        at = (number[i] * 2654435761 >> 15) & (size - 1)
        while slot[at] >= 0 and number[out[slot[at]]] != number[i]:
            at = (at + 1) & (size - 1)
        if slot[at] < 0:
            slot[at] = count
            out[count] = i
            count += 1
        elif when[i] >= when[out[slot[at]]]:
            out[slot[at]] = i
    return count
