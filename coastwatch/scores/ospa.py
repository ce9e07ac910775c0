"""Optimal sub-pattern assignment: one distance between a set of estimates and a set of true positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats
from coastwatch.scores.gospa import Gospa


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
