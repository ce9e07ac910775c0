"""Density of false plots by cell, learnt from plots that belong to no moving track. Scalar code, compiled by numba.

Cells are squares of a fixed plane. A radar keeps a window of `side` x `side` of them: cell (i, j) stands in slot (i mod side, j mod side).
A radar that moves takes over the slots of cells that it has left behind; `tile` says to which cell a slot belongs.
"""

import math

import numpy as np

from coastwatch.kernels.jit import jit

TILES = 1 << 15  # tile numbers of an axis, before they repeat


@jit
def _slot_and_tile(east, north, cell, side):  # type: ignore[no-untyped-def]
    """The slot of a position in the window of its radar, and the tile: which of the cells that share this slot it is."""
    i, j = math.floor(east / cell), math.floor(north / cell)
    tile_i, tile_j = math.floor(i / side), math.floor(j / side)
    slot = int((i - tile_i * side) * side + (j - tile_j * side))
    return slot, int((tile_i % TILES) * TILES + tile_j % TILES)


@jit
def density(window, cells, position, turns, prior, memory):  # type: ignore[no-untyped-def]
    """False plots in a square metre and turn at each position. (M,)

    Args: window: (first slot, side, side of a cell in m) of the radar; cells: (plots (C,), turn (C,), tile (C,)); position: (M, 2);
    turns: of the radar so far; prior: (density, turns that it is worth); memory: turns after which a plot counts 1 / e.
    """
    first, side, cell = window
    plots, turn, tile = cells
    out = np.empty(len(position))
    seen = -memory * math.expm1(-turns / memory)
    for m in range(len(position)):
        slot, own = _slot_and_tile(position[m, 0], position[m, 1], cell, side)
        count = 0.0
        if tile[first + slot] == own:
            count = plots[first + slot] * math.exp(-(turns - turn[first + slot]) / memory)
        out[m] = (prior[0] * prior[1] + count / (cell * cell)) / (prior[1] + seen)
    return out


@jit
def learn(window, cells, position, probability, turns, memory):  # type: ignore[no-untyped-def]
    """Count each plot with the probability that it is false, in its cell. In place.

    Args: as `density`; probability: (M,); turns: of the radar, the turn of these plots included.
    """
    first, side, cell = window
    plots, turn, tile = cells
    for m in range(len(position)):
        slot, own = _slot_and_tile(position[m, 0], position[m, 1], cell, side)
        k = first + slot
        before = plots[k] * math.exp(-(turns - turn[k]) / memory) if tile[k] == own else 0.0
        plots[k], turn[k], tile[k] = before + probability[m], turns, own
