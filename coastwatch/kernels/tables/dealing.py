"""Pieces of work dealt to parts: the costliest first, each to the part with the least so far. Compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@jit
def _deal(order, cost, load, part):  # type: ignore[no-untyped-def]
    for piece in order:
        least = 0
        for p in range(1, len(load)):
            if load[p] < load[least]:
                least = p
        part[piece] = least
        load[least] += cost[piece]


def deal(cost: Floats, parts: int) -> Ints:
    """The part that each piece is dealt to, from 0 to parts - 1. Args: cost: (K,), not negative. Returns: (K,).

    No part has more than its share and one piece. Source: R. L. Graham, Bounds on multiprocessing timing anomalies, 1969 (LPT).
    """
    part = np.empty(len(cost), np.int64)
    _deal(np.argsort(-cost, kind="stable"), cost, np.zeros(parts), part)
    return part
