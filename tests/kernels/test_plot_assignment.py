"""Plots to tracks, status by status, against scipy's dense assignment."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import linear_sum_assignment

from coastwatch.kernels.tracks.columns import CONFIRMED, SINGLE, TENTATIVE, Candidates
from coastwatch.kernels.tracks.plot_assignment import assign_plots

pytestmark = pytest.mark.oracle


def pairs_of(plot, track):
    plot, track = np.asarray(plot, np.int64), np.asarray(track, np.int64)
    return Candidates(plot, track, np.zeros(len(plot)), np.zeros(len(plot)))


def by_status(plot, track, gain, due, status, plots):
    """The same with dense matrices."""
    taken, free, served = np.full(plots, -1), np.ones(plots, bool), set()
    for step in (CONFIRMED, TENTATIVE, SINGLE):
        if step == SINGLE:
            for p, t, d in zip(plot, track, due, strict=True):
                if status[t] != SINGLE and d and t not in served:
                    free[p] = False
        dense = np.zeros((plots, len(status)))
        for p, t, g, d in zip(plot, track, gain, due, strict=True):
            if d and free[p] and status[t] == step:
                dense[p, t] = max(g, 0.0)
        for p, t in zip(*linear_sum_assignment(dense, maximize=True), strict=True):
            if dense[p, t] > 0.0:
                taken[p], free[p] = t, False
                served.add(t)
    return taken, free


@given(st.integers(1, 10), st.integers(1, 10), st.integers(0, 10**9))
def test_as_dense_matrices_say(plots, tracks, seed):
    rng = np.random.default_rng([seed, 51])
    plot, track = np.nonzero(rng.random((plots, tracks)) < rng.random())
    gain, due = rng.normal(1.0, 2.0, len(plot)), rng.random(len(plot)) < 0.8
    status = rng.integers(0, 3, tracks)
    got = assign_plots(pairs_of(plot, track), gain, due, status, plots)
    want = by_status(plot, track, gain, due, status, plots)
    assert np.array_equal(got[0], want[0])
    assert np.array_equal(got[1], want[1])


def test_a_plot_goes_to_the_confirmed_track_though_the_tentative_one_is_nearer():
    slot, free = assign_plots(
        pairs_of([0, 0], [0, 1]), np.array([1.0, 9.0]), np.ones(2, bool), np.array([CONFIRMED, TENTATIVE]), 1
    )
    assert slot.tolist() == [0]
    assert free.tolist() == [False]


@pytest.mark.parametrize(("gain", "slot"), [(-0.1, -1), (0.1, 0)])
def test_status_does_not_make_up_for_a_negative_gain(gain, slot):
    got, free = assign_plots(pairs_of([0], [0]), np.array([gain]), np.ones(1, bool), np.array([CONFIRMED]), 1)
    assert got.tolist() == [slot]
    assert not free[0], "in the gate of a track that waits it begins none"


@pytest.mark.parametrize(
    ("plot", "track", "want"),
    [
        ([0, 0, 0], [5, 2, 9], [5]),  # the older track is the first
        ([0, 1, 2], [4, 4, 4], [4, -1, -1]),
        ([0, 0, 1, 1], [7, 3, 7, 3], [7, 3]),
        ([0, 0, 1, 1, 2, 2], [7, 3, 7, 3, 7, 3], [7, 3, -1]),
        ([0, 0, 0, 1, 1, 1], [8, 1, 6, 8, 1, 6], [8, 1]),
    ],
)
def test_equal_gains_go_to_the_earlier_plot_and_the_older_track(plot, track, want):
    count = len(want)
    slot, _ = assign_plots(pairs_of(plot, track), np.ones(len(plot)), np.ones(len(plot), bool), np.full(10, CONFIRMED), count)
    assert slot.tolist() == want


def test_a_second_plot_in_the_gate_of_a_track_that_was_served_is_free():
    status = np.array([TENTATIVE])
    slot, free = assign_plots(pairs_of([0, 1], [0, 0]), np.array([2.0, 1.0]), np.ones(2, bool), status, 2)
    assert slot.tolist() == [0, -1]
    assert free.tolist() == [False, True]


def test_a_track_served_in_this_look_neither_takes_nor_holds():
    slot, free = assign_plots(pairs_of([0], [0]), np.ones(1), np.zeros(1, bool), np.array([CONFIRMED]), 1)
    assert slot.tolist() == [-1]
    assert free.tolist() == [True]
