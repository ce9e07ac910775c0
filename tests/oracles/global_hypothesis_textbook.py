"""The global hypothesis as the integer linear program that it is, solved by HiGHS.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU 2017, equations (4.21) to (4.23).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def by_milp(start: Ints, cost: Floats, resource: Ints, resources: int, null: Floats) -> float:
    """The least cost of one leaf (or null) a tree with each resource in one leaf at most; infinite if there is no such choice.

    Args: start: (T + 1,) first leaf of each tree; cost: (L,); resource: (L, m), -1: none; null: (T,) infinite: not allowed.
    """
    trees = len(start) - 1
    leaves = len(cost) + trees
    of = np.concatenate([np.repeat(np.arange(trees), np.diff(start)), np.arange(trees)])
    one_each = (of == np.arange(trees)[:, None]).astype(float)
    used = np.zeros((resources, leaves))
    row, column = np.nonzero(resource >= 0)
    used[resource[row, column], row] = 1.0
    costs = np.concatenate([cost, null])
    allowed = np.isfinite(costs)
    rules = [LinearConstraint(one_each, 1, 1)] + ([LinearConstraint(used, -np.inf, 1)] if resources else [])
    out = milp(
        np.where(allowed, costs, 0.0), constraints=rules, integrality=np.ones(leaves), bounds=Bounds(0, allowed.astype(float))
    )
    return float(out.fun) if out.success else np.inf
