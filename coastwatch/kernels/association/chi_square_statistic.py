"""The statistic of the paper: a difference against the sample covariance of its window, compiled by numba."""

import math

import numpy as np

from coastwatch.kernels.association.pair_differences import (
    BIAS,
    EAST,
    EAST_RATE,
    FACTOR,
    GOOD,
    LANE_ROWS,
    LANES,
    LONGEST,
    NORTH,
    NORTH_RATE,
    STEP_ROWS,
    differences,
    factorise,
    in_metres,
)
from coastwatch.kernels.jit import jit


@jit
def sample_statistics(first, second, table, chain, length, p):  # type: ignore[no-untyped-def]
    """x = Delta^T S^-1 Delta of the newest difference, S the sample covariance of the newest p differences (paper, eq. 7).

    Args: as `windowed_scores`; p: length of the window, at least 2. Returns: (A,) x, infinite where the common window is shorter than p or
    S is singular.
    """
    out, mean = np.full(len(first), math.inf), np.empty(4)
    lane, step = np.ones((LANE_ROWS, LANES)), np.zeros((LONGEST * STEP_ROWS, LANES))
    for q in range(len(first)):
        a, b = first[q], second[q]
        if min(length[a], length[b]) < p:
            continue
        differences(a, b, p, p, table, chain, 0, lane, step)
        in_metres(p, lane, step)
        for i in range(4):
            mean[i] = 0.0
            for t in range(p):
                mean[i] += step[t * STEP_ROWS + i, 0]
            mean[i] /= p
        at = FACTOR
        for i in range(4):
            for j in range(i + 1):
                s = 0.0
                for t in range(p):
                    s += (step[t * STEP_ROWS + i, 0] - mean[i]) * (step[t * STEP_ROWS + j, 0] - mean[j])
                lane[at, 0] = s / (p - 1)
                at += 1
        lane[GOOD, 0] = 1.0
        factorise(lane)
        if lane[GOOD, 0] > 0.0:
            newest = step[(p - 1) * STEP_ROWS : p * STEP_ROWS, 0]
            out[q] = _length2(lane[FACTOR:BIAS, 0], newest[EAST], newest[NORTH], newest[EAST_RATE], newest[NORTH_RATE])
    return out


@jit
def _length2(low, x, y, u, v):  # type: ignore[no-untyped-def]
    """The squared length of the solution of low @ white = (x, y, u, v)."""
    a = x / low[0]
    b = (y - low[1] * a) / low[2]
    c = (u - low[3] * a - low[4] * b) / low[5]
    d = (v - low[6] * a - low[7] * b - low[8] * c) / low[9]
    return a * a + b * b + c * c + d * d
