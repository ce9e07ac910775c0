"""Bursts of clutter in a part of the range of a radar, as in a squall: seen in the plots of one look, nothing is remembered.

`rates.py` notices a burst by all plots of a radar, which a rain cell of a kilometre does not change by much.
"""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.tracks.radar.rates import BURST_FACTOR, BURST_SIGMAS

CELLS = 16  # squares along the range of a radar: the burst is sought in three by three of them
NEAR = 3  # cells along a side of that


def local_burst_per_m2(plots_m: Floats, weight: Floats, tracks_m: Floats, range_m: float, expected_per_m2: float) -> Floats:
    """The density of false plots in one look at each plot, where there are far more than expected; elsewhere 0. (M,)

    The density is that of the plot's cell, where the cells around it have a burst, or those around a cell that touches it. Plots
    beyond the range have none.
    Args: plots_m: (M, 2) from the radar, in one look; weight: (M,) how much each counts; tracks_m: (N, 2) from the radar, that exist;
    range_m: of the radar; expected_per_m2: false plots in one look.
    """
    out, cell_m = np.zeros(len(plots_m)), range_m / CELLS
    if len(plots_m) <= BURST_SIGMAS:
        return out
    at, inside = _cells(plots_m, cell_m)
    of_track, known = _cells(tracks_m, cell_m)
    free = np.maximum(_count(at[inside], weight[inside]) - _count(of_track[known], np.ones(np.count_nonzero(known))), 0.0)
    near, expected = _around(free), NEAR**2 * cell_m**2 * expected_per_m2
    burst = (near > BURST_FACTOR * expected) & (near > expected + BURST_SIGMAS * np.sqrt(expected + 1.0))
    if burst.any():
        density = np.where(_around(burst.astype(np.float64)) > 0.0, free / cell_m**2, 0.0)
        out[inside] = density[at[inside, 0], at[inside, 1]]
    return out


def _cells(place_m: Floats, cell_m: float) -> tuple[Ints, Bools]:
    """The cell of each place, and whether it is in the square about the range of the radar. (M, 2), (M,)"""
    at = np.floor(np.clip(place_m / cell_m, -CELLS - 1.0, CELLS + 1.0)).astype(np.int64) + CELLS
    inside = (at >= 0) & (at < 2 * CELLS)
    return at, inside[:, 0] & inside[:, 1]


def _count(cell: Ints, weight: Floats) -> Floats:
    """The sum of weights in each cell. (2 CELLS, 2 CELLS) Args: cell: (M, 2); weight: (M,)."""
    side = 2 * CELLS
    return np.asarray(np.bincount(cell[:, 0] * side + cell[:, 1], weight, side**2), np.float64).reshape(side, side)


def _around(count: Floats) -> Floats:
    """The sum over each cell of a grid and those that touch it."""
    padded = np.pad(count, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
