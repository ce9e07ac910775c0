"""The tracks of each vessel in rounds: the first track of every vessel, then the second of those that have one, ..."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Ints


def rounds(vessel: Ints, preference: Ints) -> list[tuple[Ints, Ints]]:
    """For each round the vessels that take part and the row of their track.

    Args: vessel: (N,) of each track, 0..V-1 with none left out; preference: (N,) smaller comes first.
    Returns: list of (vessels (G,), rows (G,)); the first round has every vessel in order.
    """
    order = np.lexsort((preference, vessel))
    sorted_vessel = vessel[order]
    start = np.flatnonzero(np.r_[True, sorted_vessel[1:] != sorted_vessel[:-1]]) if len(vessel) else np.zeros(0, np.int64)
    rank = np.arange(len(vessel)) - np.repeat(start, np.diff(np.r_[start, len(vessel)]))
    return [(sorted_vessel[rank == r], order[rank == r]) for r in range(int(rank.max(initial=-1)) + 1)]
