"""One-to-one assignment of a sparse list of pairs: connected components, each solved by scalar code compiled by numba.

A component of very many rows and columns is solved greedily, the greatest gain first: the best sum would cost their number cubed.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.arrays import Bools, Floats, Ints
from coastwatch.kernels.association.connected_components import components
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import counting_sort
from coastwatch.kernels.threads import in_blocks

LARGEST = 512
"""Rows and columns of the largest component that is solved exactly, or as much work: rows^2 columns, with no more rows than columns."""

MOST_GAIN = 1e12
"""Of a pair. Greater gains, also infinite ones, are all alike: sums of gains stay exact to 1e-4."""


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
def _is_star(row, column, pairs):  # type: ignore[no-untyped-def]
    """Whether all pairs have one row, or one column."""
    same_row = same_column = True
    for a in pairs:
        same_row &= row[a] == row[pairs[0]]
        same_column &= column[a] == column[pairs[0]]
    return same_row or same_column


@jit
def _best(gain, pairs):  # type: ignore[no-untyped-def]
    """The pair of the greatest gain, the first of equal ones."""
    best = pairs[0]
    for a in pairs:
        if gain[a] > gain[best]:
            best = a
    return best


@jit
def _take_greedily(row, column, gain, pairs, place, selected):  # type: ignore[no-untyped-def]
    """Select pairs, the greatest gain first, of equal ones the first. Args: as of `_solve_components`; place: 0 or more, -1 afterwards."""
    row_place, column_place = place
    best = np.argsort(-gain[pairs], kind="mergesort")
    for k in best:
        a = pairs[k]
        if row_place[row[a]] >= 0 and column_place[column[a]] >= 0:
            selected[a] = True
            row_place[row[a]] = column_place[column[a]] = -1


@jit
def _solve_components(low, high, component, row, column, gain, place, selected):  # type: ignore[no-untyped-def]
    """Select pairs of components low to high.

    Args: component: (start, pairs) of each; row, column, gain: (A,) of the pairs; place: of rows and of columns in their component,
    scratch, all -1; selected: (A,) written.
    """
    start, order = component
    row_place, column_place = place
    for k in range(low, high):
        pairs = order[start[k] : start[k + 1]]
        if _is_star(row, column, pairs):
            selected[_best(gain, pairs)] = True
            continue
        rows = columns = 0
        for a in pairs:
            if row_place[row[a]] < 0:
                row_place[row[a]] = rows
                rows += 1
            if column_place[column[a]] < 0:
                column_place[column[a]] = columns
                columns += 1
        least = min(rows, columns)
        if float(least) * least * max(rows, columns) > float(LARGEST) ** 3:
            _take_greedily(row, column, gain, pairs, place, selected)
            continue
        tall = rows > columns
        cost = np.zeros((least, max(rows, columns)))
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


@jit
def assign_rows(row, column, gain, rows, columns):  # type: ignore[no-untyped-def]
    """As `assign`, of pairs sorted by row and column, or the other way round, all with a positive gain, for other kernels.

    Args: row, column: (A,) labels from 0; rows, columns: how many there are.
    """
    selected = np.zeros(len(row), np.bool_)
    label = components(row, rows + column, rows + columns)[row]
    place = np.full(rows, -1), np.full(columns, -1)
    count = label.max() + 1 if len(row) else 0
    _solve_components(0, count, counting_sort(label, count), row, column, gain, place, selected)
    return selected


def assign(first: Ints, second: Ints, gain: Floats) -> Bools:
    """Which pairs to take so that their gains sum to the most, each `first` and each `second` in one pair at most.

    A pair without a positive gain is never taken. Pairs that join more than some `LARGEST` rows and columns are taken in order of
    their gains instead. A gain above `MOST_GAIN` counts as that. The answer does not depend on the order of the pairs; equal sums are
    decided by the labels alone.
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
    order = np.lexsort((column, row))
    row, column, gain = row[order], column[order], np.minimum(gain[useful[order]].astype(np.float64), MOST_GAIN)
    chosen = np.zeros(len(useful), np.bool_)
    label = components(row, len(firsts) + column, len(firsts) + len(seconds))[row]
    count = int(label.max(initial=-1)) + 1
    place = np.full(len(firsts), -1), np.full(len(seconds), -1)
    in_blocks(_solve_components, count, counting_sort(label, count), row, column, gain, place, chosen, least=256)
    selected[useful[order]] = chosen
    return selected
