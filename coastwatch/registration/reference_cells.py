"""Acquisition, first part: what each reference cell has seen. A reference cell is an AIS vessel in one polar cell of the radar.

A vessel that moves has a new reference cell in every polar cell: new geometry is new evidence, and standing still is not. Each keeps
a histogram of the differences between plots and its vessel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from coastwatch.batches import Batch, Bools, Floats, Ints, Rows, Struct, column
from coastwatch.batches.struct import part
from coastwatch.kernels.tables.lookup import find, row_of
from coastwatch.registration.polar import Pairs

AROUND = np.radians(12.0)  # the background of a bin is taken from so far to each side: beyond, land and lanes change it
RANGE_STEP_M = 25.0  # width of a bin in range
SECTOR, RING_M = np.radians(5.0), 300.0  # size of a polar cell
RINGS = 4096
NEAREST_M = 200.0  # nearer vessels are not used: their bearing changes too fast
AT_REST_M_S = 0.7
SQUARE_M = 1000.0  # vessels at rest in one square are one group: a moored row beside a row of piles is one pattern, not ten
MOST_REFERENCE_CELLS = 4000  # of a radar
LEAST_LOOKS = 0.5  # a reference cell with less left of them is dropped


@dataclass(frozen=True)
class Grid:
    """Bins of azimuth and range difference; the middle one is 0. The outer ones in azimuth serve as background only."""

    search_rad: float
    search_m: float
    step_rad: float

    @property
    def azimuth_rad(self) -> Floats:
        """Middle of each bin. (A,)"""
        n = int(np.ceil((self.search_rad + AROUND) / self.step_rad))
        return np.asarray(np.arange(-n, n + 1) * self.step_rad, np.float64)

    @property
    def range_m(self) -> Floats:
        """Middle of each bin. (D,)"""
        n = int(np.ceil(self.search_m / RANGE_STEP_M))
        return np.asarray(np.arange(-n, n + 1) * RANGE_STEP_M, np.float64)

    @property
    def shape(self) -> tuple[int, int]:
        """Bins in range and in azimuth."""
        return len(self.range_m), len(self.azimuth_rad)

    def holds(self, range_m: Floats, azimuth_rad: Floats) -> Bools:
        """Which differences are inside the grid."""
        held: Bools = (np.abs(range_m) <= self.search_m) & (np.abs(azimuth_rad) <= self.search_rad + AROUND)
        return held

    def bin_of(self, range_m: Floats, azimuth_rad: Floats) -> Ints:
        """Number of the bin of each difference inside the grid."""
        at = np.rint(range_m / RANGE_STEP_M), np.rint(azimuth_rad / self.step_rad)
        rows, columns = self.shape
        number: Ints = (at[0] + rows // 2).astype(np.int64) * columns + (at[1] + columns // 2).astype(np.int64)
        return number


@dataclass(frozen=True, eq=False)
class Hits(Batch):
    """Plots near reference cells that are not counted yet."""

    reference_cell: Ints = column(np.int64, "H")
    bin: Ints = column(np.int64, "H")
    turn: Ints = column(np.int64, "H")  # of the antenna


@dataclass(frozen=True, eq=False)
class Counts(Batch):
    """The bins of histograms that are not 0, sorted by reference cell, then bin. One bin in forty is."""

    reference_cell: Rows = column(np.int32, "E")
    bin: Rows = column(np.int32, "E")
    turns: NDArray[np.float32] = column(np.float32, "E")  # with a plot in the bin


@dataclass(frozen=True, eq=False)
class ReferenceCells(Struct):
    """The reference cells of one radar. `counts` has the hits up to the last decision; later ones are counted at the next."""

    hits: Hits = part(Hits)
    counts: Counts = part(Counts)
    track_id: Ints = column(np.int64, "N")
    cell: Ints = column(np.int64, "N")
    group: Ints = column(np.int64, "N")  # track id of a vessel under way; negative: the square of vessels at rest
    looks: Floats = column(np.float64, "N")  # turns of the antenna while it was in cover, up to the last decision
    new_looks: Floats = column(np.float64, "N")  # since then

    def histograms(self, reference_cells: Ints, grid: Grid) -> NDArray[np.float32]:
        """Turns with a plot in each bin, of some reference cells. (N, D, A) Args: reference_cells: (N,) increasing."""
        at = find(reference_cells, self.counts.reference_cell.astype(np.int64))
        mine = np.flatnonzero(at >= 0)
        turns = np.zeros((len(reference_cells), grid.shape[0] * grid.shape[1]), np.float32)
        turns[at[mine], self.counts.bin[mine]] = self.counts.turns[mine]
        return turns.reshape(-1, *grid.shape)

    def __len__(self) -> int:
        return len(self.track_id)


@dataclass(frozen=True, eq=False)
class Seen(Struct):
    """The compared vessels of one radar in one cycle."""

    track_id: Ints = column(np.int64, "V")
    at_m: Floats = column(np.float64, "V", 2)  # from the radar, east and north
    square: Ints = column(np.int64, "V")  # of SQUARE_M in which it is, below 0
    at_rest: Bools = column(np.bool_, "V")


def squares(position_m: Floats) -> Ints:
    """The number of the square in which each position is, below 0. Args: (V, 2) in the plane of the region."""
    east, north = np.floor(position_m / SQUARE_M).astype(np.int64).T
    number: Ints = -1 - ((east + 2**20) * 2**21 + north + 2**20)
    return number


def count_looks(
    reference_cells: ReferenceCells, seen: Seen, pairs: Pairs, stamp_s: Floats, turns: float, period_s: float, grid: Grid
) -> ReferenceCells:
    """The reference cells after a cycle. The order of pairs has no effect.

    Args: pairs: of this radar, `vessel` is the row in `seen`; stamp_s: of the plot of each pair; turns: of the antenna, that the cycle
    took; period_s: of a turn.
    """
    far = np.hypot(seen.at_m[:, 0], seen.at_m[:, 1]) > NEAREST_M
    reference_cell, reference_cells = _reference_cells_of(reference_cells, seen, far)
    new_looks = reference_cells.new_looks.copy()
    new_looks[reference_cell[far & (reference_cell >= 0)]] += turns
    inside = (reference_cell[pairs.vessel] >= 0) & grid.holds(pairs.range_m, pairs.azimuth_rad)
    new = Hits(
        reference_cell=reference_cell[pairs.vessel[inside]],
        bin=grid.bin_of(pairs.range_m[inside], pairs.azimuth_rad[inside]),
        turn=np.floor(stamp_s[inside] / period_s).astype(np.int64),
    )
    return replace(reference_cells, new_looks=new_looks, hits=Hits.join([reference_cells.hits, new]))


def _reference_cells_of(reference_cells: ReferenceCells, seen: Seen, far: Bools) -> tuple[Ints, ReferenceCells]:
    """The reference cell of each vessel (-1 for one that is near), and all of them with the new ones at the end."""
    distance, azimuth = np.hypot(seen.at_m[:, 0], seen.at_m[:, 1]), np.arctan2(seen.at_m[:, 0], seen.at_m[:, 1])
    sector = np.floor(azimuth % (2.0 * np.pi) / SECTOR).astype(np.int64)
    ring = np.minimum((distance / RING_M).astype(np.int64), RINGS - 1)
    cell = (sector * RINGS + ring) * 2 + seen.at_rest
    group = np.where(seen.at_rest, seen.square, seen.track_id)
    vessels = np.unique(seen.track_id)
    vessel_of_cell, vessel_now = find(vessels, reference_cells.track_id), find(vessels, seen.track_id)
    cells = 2 * RINGS * 128
    key = np.where(vessel_of_cell >= 0, vessel_of_cell * cells + reference_cells.cell, -1)
    reference_cell = row_of(key, vessel_now * cells + cell)
    fresh = np.flatnonzero((reference_cell < 0) & far)
    fresh = fresh[np.argsort(seen.track_id[fresh], kind="stable")][: MOST_REFERENCE_CELLS - len(reference_cells)]
    reference_cell[fresh] = len(reference_cells) + np.arange(len(fresh))
    grown = replace(
        reference_cells,
        track_id=np.append(reference_cells.track_id, seen.track_id[fresh]),
        cell=np.append(reference_cells.cell, cell[fresh]),
        group=np.append(reference_cells.group, group[fresh]),
        looks=np.append(reference_cells.looks, np.zeros(len(fresh))),
        new_looks=np.append(reference_cells.new_looks, np.zeros(len(fresh))),
    )
    return np.where(far, reference_cell, -1), grown


def counted(reference_cells: ReferenceCells, keep: float, grid: Grid) -> ReferenceCells:
    """The reference cells with their hits in the histograms, sorted by group, vessel and cell, without those of few looks.

    A bin gets at most one hit a turn. Args: keep: factor of the former looks and hits.
    """
    rows, columns = grid.shape
    looks = reference_cells.looks * keep + reference_cells.new_looks
    kept = np.flatnonzero(looks > LEAST_LOOKS)
    if len(kept) > 0.95 * MOST_REFERENCE_CELLS:  # room for new ones: least looks go first
        kept = np.sort(kept[np.argsort(-looks[kept], kind="stable")[: int(0.9 * MOST_REFERENCE_CELLS)]])
    order = kept[np.lexsort((reference_cells.cell[kept], reference_cells.track_id[kept], reference_cells.group[kept]))]
    place = np.full(len(reference_cells) + 1, -1, np.int64)
    place[order] = np.arange(len(order))
    bins, former = rows * columns, reference_cells.counts
    mine = place[former.reference_cell] >= 0
    cell, turns = place[former.reference_cell[mine]] * bins + former.bin[mine], former.turns[mine] * np.float32(keep)
    hits = reference_cells.hits.take(place[reference_cells.hits.reference_cell] >= 0)
    new, number = _turns_with_hits(place[hits.reference_cell] * bins + hits.bin, hits.turn)
    cell, at = np.unique(np.concatenate([cell, new]), return_inverse=True)
    turns = np.bincount(at, np.concatenate([turns, number]), len(cell)).astype(np.float32)
    return ReferenceCells(
        hits=Hits.empty(),
        counts=Counts((cell // bins).astype(np.int32), (cell % bins).astype(np.int32), turns),
        track_id=reference_cells.track_id[order],
        cell=reference_cells.cell[order],
        group=reference_cells.group[order],
        looks=looks[order],
        new_looks=np.zeros(len(order)),
    )


def _turns_with_hits(cell: Ints, turn: Ints) -> tuple[Ints, Ints]:
    """The cells that were hit, increasing, and in how many turns. Args: (H,)"""
    if not len(cell):
        return cell, cell
    first, span = turn.min(), int(np.ptp(turn)) + 1
    cells, number = np.unique(np.unique(cell * span + (turn - first)) // span, return_counts=True)
    return cells, number.astype(np.int64)
