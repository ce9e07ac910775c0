"""Runs of cells joined from spoke to spoke, and the moments of each echo that is complete."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.association.connected_components import root
from coastwatch.kernels.jit import jit

NUMBERS = (
    *("first_cell", "first_azimuth", "first_time"),
    *("weight", "cell", "azimuth", "time", "cell2", "azimuth2", "both"),
    *("cells", "peak", "row"),
)
ECHO = np.dtype([(name, np.float64) for name in NUMBERS])
"""Weighted sums of the cells of an echo about its first cell, in cells, rad and s. Azimuths grow from turn to turn.

`row` is the spoke at which nothing joined it.
"""


@jit
def joined(runs, excess, spokes, rows, gap, before):  # type: ignore[no-untyped-def]
    """The echoes that are complete, and the runs and echoes that are open after the last spoke. (F,), (K, 3), (K,)

    Runs of neighbouring spokes that touch, corners too, are of one echo; a gap between spokes ends all. The weight of a cell is
    10^(excess / 20 dB). Args: runs: (K, 3) row, first cell, end, in order; excess: dB of their cells; spokes: angle, azimuth, time,
    (R,) each; rows: first and last + 1; gap: rad; before: open runs (first cell, end, echo) and open echoes, as returned.
    """
    angle, azimuth, time = spokes
    open_run, echo = before
    done, finished, at, cell = np.empty(len(runs) + len(echo), ECHO), 0, 0, 0
    for row in range(rows[0], rows[1]):
        if row > 0 and angle[row] - angle[row - 1] > gap:
            none = np.zeros(len(echo), np.bool_)
            finished = _close(np.arange(len(echo)), len(echo), none, echo, row, done, finished)
            open_run, echo = open_run[:0], echo[:0]
        first = at
        while at < len(runs) and runs[at, 0] == row:
            at += 1
        if at == first and len(echo) == 0:
            continue
        old, count = len(echo), at - first
        parent = np.arange(old + count)
        every = np.zeros(old + count, ECHO)
        every[:old] = echo
        place = angle[row] + wrap_angle(azimuth[row] - angle[row])  # an echo may go round the radar
        cell = _measure(runs[first:at], excess, cell, (place, time[row]), every[old:])
        _join(runs[first:at], open_run, old, parent, every)
        open_run, echo, is_open = _open(runs[first:at], old, parent, every)
        finished = _close(parent, old, is_open, every, row, done, finished)
    return done[:finished], open_run, echo


@jit
def _measure(runs, excess, cell, spoke, out):  # type: ignore[no-untyped-def]
    """Write each run of a spoke as an echo of its own. Args: cell: first of `excess`; spoke: azimuth, time. Returns: the next cell."""
    for k in range(len(runs)):
        e = out[k]
        e.first_cell, e.first_azimuth, e.first_time = runs[k, 1], spoke[0], spoke[1]
        for c in range(runs[k, 2] - runs[k, 1]):
            weight = 10.0 ** (np.float64(excess[cell]) / 20.0)
            e.weight += weight
            e.cell += weight * c
            e.cell2 += weight * c * c
            e.cells += 1
            e.peak = max(e.peak, excess[cell])
            cell += 1
    return cell


@jit
def _join(runs, open_run, old, parent, every):  # type: ignore[no-untyped-def]
    """Join the echoes of runs that touch; the one that is first in range takes the others in."""
    i, j = 0, 0
    while i < len(runs) and j < len(open_run):
        if runs[i, 1] <= open_run[j, 1] and open_run[j, 0] <= runs[i, 2]:
            new, former = root(parent, old + i), root(parent, open_run[j, 2])
            if new >= old:
                _take_in(every[former], every[new])
                parent[new] = former
            elif new != former:
                _take_in(every[new], every[former])
                parent[former] = new
        if runs[i, 2] < open_run[j, 1]:
            i += 1
        else:
            j += 1


@jit
def _take_in(e, other):  # type: ignore[no-untyped-def]
    """Add the moments of another echo, moved to the first cell of this one."""
    w = other.weight
    dc, da, dt = other.first_cell - e.first_cell, other.first_azimuth - e.first_azimuth, other.first_time - e.first_time
    e.cell2 += other.cell2 + 2.0 * dc * other.cell + dc * dc * w
    e.azimuth2 += other.azimuth2 + 2.0 * da * other.azimuth + da * da * w
    e.both += other.both + dc * other.azimuth + da * other.cell + dc * da * w
    e.cell += other.cell + dc * w
    e.azimuth += other.azimuth + da * w
    e.time += other.time + dt * w
    e.weight += w
    e.cells += other.cells
    e.peak = max(e.peak, other.peak)


@jit
def wrap_angle(angle):  # type: ignore[no-untyped-def]
    """An angle from -pi to pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@jit
def _open(runs, old, parent, every):  # type: ignore[no-untyped-def]
    """The runs of this spoke with the echoes they are of, numbered by their first runs; and which of all echoes those are."""
    number, is_open, count = np.full(len(every), -1), np.zeros(len(every), np.bool_), 0
    open_run, echo = np.empty((len(runs), 3), np.int64), np.empty(len(runs), ECHO)
    for k in range(len(runs)):
        top = root(parent, old + k)
        if number[top] < 0:
            number[top] = count
            echo[count] = every[top]
            is_open[top] = True
            count += 1
        open_run[k, 0], open_run[k, 1], open_run[k, 2] = runs[k, 1], runs[k, 2], number[top]
    return open_run, echo[:count], is_open


@jit
def _close(parent, old, is_open, every, row, done, finished):  # type: ignore[no-untyped-def]
    """Write the echoes of the spoke before that nothing joined, behind those that are finished. Returns: how many are."""
    for k in range(old):
        if parent[k] == k and not is_open[k]:
            done[finished] = every[k]
            done[finished].row = row
            finished += 1
    return finished
