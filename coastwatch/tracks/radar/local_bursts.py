"""Bursts of clutter in a part of the range of a radar, as in a squall: seen in the plots of one look, nothing is remembered.

`rates.py` notices a burst by all plots of a radar, which a rain cell of a kilometre does not change by much.
"""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.tracks.radar.rates import BURST_FACTOR, BURST_SIGMAS

CELLS = 16  # squares along the range of a radar: the burst is sought in three by three of them
NEAR = 3  # cells along a side of that


def local_burst_per_m2(plots_m: Floats, weight: Floats, tracks_m: Floats, range_m: float, expected_per_m2: float) -> Floats:
    """The density of false plots in one look at each plot, where there are far more than expected; elsewhere 0. (M,)

    The density is that of the plot's cell, where the cells around it, or around one that touches it, have a burst.
    Args: plots_m: (M, 2) of one radar in one look; weight: (M,) how much each counts; tracks_m: (N, 2) tracks that exist; range_m: of
    the radar; expected_per_m2: false plots in one look.
    """
    out, cell_m = np.zeros(len(plots_m)), range_m / CELLS
    if len(plots_m) <= BURST_SIGMAS:
        return out
    corner = np.floor(plots_m.min(axis=0) / cell_m).astype(np.int64) - 1
    shape = np.floor(plots_m.max(axis=0) / cell_m).astype(np.int64) - corner + 2
    at = np.floor(plots_m / cell_m).astype(np.int64) - corner
    of_track = np.floor(tracks_m / cell_m).astype(np.int64) - corner
    of_track = of_track[((of_track >= 0) & (of_track < shape)).all(axis=1)]
    free = np.maximum(_count(at, weight, shape) - _count(of_track, np.ones(len(of_track)), shape), 0.0)
    near, expected = _around(free), NEAR**2 * cell_m**2 * expected_per_m2
    burst = (near > BURST_FACTOR * expected) & (near > expected + BURST_SIGMAS * np.sqrt(expected + 1.0))
    if burst.any():
        density = np.where(_around(burst.astype(np.float64)) > 0.0, free / cell_m**2, 0.0)
        out = density[at[:, 0], at[:, 1]]
    return out


def _count(cell: Ints, weight: Floats, shape: Ints) -> Floats:
    """The sum of weights in each cell of a grid. Args: cell: (M, 2); weight: (M,); shape: (2,)."""
    sums = np.bincount(cell[:, 0] * shape[1] + cell[:, 1], weight, int(shape.prod()))
    return np.asarray(sums, np.float64).reshape(shape)


def _around(count: Floats) -> Floats:
    """The sum over each cell of a grid and those that touch it."""
    padded = np.pad(count, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
