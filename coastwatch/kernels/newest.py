"""Of many rows in time the newest of each number that names something."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def newest_rows(number, when, out):  # type: ignore[no-untyped-def]
    """The row of each number with the greatest time, the later row of equals; returns how many there are.

    Args: number: (N,), when: (N,) int64; out: (N,) rows, in the order in which the numbers first came.
    """
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
