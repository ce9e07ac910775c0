"""Gates by combined estimates against all pairs in numpy; the speed gate of single plots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import multivariate_normal
from tracker_world import columns_of, estimates_of

from coastwatch.kernels.tracks import gate
from coastwatch.kernels.tracks.columns import CONFIRMED, SINGLE

pytestmark = pytest.mark.oracle

LIMIT, LATE = 13.8, 5.0


def innovation(estimates, n, columns, m):
    """Innovation and its covariance, from matrices."""
    dt = columns.time[m] - estimates.time[n]
    f = np.eye(4)
    f[0, 2] = f[1, 3] = dt
    p = estimates.covariance[n]
    grown = (f @ p @ f.T)[:2, :2] + np.eye(2) * estimates.noise[n] * dt**3 / 3.0
    spread = grown if dt >= 0.0 else p[:2, :2] + p[2:, 2:] * dt**2
    return columns.position[m] - (f @ estimates.mean[n])[:2], spread + columns.covariance[m]


@given(st.integers(0, 40), st.integers(0, 20), st.integers(0, 10**6))
def test_candidates_are_all_pairs_in_the_gate(n, m, seed):
    estimates, columns = estimates_of(n, seed), columns_of(m, seed)
    rows = np.random.default_rng([seed, 43]).permutation(n)[: n - n // 4]
    pairs = gate.candidates(estimates, rows, columns, LIMIT, LATE)
    got = dict(zip(zip(pairs.plot.tolist(), pairs.track.tolist(), strict=True), range(len(pairs.plot)), strict=True))
    assert len(got) == len(pairs.plot)
    age = np.argsort(rows)[np.searchsorted(np.sort(rows), pairs.track)]  # place in rows
    assert (np.lexsort((age, pairs.plot)) == np.arange(len(age))).all()
    for plot in range(m):
        for track in rows.tolist():
            gap, spread = innovation(estimates, track, columns, plot)
            square = gap @ np.linalg.solve(spread, gap)
            wanted = square <= LIMIT and columns.time[plot] - estimates.time[track] >= -LATE
            assert ((plot, track) in got) == wanted
            if wanted:
                k = got[plot, track]
                assert pairs.distance2[k] == pytest.approx(square, rel=1e-7)
                assert pairs.log_likelihood[k] == pytest.approx(multivariate_normal.logpdf(gap, np.zeros(2), spread), abs=1e-6)


def test_a_plot_far_off_changes_no_pair_of_the_others_and_no_cell_of_the_tracks():
    estimates, columns = estimates_of(200, 7), columns_of(50, 7)
    want = gate.candidates(estimates, np.arange(200), columns, LIMIT, LATE)
    position = columns.position.copy()
    position[49] = 3e7
    far = columns._replace(position=position)
    got = gate.candidates(estimates, np.arange(200), far, LIMIT, LATE)
    near = want.plot != 49
    assert set(zip(got.plot.tolist(), got.track.tolist(), strict=True)) == set(
        zip(want.plot[near].tolist(), want.track[near].tolist(), strict=True)
    )
    assert gate._grid_near_plots(estimates, np.arange(200), far, LIMIT)[0].side < 1e5


def test_the_speed_gate_is_of_single_plots():
    estimates, columns = estimates_of(30, 1), columns_of(20, 1)
    pairs = gate.candidates(estimates, np.arange(30), columns, 1e6, 1e3)
    status = np.where(np.arange(30) % 2 == 0, SINGLE, CONFIRMED)
    got = gate.reachable(pairs, estimates, status, columns, 10.0)
    gap = np.linalg.norm(columns.position[pairs.plot] - estimates.mean[pairs.track, :2], axis=1)
    both = columns.covariance[pairs.plot] + estimates.covariance[pairs.track, :2, :2]
    dt = np.abs(columns.time[pairs.plot] - estimates.time[pairs.track])
    near = gap <= 10.0 * dt + 3.0 * np.sqrt(np.trace(both, axis1=1, axis2=2))
    assert len(got) == 30 * 20
    assert np.array_equal(got, near | (status[pairs.track] == CONFIRMED))
    assert 0 < near.sum() < len(near)
