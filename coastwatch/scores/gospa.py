"""Generalised optimal sub-pattern assignment (GOSPA) with alpha = 2: localisation error, missed and false targets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats, Ints


class Gospa(NamedTuple):
    """The distance, and its parts before the root: total_m**p = localisation + missed_count c**p / 2 + false_count c**p / 2."""

    total_m: float
    localisation: float  # sum of the p-th powers of the distances of assigned pairs
    assigned_count: int
    missed_count: int
    false_count: int


def gospa(estimate_m: Floats, true_m: Floats, cutoff_m: float, order: float) -> Gospa:
    """The distance between two sets of points. Pairs farther apart than the cutoff are never assigned.

    With alpha = 2 a pair saves c**p - distance**p. Groups of points that are out of each other's reach are assigned separately,
    so thousands of points cost little.

    Args: estimate_m: (N, d); true_m: (V, d); cutoff_m: c; order: p >= 1.
    Source: A. S. Rahmathullah, A. F. Garcia-Fernandez, L. Svensson, Generalized Optimal Sub-Pattern Assignment Metric, 2017,
    proposition 1.
    """
    first, second, distance_m = _near(estimate_m, true_m, cutoff_m)
    costs = _assigned(first, second, distance_m**order, len(estimate_m), len(true_m), cutoff_m**order)
    missed, false = len(true_m) - len(costs), len(estimate_m) - len(costs)
    localisation = float(costs.sum())
    total = localisation + 0.5 * cutoff_m**order * (missed + false)
    return Gospa(total ** (1.0 / order), localisation, len(costs), missed, false)


def _near(estimate_m: Floats, true_m: Floats, cutoff_m: float) -> tuple[Ints, Ints, Floats]:
    """Pairs nearer than the cutoff, and their distances."""
    from scipy.spatial import KDTree

    none = np.zeros(0, np.int64)
    if not len(estimate_m) or not len(true_m):
        return none, none, np.zeros(0)
    distances = KDTree(estimate_m).sparse_distance_matrix(KDTree(true_m), cutoff_m, output_type="ndarray")
    near = distances["v"] < cutoff_m
    return distances["i"][near].astype(np.int64), distances["j"][near].astype(np.int64), distances["v"][near]


def _assigned(first: Ints, second: Ints, cost: Floats, n: int, v: int, most: float) -> Floats:
    """Costs of the pairs of the assignment that saves most against `most` a pair."""
    from scipy.optimize import linear_sum_assignment
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(first)), (first, n + second)), shape=(n + v, n + v))
    _, label = connected_components(graph, directed=False)
    group = label[first]
    order = np.argsort(group, kind="stable")
    first, second, cost, group = first[order], second[order], cost[order], group[order]
    size = np.bincount(group, minlength=1)
    alone = size[group] == 1 if len(group) else np.zeros(0, np.bool_)
    costs = [cost[alone]]
    for label_of_many in np.unique(group[~alone]):
        lo, hi = np.searchsorted(group, [label_of_many, label_of_many + 1])
        rows, row = np.unique(first[lo:hi], return_inverse=True)
        columns, at = np.unique(second[lo:hi], return_inverse=True)
        saved = np.zeros((len(rows), len(columns)))
        saved[row, at] = most - cost[lo:hi]
        chosen = saved[linear_sum_assignment(saved, maximize=True)]
        costs.append(most - chosen[chosen > 0.0])
    return np.concatenate(costs)
