"""The statistic of the paper: a difference against the sample covariance of its window, compiled by numba."""

import math

import numpy as np

from coastwatch.kernels.compiling import arithmetic, arithmetic_part
from coastwatch.kernels.differences import (
    BIAS,
    EAST,
    EAST_RATE,
    FACTOR,
    GOOD,
    NORTH,
    NORTH_RATE,
    ROOM,
    differences,
    factorise,
    lanes,
    steps,
)


@arithmetic
def sample_statistics(first, second, table, chain, length, p):  # type: ignore[no-untyped-def]
    """x = Delta^T S^-1 Delta of the newest difference, S the sample covariance of the newest p differences (paper, eq. 7).

    Args: as `windowed_scores`; p: length of the window, at least 2. Returns: (A,) x, infinite where the common window is shorter than p or
    S is singular.
    """
    out, mean = np.full(len(first), math.inf), np.empty(4)
    buffer = np.ones(ROOM)
    room = buffer.ctypes.data
    w, lane = steps(room)[0], lanes(room)
    for q in range(len(first)):
        a, b = first[q], second[q]
        if min(length[a], length[b]) < p:
            continue
        differences(a, b, p, table, chain, 0, room)
        for i in range(4):
            mean[i] = 0.0
            for t in range(p):
                mean[i] += w[i, t]
            mean[i] /= p
        at = FACTOR
        for i in range(4):
            for j in range(i + 1):
                s = 0.0
                for t in range(p):
                    s += (w[i, t] - mean[i]) * (w[j, t] - mean[j])
                lane[at, 0] = s / (p - 1)
                at += 1
        lane[GOOD, 0] = 1.0
        factorise(room)
        if lane[GOOD, 0] > 0.0:
            out[q] = _length2(lane[FACTOR:BIAS, 0], w[EAST, p - 1], w[NORTH, p - 1], w[EAST_RATE, p - 1], w[NORTH_RATE, p - 1])
    buffer[0] = 0.0  # or it would be given back as soon as its address is known
    return out


@arithmetic_part
def _length2(low, x, y, u, v):  # type: ignore[no-untyped-def]
    """The squared length of the solution of low @ white = (x, y, u, v)."""
    a = x / low[0]
    b = (y - low[1] * a) / low[2]
    c = (u - low[3] * a - low[4] * b) / low[5]
    d = (v - low[6] * a - low[7] * b - low[8] * c) / low[9]
    return a * a + b * b + c * c + d * d
