"""The clutter map: the density of false plots of each radar by place, learnt from plots that belong to no moving track.

A tracker gives the plots of one radar at a time, and the probability of each that it is false: of no confirmed track that moved.
Call `false_plots_per_m2` before the association of a batch, `learn` after it.

A fixed echo (a quay, a moored boat) becomes clutter within some `prior_turns`. Then its plots begin no track. Cells are squares of the
region's plane, because quays and moored boats stand there. A map has at most 640 of them along a side: 8 MB.
Where the map is learnt, the gain of a track that is not confirmed has no term for a miss: if the track is false, nothing was missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Radars, Rows, StandingEchoes
from coastwatch.batches.struct import Struct, column
from coastwatch.geodesy import from_plane
from coastwatch.kernels.tracks.clutter import TILES
from coastwatch.stage import NotNegative, Positive, Settings
from coastwatch.tracks.radar.rates import turns_between

LEAST_PLOTS = 0.1  # false plots in a turn, of a cell with a standing echo
MOST_CELLS = 640  # along a side of the window of a radar
SIGMAS = 3.0  # of the noise that a displacement must exceed
TIMES_THE_MEAN = 5.0  # the plots of a cell with a standing echo, over those of all cells in range
NEIGHBOURS = np.ones((3, 3), np.int64)  # cells that touch, also at a corner, are one echo


class ClutterSettings(Settings):
    """How false plots are counted by place."""

    learnt: bool | Literal["by_radar"] = (
        "by_radar"  # which radars have a map: all, none, or those whose plots of no track return
    )
    cell_m: Positive | None = None  # side of a cell; none: one standard deviation of azimuth at full range, or two of range
    prior_turns: Positive = 10.0  # that `false_plots_per_m2` is worth
    memory_turns: Positive = 2000.0  # after which a plot counts 1 / e
    moved_m: NotNegative = 25.0  # plots of a track that has moved less may be clutter


@dataclass(frozen=True, eq=False)
class ClutterMap(Struct):
    """The windows of R radars, one after the other: C cells. `cell_m` is 0 of a radar without a map."""

    cell_m: Floats = column(np.float64, "R")  # side of a cell
    side: Ints = column(np.int64, "R")  # cells along a side of the window
    first: Ints = column(np.int64, "R")  # number of its first cell
    turns: Floats = column(np.float64, "R")  # so far
    newest_s: Floats = column(np.float64, "R")  # newest plot, NaN before the first
    plots: Floats = column(np.float64, "C")  # false plots in the cell, as of `turn`
    turn: Floats = column(np.float64, "C")  # of its newest plot
    tile: Rows = column(np.int32, "C")  # which of the cells of this slot it is; -1: none so far

    def check_rows(self) -> None:
        """Check the windows, as after reading a checkpoint. Raises: ValueError."""
        if not np.array_equal(self.first + self.side**2, np.append(self.first, len(self.plots))[1:]):
            raise ValueError(f"ClutterMap.first: got {self.first.tolist()}, needed windows that fill {len(self.plots)} cells")

    def without_radars(self, moved: Bools) -> ClutterMap:
        """This map without the plots of these radars (R,). It consumes the map."""
        for radar in np.flatnonzero(moved).tolist() if len(self.side) else []:
            first, side, _ = self.window(radar)
            self.tile[first : first + side * side] = -1
            self.turns[radar], self.newest_s[radar] = 0.0, np.nan
        return self

    def has(self, radar: int) -> bool:
        """Whether this radar has a map."""
        return len(self.side) > 0 and self.side[radar] > 0

    def with_radar(self, settings: ClutterSettings, radars: Radars, radar: int) -> ClutterMap:
        """This map with an empty one of this radar, which has none yet."""
        had = np.flatnonzero(self.side > 0)
        made = empty_map(settings, radars, np.isin(np.arange(len(radars)), [*had.tolist(), radar]))
        made.turns[had], made.newest_s[had] = self.turns[had], self.newest_s[had]
        for k in had.tolist():
            new, old = (slice(one.first[k], one.first[k] + one.side[k] ** 2) for one in (made, self))
            made.plots[new], made.turn[new], made.tile[new] = self.plots[old], self.turn[old], self.tile[old]
        return made

    def window(self, radar: int) -> tuple[int, int, float]:
        """First cell, cells along a side, side of a cell of a radar, as the kernels take them."""
        return int(self.first[radar]), int(self.side[radar]), float(self.cell_m[radar])

    @property
    def cells(self) -> tuple[Floats, Floats, Rows]:
        """Columns of the cells, as the kernels take them."""
        return self.plots, self.turn, self.tile


def cell_sides(settings: ClutterSettings, radars: Radars) -> Floats:
    """The side of a cell of each radar, m. (R,)"""
    resolution_m = np.maximum(radars.azimuth_sigma_rad * radars.range_m, 2.0 * radars.range_sigma_m)
    wanted_m = resolution_m if settings.cell_m is None else np.full(len(radars), settings.cell_m)
    return np.maximum(wanted_m, 2.0 * radars.range_m / (MOST_CELLS - 1))


def empty_map(settings: ClutterSettings, radars: Radars, having: Bools) -> ClutterMap:
    """The map of these radars before the first plot. Args: having: (R,) which radars have one."""
    cell_m = np.where(having, cell_sides(settings, radars), 0.0)
    side = np.ceil(2.0 * radars.range_m / np.where(having, cell_m, np.inf)).astype(np.int64) + having
    end = np.cumsum(side**2)
    count = int(end[-1]) if len(end) else 0
    zero, nothing = np.zeros(count), np.full(count, -1, np.int32)
    turns, newest_s = np.zeros(len(radars)), np.full(len(radars), np.nan)
    return ClutterMap(cell_m, side, end - side**2, turns, newest_s, zero, zero.copy(), nothing)


def false_plots_per_m2(
    settings: ClutterSettings, known: ClutterMap, radar: int, position_m: Floats, prior_per_m2: float
) -> Floats:
    """The density of false plots of a radar in one turn at each position: lambda, (M,).

    lambda(cell) = (prior_turns lambda_0 + false plots in the cell / its area) / (prior_turns + turns).
    Args: radar: its number in the map; position_m: (M, 2) in the plane of the region; prior_per_m2: lambda_0.
    """
    prior = float(prior_per_m2), settings.prior_turns
    turns, density = float(known.turns[radar]), kernels.tracks.clutter.density
    out: Floats = density(known.window(radar), known.cells, position_m, turns, prior, settings.memory_turns)
    return out


def learn(
    settings: ClutterSettings,
    known: ClutterMap,
    radar: int,
    time_s: Floats,
    position_m: Floats,
    probability: Floats,
    period_s: float,
) -> ClutterMap:
    """The map after some plots of one radar. It consumes the map. A radar that sends nothing has not turned.

    Args: time_s: (M,); position_m: (M, 2); probability: (M,) that the plot belongs to no confirmed track that has moved;
    period_s: of one turn.
    """
    if not len(time_s):
        return known
    newest_s, before_s = float(time_s.max()), float(known.newest_s[radar])
    known.turns[radar] += turns_between(before_s, newest_s, period_s)
    known.newest_s[radar] = np.fmax(newest_s, before_s)
    turns = float(known.turns[radar])
    kernels.tracks.clutter.learn(known.window(radar), known.cells, position_m, probability, turns, settings.memory_turns)
    return known


def has_moved(settings: ClutterSettings, from_m: Floats, to_m: Floats, variance_m2: Floats) -> Bools:
    """Whether tracks have moved: by `moved_m`, and by more than their noise explains. (N,)

    Args: from_m, to_m: (N, 2) the first position of each and one of now; variance_m2: (N,) of their difference, both axes together.
    """
    apart2 = ((to_m - from_m) ** 2).sum(axis=1)
    return np.asarray(apart2 > np.maximum(settings.moved_m**2, SIGMAS**2 * variance_m2))


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
    tile = np.stack(np.divmod(known.tile[window][slot].astype(np.int64), TILES), 1)  # east and north
    cell = np.stack(np.divmod(slot, side), 1) + side * np.where(tile >= TILES // 2, tile - TILES, tile)
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
