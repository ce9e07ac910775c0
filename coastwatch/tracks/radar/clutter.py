"""The clutter map: the density of false plots of each radar by place, learnt from plots that belong to no moving track.

A tracker gives the plots of one radar at a time, and the probability of each that it is false: of no confirmed track that moved.
Call `false_plots_per_m2` before the association of a batch, `learn` after it.

A fixed echo (a quay, a moored boat) becomes clutter within some `prior_turns`. Then its plots begin no track.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Radars, Rows
from coastwatch.batches.struct import Struct, column
from coastwatch.stage import NotNegative, Positive, Settings

LEAST_PLOTS = 0.1  # false plots in a turn, of a cell with a standing echo
MOST_CELLS = 640  # along a side of the window of a radar: 6 MB
SIGMAS = 3.0  # of the noise that a displacement must exceed
PAUSE_TURNS = 3.0  # a radar that was silent for longer has not turned


class ClutterSettings(Settings):
    """How false plots are counted by place."""

    learnt: bool = False  # else `false_plots_per_m2` holds everywhere
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

    @classmethod
    def none(cls) -> ClutterMap:
        """A map of no radar."""
        no, row, zero = np.zeros(0), np.zeros(0, np.int64), np.zeros(0)
        return cls(no, row, row, no, no, zero, zero, np.zeros(0, np.int32))

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

    def window(self, radar: int) -> tuple[int, int, float]:
        """First cell, cells along a side, side of a cell of a radar, as the kernels take them."""
        return int(self.first[radar]), int(self.side[radar]), float(self.cell_m[radar])

    @property
    def cells(self) -> tuple[Floats, Floats, Rows]:
        """Columns of the cells, as the kernels take them."""
        return self.plots, self.turn, self.tile


def empty_map(settings: ClutterSettings, radars: Radars) -> ClutterMap:
    """The map of these radars before the first plot."""
    resolution_m = np.maximum(radars.azimuth_sigma_rad * radars.range_m, 2.0 * radars.range_sigma_m)
    wanted_m = resolution_m if settings.cell_m is None else np.full(len(radars), settings.cell_m)
    cell_m = np.maximum(wanted_m, 2.0 * radars.range_m / (MOST_CELLS - 1))
    side = np.ceil(2.0 * radars.range_m / cell_m).astype(np.int64) + 1
    end = np.cumsum(side**2)
    count = int(end[-1]) if len(end) else 0
    zero, nothing = np.zeros(count), np.full(count, -1, np.int32)
    heard = np.zeros(len(radars)), np.full(len(radars), np.nan)
    return ClutterMap(cell_m, side, end - side**2, *heard, zero, zero.copy(), nothing)


def false_plots_per_m2(
    settings: ClutterSettings, known: ClutterMap, radar: int, position_m: Floats, prior_per_m2: float
) -> Floats:
    """The density of false plots of a radar in one turn at each position: lambda, (M,).

    lambda(cell) = (prior_turns lambda_0 + false plots in the cell / its area) / (prior_turns + turns).
    Args: radar: its number in the map; position_m: (M, 2) in the plane of the region; prior_per_m2: lambda_0.
    """
    prior = float(prior_per_m2), settings.prior_turns
    turns = float(known.turns[radar])
    out: Floats = kernels.tracks.clutter.density(
        known.window(radar), known.cells, position_m, turns, prior, settings.memory_turns
    )
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
    passed = max((newest_s - before_s) / period_s, 0.0) if np.isfinite(before_s) else 1.0
    known.turns[radar] += passed if passed <= PAUSE_TURNS else 1.0
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
