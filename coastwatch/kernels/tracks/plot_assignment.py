"""Which plot goes to which track: global nearest neighbour over the candidates of one batch. Scalar code, compiled by numba.

Source: S. Blackman, R. Popoli, Design and Analysis of Modern Tracking Systems, 1999, section 6.4 (global nearest neighbour).
"""

import numpy as np

from coastwatch.kernels.association.assignment import assign_rows
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tracks.columns import CONFIRMED, SINGLE, TENTATIVE


@jit
def assign_plots(pairs, gain, due, status, plots):  # type: ignore[no-untyped-def]
    """The track of each plot, -1 for none, and which plots may begin a track. (M,), (M,)

    Plots go to confirmed tracks first, then to tentative ones, then to single plots: in each step so that the gains sum to the most,
    each plot and each track in one pair at most. A pair without a positive gain is never taken. Of pairs with equal gains the one of the
    earlier plot is taken, and of one plot that of the older track: the first in `pairs`.
    A vessel gives a radar one plot a look. Where a track of several plots is due and gets none in this batch, a plot
    in its gate neither goes to a single plot nor begins a track. Where the track got its own, the plot is of another vessel.
    Args: pairs: Candidates of one radar, sorted by plot; gain: (A,) log-likelihood ratio of each; due: (A,) the track has had no plot of
    this radar in this look; status: (S,) of the tracks; plots: M.
    """
    track, free, served = np.full(plots, -1), np.ones(plots, np.bool_), np.zeros(len(status), np.bool_)
    place = np.full(len(status), -1)
    for step in (CONFIRMED, TENTATIVE, SINGLE):
        if step == SINGLE:
            for k in range(len(pairs.plot)):  # plots in the gate of a track that still waits for one are not free
                if status[pairs.track[k]] != SINGLE and due[k] and not served[pairs.track[k]]:
                    free[pairs.plot[k]] = False
        chosen = _assign_step(pairs, gain, due & free[pairs.plot] & (status[pairs.track] == step), place)
        for a in np.flatnonzero(chosen):
            track[pairs.plot[a]] = pairs.track[a]
            free[pairs.plot[a]] = False
            served[pairs.track[a]] = True
    return track, free


@jit
def _assign_step(pairs, gain, eligible, place):  # type: ignore[no-untyped-def]
    """Which of the eligible pairs to take. (A,) Args: place: (S,) all -1, and again after the call."""
    some = np.flatnonzero(eligible & (gain > 0.0))
    row, column, rows, columns = np.empty(len(some), np.int64), np.empty(len(some), np.int64), 0, 0
    for k in range(len(some)):
        a = some[k]
        if k == 0 or pairs.plot[a] != pairs.plot[some[k - 1]]:
            rows += 1
        if place[pairs.track[a]] < 0:
            place[pairs.track[a]] = columns
            columns += 1
        row[k], column[k] = rows - 1, place[pairs.track[a]]
    for a in some:
        place[pairs.track[a]] = -1
    chosen = np.zeros(len(eligible), np.bool_)
    chosen[some] = assign_rows(row, column, gain[some], rows, columns)
    return chosen
