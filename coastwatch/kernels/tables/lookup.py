"""Where ids stand among others: how rows of one cycle find theirs of the last."""

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def find(sorted_ids: Ints, ids: Ints) -> Ints:
    """Where each id stands among sorted ids; -1 where it does not. Args: (N,), (M,). Returns: (M,)."""
    if len(sorted_ids) == 0:
        return np.full(len(ids), -1, np.int64)
    at = np.minimum(np.searchsorted(sorted_ids, ids), len(sorted_ids) - 1)
    return np.where(sorted_ids[at] == ids, at, -1).astype(np.int64)
