"""Rows of ids among other ids, by bisection: how rows of one cycle find theirs of the last. No numba."""

import numpy as np

from coastwatch.kernels.arrays import Ints


def find(sorted_ids: Ints, ids: Ints) -> Ints:
    """Where each id stands among sorted ids; -1 where it does not. Args: (N,), (M,). Returns: (M,)."""
    if len(sorted_ids) == 0:
        return np.full(len(ids), -1, np.int64)
    at = np.minimum(np.searchsorted(sorted_ids, ids), len(sorted_ids) - 1)
    return np.where(sorted_ids[at] == ids, at, -1).astype(np.int64)


def row_of(ids: Ints, wanted: Ints) -> Ints:
    """The row of each wanted id among ids in any order, the first of equal ones; -1 for none. Args: (N,), (M,). Returns: (M,)."""
    order = np.argsort(ids, kind="stable")
    return np.append(order, -1)[find(ids[order], wanted)]
