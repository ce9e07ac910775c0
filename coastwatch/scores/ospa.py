"""Optimal sub-pattern assignment, plain (OSPA) and generalised (GOSPA): one distance between a set of estimates and the true positions."""

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
    """The GOSPA distance with alpha = 2 between two sets of points. Pairs farther apart than the cutoff are never assigned.

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


class Ospa(NamedTuple):
    """The distance and its parts: total**p = localisation**p + cardinality**p."""

    total_m: float
    localisation_m: float
    cardinality_m: float


def ospa(assigned: Gospa, cutoff_m: float, order: float) -> Ospa:
    """The OSPA distance of two sets whose GOSPA is known; of two empty sets 0, of an empty and another set the cutoff.

    A pair inside the cutoff c saves c**p - d**p in OSPA as in GOSPA with alpha = 2, so both have the same best pairs.

    Args: assigned: the GOSPA of the sets with this cutoff_m, c, and order, p >= 1.
    Source: D. Schuhmacher, B.-T. Vo, B.-N. Vo, A Consistent Metric for Performance Evaluation of Multi-Object Filters, 2008, eq. 3.
    """
    smaller, larger = sorted((assigned.missed_count, assigned.false_count))  # unassigned points of the smaller and larger set
    most = assigned.assigned_count + larger
    if most == 0:
        return Ospa(0.0, 0.0, 0.0)
    near = (assigned.localisation + smaller * cutoff_m**order) / most
    missing = (larger - smaller) * cutoff_m**order / most
    return Ospa((near + missing) ** (1.0 / order), near ** (1.0 / order), missing ** (1.0 / order))


def ospa2(estimate_m: Floats, true_m: Floats, cutoff_m: float, order: float) -> float:
    """OSPA(2): the OSPA distance of two sets of tracks over a window, m.

    The distance of two tracks is the mean, over the instants at which one of them exists, of their distance up to the cut-off. It is
    the cut-off where only one exists. Args: estimate_m: (N, T, 2), true_m: (V, T, 2), NaN where a track does not exist.
    Source: M. Beard, B. T. Vo, B.-N. Vo, A Solution for Large-Scale Multi-Object Tracking, 2020, section V.
    """
    from scipy.optimize import linear_sum_assignment

    there = [np.isfinite(tracks[..., 0]) for tracks in (estimate_m, true_m)]
    estimate_m, true_m = (tracks[exists.any(axis=1)] for tracks, exists in zip((estimate_m, true_m), there, strict=True))
    one, other = (np.isfinite(tracks[..., 0]) for tracks in (estimate_m, true_m))
    n, v = len(estimate_m), len(true_m)
    if max(n, v) == 0:
        return 0.0
    either, in_both = one[:, None] | other, one[:, None] & other
    distance_m = np.full(in_both.shape, cutoff_m)
    distance_m[in_both] = np.minimum(np.hypot(*(estimate_m[:, None] - true_m)[in_both].T), cutoff_m)
    base = np.where(either, distance_m, 0.0).sum(axis=2) / either.sum(axis=2)
    row, column = linear_sum_assignment(base**order)
    total = (base[row, column] ** order).sum() + abs(n - v) * cutoff_m**order
    return float((total / max(n, v)) ** (1.0 / order))
