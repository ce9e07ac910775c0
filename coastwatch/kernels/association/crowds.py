"""Crowds: places with so many others around them that each is compared with the nearest alone.

A place gets the greatest of gate, gate / 2^(1/2), gate / 2, ... within which no more than `most` places are, itself one of them. A place
with at most `most` places within the gate is compared with all of them. Places are sought in the cell of that side around it and the
26 cells beside it, which hold all within that distance. The work of a place is bounded: where more than `WIDE` * `most` places are
in these cells they are not counted one by one, and the distance is taken as too great. Cells are of Earth-centred positions.

Source: H. Samet, Foundations of Multidimensional and Metric Data Structures, 2006, section 1.4 (cells split by what they hold).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints, Records
from coastwatch.kernels.association.places import TURN, find_runs, reach_of
from coastwatch.kernels.jit import jit

STEPS = 20
"""Distances below the gate, at most. Of more places within the last one only the first `most` are compared, the own cell first."""

WIDE = 8  # places in the cells around one that are looked at, for each that it is compared with

AXIS_BITS = 21  # of a cell along an axis; cells that far apart share a number, which costs time alone
AROUND = 27  # cells: its own and those beside it
RUNS = 6  # of places in the grid of bands that may be within the gate


class Crowds(NamedTuple):
    """Cells of crowded places. Plain arrays, so that workers can read them."""

    cell: Ints  # (N,) of each place, -1 for one that is not crowded; (0,): nobody is
    near_m: Floats  # (C,) distance to which the places of the cell are compared
    run: Ints  # (C, 27, 2) start and end in `place` of what is in the cell, and in those beside it
    place: Ints  # (Q,) rows of places
    most: int  # places that one is compared with, itself one of them
    left_out: int  # pairs within the gate that are not compared, at most


def no_crowds() -> Crowds:
    """Nobody is crowded."""
    none = np.zeros(0, np.int64)
    return Crowds(none, np.zeros(0), np.zeros((0, AROUND, 2), np.int64), none, 0, 0)


@jit
def _may_be_crowded(key, gate_m, run_length):  # type: ignore[no-untyped-def]
    """Whether so many places of one band are within twice the reach of the gate. Args: key: (N,) sorted."""
    band, width = -1, 0
    for i in range(len(key) - run_length):
        if key[i] // TURN != band:
            band = key[i] // TURN
            width = 2 * reach_of(band, gate_m)
        if key[i + run_length] - key[i] <= width and key[i + run_length] // TURN == band:
            return True
    return False


@jit
def _places_in_runs(key, gate_m, most, around):  # type: ignore[no-untyped-def]
    """How many places are in the runs of each, itself one of them. (N,)

    Args: key: (N,) sorted; around: (N + 1,) written: the change of how many crowded places a place may be within the gate of.
    """
    run, out, band, reach = np.zeros((RUNS, 2), np.int64), np.zeros(len(key), np.int64), -1, 0
    around[:] = 0
    for i in range(len(key)):
        if key[i] // TURN != band:
            band = key[i] // TURN
            reach = reach_of(band, gate_m)
            for k in range(3):
                run[k, 0] = run[k, 1] = np.searchsorted(key, (band + k - 1) * TURN)
        find_runs(key[i], reach, key, run)
        for k in range(RUNS):
            out[i] += run[k, 1] - run[k, 0]
        if out[i] > most:
            for k in range(RUNS):
                around[run[k, 0]] += 1
                around[run[k, 1]] -= 1
    return out


@jit
def _runs_around(cell, start, run):  # type: ignore[no-untyped-def]
    """How many places are in each cell and those beside it. (C,)

    Args: cell: (C,) sorted numbers; start: (C + 1,) of the places of each; run: (C, 27, 2) written, its own cell first.
    """
    mask, count = (1 << AXIS_BITS) - 1, np.zeros(len(cell), np.int64)
    for c in range(len(cell)):
        x, y, z = cell[c] >> (2 * AXIS_BITS), (cell[c] >> AXIS_BITS) & mask, cell[c] & mask
        run[c, 0, 0], run[c, 0, 1], count[c], k = start[c], start[c + 1], start[c + 1] - start[c], 1
        for step in range(AROUND):
            i, j, h = step // 9 - 1, step // 3 % 3 - 1, step % 3 - 1
            if i == 0 and j == 0 and h == 0:
                continue
            wanted = (((x + i) & mask) << (2 * AXIS_BITS)) | (((y + j) & mask) << AXIS_BITS) | ((z + h) & mask)
            at = np.searchsorted(cell, wanted)
            found = at < len(cell) and cell[at] == wanted
            run[c, k, 0], run[c, k, 1] = (start[at], start[at + 1]) if found else (0, 0)
            count[c] += run[c, k, 1] - run[c, k, 0]
            k += 1
    return count


@jit
def _places_within(position_m, source, rows, of_row, run, reach_m, most, whole):  # type: ignore[no-untyped-def]
    """How many places are within the reach of each of these rows, itself among them, and how many of these have a later source.

    Args: position_m: (Q, 3) by cell; source: (Q,); rows: (R,); of_row: (Q,) cell of each; run: (C, 27, 2); whole: count on where more
    than `most` are within. Returns: (R,), (R,).
    """
    within, later = np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64)
    reach2 = reach_m * reach_m
    for r in range(len(rows)):
        q = rows[r]
        cell, at = of_row[q], position_m[q]
        for k in range(AROUND):
            for i in range(run[cell, k, 0], run[cell, k, 1]):
                x, y, z = position_m[i, 0] - at[0], position_m[i, 1] - at[1], position_m[i, 2] - at[2]
                near = x * x + y * y + z * z <= reach2
                within[r] += near
                later[r] += near & (source[i] > source[q])
            if within[r] > most and not whole:
                break
    return within, later


def _cell_numbers(position_m: Floats, side_m: float) -> Ints:
    """The number of the cell of each position. Args: (N, 3) Earth-centred. Returns: (N,)."""
    x, y, z = (np.floor(position_m / side_m).astype(np.int64) & ((1 << AXIS_BITS) - 1)).T
    return np.asarray((x << (2 * AXIS_BITS)) | (y << AXIS_BITS) | z)


def find_crowds(place: Records, rank: Ints, gate_m: float, most: int) -> Crowds:
    """The crowded places, and with which places they are compared.

    Args: place: (N,) PLACE; rank: (N,) order of the places that no cell tells apart; most: places that one is compared with.
    """
    key = np.ascontiguousarray(place["key"])
    if len(key) <= most or not _may_be_crowded(key, gate_m, most // RUNS):
        return no_crowds()
    around = np.empty(len(key) + 1, np.int64)
    before = _places_in_runs(key, gate_m, most, around)
    open_ = before > most  # places whose cell is not known yet
    if not open_.any():
        return no_crowds()
    position_m, source = np.column_stack([place["x_m"], place["y_m"], place["z_m"]]), np.ascontiguousarray(place["source"])
    cell, missed = np.full(len(key), -1, np.int64), before - 1  # missed: pairs of each, at most
    near_m, runs, places = [np.zeros(0)], [np.zeros((0, AROUND, 2), np.int64)], [np.zeros(0, np.int64)]
    cells = rows = 0
    row = np.flatnonzero(np.cumsum(around[:-1]) > 0)  # places near those of an unknown cell
    for step in range(STEPS + 1):
        side_m = gate_m * 0.5 ** (0.5 * step)
        number = _cell_numbers(position_m[row], side_m)
        order = np.lexsort((rank[row], number))
        row, number = row[order], number[order]
        first = np.flatnonzero(np.append(True, number[1:] != number[:-1]))
        start, of_row = np.append(first, len(row)), np.repeat(np.arange(len(first)), np.diff(np.append(first, len(row))))
        run = np.empty((len(first), AROUND, 2), np.int64)
        count = _runs_around(number[first], start, run)
        counted = np.flatnonzero(open_[row] & (count[of_row] <= WIDE * most))
        within, later = _places_within(position_m[row], source[row], counted, of_row, run, side_m, most, step == 0)
        if step == 0:
            missed[row[counted]] = later
            rest = np.setdiff1d(np.flatnonzero(open_), row[counted])
            missed[rest] -= np.maximum(missed[rest] - (len(key) - len(rest)), 0) // 2  # pairs of two of the rest count at both
        fits = within <= most
        missed[row[counted[fits]]] -= later[fits]
        done = open_[row] & (step == STEPS)
        done[counted[fits]] = True
        taken = np.flatnonzero(np.bincount(of_row[done], minlength=len(first)) > 0)
        name = np.full(len(first), -1, np.int64)
        name[taken] = cells + np.arange(len(taken))
        cell[row[done]] = name[of_row[done]]
        near_m.append(np.full(len(taken), side_m))
        runs.append(run[taken] + rows)
        places.append(row)
        cells, rows = cells + len(taken), rows + len(row)
        open_[row[done]] = False
        if not open_.any():
            break
        has_open = np.bincount(of_row[open_[row]], minlength=len(first)) > 0
        row = row[_beside(run[has_open], len(row))]
    left_out = int(missed[cell >= 0].sum())
    return Crowds(cell, np.concatenate(near_m), np.concatenate(runs), np.concatenate(places), most, left_out)


def _beside(run: Ints, count: int) -> Ints:
    """What is in any of these runs. Args: run: (C, 27, 2) of so many places. Returns: sorted."""
    change = np.bincount(run[:, :, 0].ravel(), minlength=count + 1) - np.bincount(run[:, :, 1].ravel(), minlength=count + 1)
    return np.flatnonzero(np.cumsum(change[:count]) > 0)
