"""Rows sorted by a small whole number, by counting, over threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import blocks, in_blocks

Ints = NDArray[np.int64]

LEAST_ROWS = 1 << 16  # a part; under it the threads cost more than they gain


@jit
def _count(low, high, parts, key, out):  # type: ignore[no-untyped-def]
    for part in range(low, high):
        for n in range(len(key) * part // parts, len(key) * (part + 1) // parts):
            out[part, key[n]] += 1


@jit
def _offsets(size, at, start):  # type: ignore[no-untyped-def]
    total = 0
    for k in range(size.shape[1]):
        start[k] = total
        for part in range(len(size)):
            at[part, k] = total
            total += size[part, k]
    start[size.shape[1]] = total


@jit
def _deal(low, high, parts, key, at, out):  # type: ignore[no-untyped-def]
    for part in range(low, high):
        for n in range(len(key) * part // parts, len(key) * (part + 1) // parts):
            k = key[n]
            out[at[part, k]] = n
            at[part, k] += 1


def by_key(key: Ints, count: int) -> tuple[Ints, Ints]:
    """Rows in the order of their keys, of equal keys the first row first, and where each key starts.

    Args: key: (N,) from 0 to count - 1. Returns: (N,), (count + 1,).
    """
    parts = len(blocks(len(key), LEAST_ROWS))
    size, at = np.zeros((parts, count), np.int64), np.empty((parts, count), np.int64)
    start, row = np.empty(count + 1, np.int64), np.empty(len(key), np.int64)
    in_blocks(_count, parts, parts, key, size, least=1)
    _offsets(size, at, start)
    in_blocks(_deal, parts, parts, key, at, row, least=1)
    return row, start


@jit
def _copy_runs(low, high, order, begin, size, end, value, out):  # type: ignore[no-untyped-def]
    for r in range(low, high):
        run = order[r]
        out[end[r] - size[run] : end[r]] = value[begin[run] : begin[run] + size[run]]


def runs_by_key(key: Ints, size: Ints, value: Ints, count: int) -> tuple[Ints, Ints]:
    """Runs of values in the order of their keys, of equal keys the first first.

    Args: key: (R,) of each run, from 0 to count - 1; size: (R,); value: (V,) of all runs. Returns: (V,) keys, (V,) values.
    """
    order = by_key(key, count)[0]
    end, out = np.cumsum(size[order]), np.empty(len(value), np.int64)
    in_blocks(_copy_runs, len(key), order, np.cumsum(size) - size, size, end, value, out, least=1024)
    return np.repeat(key[order], size[order]), out


def chosen(row: Ints, start: Ints, groups: Ints) -> tuple[Ints, Ints]:
    """The rows of these groups, one after the other. Args: row: (L,); start: (K + 1,) of each group. Returns: rows, starts."""
    size = np.diff(start)
    end = np.zeros(len(groups) + 1, np.int64)
    np.cumsum(size[groups], out=end[1:])
    out = np.empty(end[-1], np.int64)
    _copy_runs(0, len(groups), groups, start[:-1], size, end[1:], row, out)
    return out, end


@jit
def _join(low, high, first, first_start, second, second_start, out):  # type: ignore[no-untyped-def]
    for k in range(low, high):
        at = first_start[k] + second_start[k]
        middle = first_start[k + 1] + second_start[k]
        out[at:middle] = first[first_start[k] : first_start[k + 1]]
        out[middle : first_start[k + 1] + second_start[k + 1]] = second[second_start[k] : second_start[k + 1]]


def joined(first: Ints, first_start: Ints, second: Ints, second_start: Ints) -> tuple[Ints, Ints]:
    """Groups that have the rows of two groupings, those of the first in front. Returns: (N + M,) rows, (K + 1,) starts."""
    out = np.empty(len(first) + len(second), np.int64)
    in_blocks(_join, len(first_start) - 1, first, first_start, second, second_start, out, least=256)
    return out, first_start + second_start
