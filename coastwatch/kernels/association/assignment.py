"""One-to-one assignment of a sparse list of pairs: connected components, each solved by scalar code compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.association.connected_components import root
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.groups import by_both
from coastwatch.kernels.threads import in_blocks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@jit
def _solve(cost, match):  # type: ignore[no-untyped-def]
    """Row of each column in the cheapest assignment of all rows, -1 for none, into `match`; no more rows than columns.

    Shortest augmenting paths with potentials; among equal paths the lowest column wins, so the answer is a function of the matrix.
    """
    rows, columns = cost.shape
    u, v = np.zeros(rows), np.zeros(columns)
    way = np.zeros(columns, np.int64)
    shortest, done = np.zeros(columns), np.zeros(columns, np.bool_)
    match[:] = -1
    for start in range(rows):
        shortest[:] = np.inf
        done[:] = False
        row, column, reached = start, -1, 0.0
        while True:
            nearest, least = -1, np.inf
            for c in range(columns):
                if done[c]:
                    continue
                length = reached + cost[row, c] - u[row] - v[c]
                if length < shortest[c]:
                    shortest[c] = length
                    way[c] = column
                if shortest[c] < least:
                    nearest, least = c, shortest[c]
            column, reached = nearest, least
            done[column] = True
            if match[column] < 0:
                break
            row = match[column]
        u[start] += reached
        for c in range(columns):
            if done[c] and c != column:
                u[match[c]] += reached - shortest[c]
                v[c] -= reached - shortest[c]
        while way[column] >= 0:
            match[column] = match[way[column]]
            column = way[column]
        match[column] = start


@jit
def _components(row, column, rows, columns):  # type: ignore[no-untyped-def]
    """Pairs by connected component, in it as they come; components by their first pair. Returns: (A,) order; (C + 1,) starts.

    Args: row: (A,) 0 to rows - 1; column: (A,) 0 to columns - 1.
    """
    parent = np.arange(rows + columns).astype(np.int32)
    for a in range(len(row)):
        i, j = root(parent, row[a]), root(parent, rows + column[a])
        parent[max(i, j)] = min(i, j)
    number, label = np.full(rows, -1, np.int32), np.empty(len(row), np.int32)
    count = 0
    for a in range(len(row)):
        i = root(parent, row[a])  # the lowest of the component, hence a row
        if number[i] < 0:
            number[i] = count
            count += 1
        label[a] = number[i]
    start = np.zeros(count + 1, np.int64)
    for a in range(len(label)):
        start[label[a] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    order, place = np.empty(len(label), np.int64), start[:-1].copy()
    for a in range(len(label)):
        order[place[label[a]]] = a
        place[label[a]] += 1
    return order, start


@jit
def _solve_components(low, high, start, order, row, column, gain, row_place, column_place, selected):  # type: ignore[no-untyped-def]
    """Select pairs of components low to high; places are scratch, all -1."""
    for k in range(low, high):
        pairs = order[start[k] : start[k + 1]]
        if len(pairs) == 1:
            selected[pairs[0]] = True
            continue
        rows = columns = 0
        for a in pairs:
            if row_place[row[a]] < 0:
                row_place[row[a]] = rows
                rows += 1
            if column_place[column[a]] < 0:
                column_place[column[a]] = columns
                columns += 1
        tall = rows > columns
        cost = np.zeros((min(rows, columns), max(rows, columns)))
        for a in pairs:
            i, j = row_place[row[a]], column_place[column[a]]
            if tall:
                i, j = j, i
            cost[i, j] = -gain[a]
        match = np.empty(cost.shape[1], np.int64)
        _solve(cost, match)
        for a in pairs:
            i, j = row_place[row[a]], column_place[column[a]]
            if tall:
                i, j = j, i
            selected[a] = match[j] == i


def assign_numbered(row: Ints, column: Ints, gain: Floats, rows: int, columns: int) -> Bools:
    """As `assign`, for pairs that are useful and sorted by row, then column, sides that are numbered from 0 on.

    Args: row: (A,) 0 to rows - 1; column: (A,) 0 to columns - 1; gain: (A,) positive. Returns: (A,).
    """
    selected = np.zeros(len(row), np.bool_)
    order, start = _components(row, column, rows, columns)
    places = np.full(rows, -1, np.int64), np.full(columns, -1, np.int64)
    in_blocks(_solve_components, len(start) - 1, start, order, row, column, gain, *places, selected, least=256)
    return selected


def assign(first: Ints, second: Ints, gain: Floats) -> Bools:
    """Which pairs to take so that their gains sum to the most, each `first` and each `second` in one pair at most.

    A pair without a positive gain is never taken. The answer does not depend on the order of the pairs; equal sums are decided by
    the labels alone.
    Args: first, second: (A,) labels of the two sides, any integers, no pair twice; gain: (A,), NaN is no gain.
    Returns: (A,).
    Source: R. Jonker, A. Volgenant, A shortest augmenting path algorithm for dense and sparse linear assignment problems,
        Computing 38, 1987; per connected component, because the sum separates.
    """
    selected = np.zeros(len(first), np.bool_)
    useful = np.flatnonzero(gain > 0.0)
    if len(useful) == 0:
        return selected
    firsts, row = np.unique(first[useful], return_inverse=True)
    seconds, column = np.unique(second[useful], return_inverse=True)
    order = by_both(row, len(firsts), column, len(seconds))
    sorted_pairs = row[order], column[order], gain[useful][order].astype(np.float64)
    selected[useful[order]] = assign_numbered(*sorted_pairs, len(firsts), len(seconds))
    return selected
