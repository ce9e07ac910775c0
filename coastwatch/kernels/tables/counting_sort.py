"""Counting sort: rows in groups by a small whole number that each has, such as the tracks of each vessel. Linear."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit


@jit
def counting_sort(group, count):  # type: ignore[no-untyped-def]
    """The rows of each group, in order: those of group g are row[start[g]:start[g + 1]].

    Args: group: (N,) of each row, 0 to count - 1. Returns: start (count + 1,), row (N,), int32.
    """
    start = np.zeros(count + 2, np.int32)
    for g in group:
        start[g + 2] += 1
    for g in range(2, count + 2):
        start[g] += start[g - 1]
    row = np.empty(len(group), np.int32)
    for n in range(len(group)):
        row[start[group[n] + 1]] = n
        start[group[n] + 1] += 1
    return start[: count + 1], row


@jit
def longest(low, high, start):  # type: ignore[no-untyped-def]
    """The rows of the largest of the groups low to high; 1 where there is none."""
    most = 1
    for g in range(low, high):
        most = max(most, start[g + 1] - start[g])
    return most


@jit
def preferred(start, row, preference):  # type: ignore[no-untyped-def]
    """The rows of each group in order of preference (N,), the smallest first, equal ones as they come. Returns: (N,)."""
    out = row.copy()
    for g in range(len(start) - 1):
        for k in range(start[g] + 1, start[g + 1]):
            n, at = out[k], k
            while at > start[g] and preference[out[at - 1]] > preference[n]:
                out[at] = out[at - 1]
                at -= 1
            out[at] = n
    return out
