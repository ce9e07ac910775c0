"""Optimal sub-pattern assignment: one distance between a set of estimates and a set of true positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats


class Ospa(NamedTuple):
    """The distance and its parts: total**p = localisation**p + cardinality**p."""

    total_m: float
    localisation_m: float
    cardinality_m: float


def ospa(estimate_m: Floats, true_m: Floats, cutoff_m: float, order: float) -> Ospa:
    """The distance between two sets of points; nothing against nothing is 0, against something the cutoff.

    Args: estimate_m: (N, d); true_m: (V, d); cutoff_m: c; order: p >= 1.
    Source: D. Schuhmacher, B.-T. Vo, B.-N. Vo, A Consistent Metric for Performance Evaluation of Multi-Object Filters, 2008, eq. 3.
    """
    from scipy.optimize import linear_sum_assignment

    most = max(len(estimate_m), len(true_m))
    if most == 0:
        return Ospa(0.0, 0.0, 0.0)
    apart = np.linalg.norm(estimate_m[:, None, :] - true_m[None, :, :], axis=2)
    cost = np.minimum(apart, cutoff_m) ** order
    near = float(cost[linear_sum_assignment(cost)].sum()) / most
    missing = cutoff_m**order * abs(len(estimate_m) - len(true_m)) / most
    return Ospa((near + missing) ** (1.0 / order), near ** (1.0 / order), missing ** (1.0 / order))
