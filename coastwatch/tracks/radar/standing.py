"""The standing echoes of a clutter map, which begin no track: quays, piles and moored boats, each radar its own."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints, Radars, Rows, StandingEchoes
from coastwatch.geodesy import from_plane
from coastwatch.kernels.tracks.clutter import TILES
from coastwatch.tracks.radar.clutter import LEAST_PLOTS, ClutterMap, ClutterSettings

TIMES_THE_MEAN = 5.0  # the plots of a cell with a standing echo, over those of all cells in range
NEIGHBOURS = np.ones((3, 3), np.int64)  # cells that touch, also at a corner, are one echo


def standing_echoes(settings: ClutterSettings, known: ClutterMap, radars: Radars, origin_deg: Floats) -> StandingEchoes:
    """The echoes that have stood for `prior_turns` or more, by radar; none where no map is learnt.

    Args: known: of these radars; origin_deg: (2,) of the plane of their region.
    """
    if not len(known.side):
        return StandingEchoes.empty()
    enough = np.flatnonzero(known.turns >= settings.prior_turns).tolist()
    found = [_of_radar(settings, known, radar, float(radars.range_m[radar]), origin_deg) for radar in enough]
    return StandingEchoes.join(found)


def _of_radar(settings: ClutterSettings, known: ClutterMap, radar: int, range_m: float, origin_deg: Floats) -> StandingEchoes:
    """The standing echoes of one radar: groups of cells in which plots return."""
    from scipy.ndimage import label, sum_labels  # scipy takes memory of every process, and few runs learn a map

    first, side, cell_m = known.window(radar)
    window, turns, memory = slice(first, first + side * side), float(known.turns[radar]), settings.memory_turns
    weight = -memory * np.expm1(-turns / memory)
    plots = (
        np.where(known.tile[window] >= 0, known.plots[window] * np.exp(-(turns - known.turn[window]) / memory), 0.0) / weight
    )
    mean = plots.sum() * cell_m**2 / (np.pi * range_m**2)
    slot = np.flatnonzero(plots >= max(LEAST_PLOTS, TIMES_THE_MEAN * mean))
    if not len(slot):
        return StandingEchoes.empty()
    cell = np.stack(np.divmod(slot, side), 1) + side * _tiles(known.tile[window][slot])
    corner = cell.min(axis=0)
    grid = np.zeros(cell.max(axis=0) - corner + 1)
    at = tuple((cell - corner).T)
    grid[at] = plots[slot]
    group, count = label(grid > 0.0, NEIGHBOURS)
    of, numbers = group[at] - 1, np.arange(1, count + 1)
    per_turn = np.asarray(sum_labels(grid, group, numbers), np.float64)
    centre = np.stack([np.bincount(of, plots[slot] * axis, count) / per_turn for axis in cell.T], 1) + 0.5
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, of, cell)
    np.maximum.at(high, of, cell)
    position_deg = from_plane(cell_m * centre, np.broadcast_to(origin_deg, (count, 2)))
    extent_m = cell_m * (np.hypot(*(high - low).T) + 1.0)
    return StandingEchoes(np.full(count, radar), position_deg, extent_m, per_turn, np.full(count, turns))


def _tiles(tile: Rows) -> Ints:
    """The tile of each cell east and north, from its number. (C, 2)"""
    both = np.stack(np.divmod(tile.astype(np.int64), TILES), 1)
    return np.where(both >= TILES // 2, both - TILES, both)
