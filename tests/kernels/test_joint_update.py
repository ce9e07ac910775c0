"""Tracks that weigh several plots: the mixture against whole Kalman updates; existence against a Markov chain by hand."""

from __future__ import annotations

import joint_update_textbook as textbook
import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.filters import motion_models
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.imm import combine_filters
from coastwatch.kernels.tracks.columns import DetectionColumns, ExistenceColumns, PlotColumns, RadarColumns
from coastwatch.kernels.tracks.existence import ExistenceChain, after, count_missed_looks, missed, predict_existence
from coastwatch.kernels.tracks.joint_update import Hypotheses, predict_to_plots, update_by_shares

pytestmark = pytest.mark.oracle

ROUNDING = 1e-10
TIME = 7.0
CHAIN = ExistenceChain(end=0.01, hide=0.06, show=0.3)
MODELS = motion_models.table(
    kind=[motion_models.STRAIGHT, motion_models.STRAIGHT, motion_models.TURNING],
    noise=[0.01, 1.0, 0.01],
    manoeuvre_sigma=0.05,
    manoeuvre_noise=1e-4,
    prior_probability=[0.6, 0.2, 0.2],
    sojourn=100.0,
)


def filters_of(tracks, seed):
    """Random filters of three models, all at one time."""
    rng = np.random.default_rng([seed, 71])
    state = rng.normal(size=(tracks, 3, 5)) * np.array([30.0, 30.0, 3.0, 3.0, 0.02])
    root = rng.normal(size=(tracks, 3, 5, 7)) * np.array([10.0, 10.0, 2.0, 2.0, 0.02])[:, None]
    filters = state, root @ root.swapaxes(-1, -2), rng.dirichlet(np.ones(3), tracks)
    estimates = Estimates(np.full(tracks, TIME), np.empty((tracks, 4)), np.empty((tracks, 4, 4)), np.empty(tracks))
    combine_filters(filters, estimates, np.arange(tracks), MODELS)
    return filters, estimates


def plots_of(count, seed, time=TIME):
    rng = np.random.default_rng([seed, 72])
    root = rng.normal(size=(count, 2, 3)) * 5.0
    no = np.zeros(count, np.int64)
    return PlotColumns(np.full(count, time), rng.normal(size=(count, 2)) * 30.0, root @ root.swapaxes(-1, -2), no, no)


def hypotheses_of(slots, start, plot):
    count = len(plot)
    given = np.asarray(slots), np.asarray(start), np.asarray(plot, np.int64)
    return Hypotheses(*given, np.empty((count, 2)), np.empty((count, 2, 2)), np.empty((count, 3)))


@given(st.integers(0, 10**9))
def test_the_mixture_is_that_of_whole_updates(seed):
    """Three tracks with two, none of, and three of five plots; the last track shares plots with the first."""
    filters, estimates = filters_of(3, seed)
    columns, pairs = plots_of(5, seed), hypotheses_of([0, 2], [0, 2, 5], [1, 3, 0, 1, 4])
    before = tuple(a.copy() for a in filters)
    share = np.random.default_rng([seed, 73]).dirichlet(np.ones(4), 2)[:, :3]
    share = np.concatenate([share[0, :2], share[1]])
    predict_to_plots(filters, estimates, pairs, columns, np.zeros(len(pairs.slot)), np.inf, MODELS)
    update_by_shares(filters, estimates, pairs, share, 0.0, MODELS)
    for t, n in enumerate((0, 2)):
        mine = slice(pairs.start[t], pairs.start[t + 1])
        measured = [(columns.position[m], columns.covariance[m]) for m in pairs.plot[mine]]
        given_models = [textbook.likelihoods(before[0][n], before[1][n], *one) for one in measured]
        np.testing.assert_allclose(pairs.likelihood[mine], np.maximum(given_models, 1e-200), rtol=1e-8)
        if np.min(given_models) > 1e-100:  # the textbook divides by them
            want = textbook.update(before[0][n], before[1][n], before[2][n], measured, share[mine])
            for column, expected in zip(filters, want, strict=True):
                np.testing.assert_allclose(column[n], expected, rtol=1e-7, atol=ROUNDING * np.abs(expected).max())
    for column, untouched in zip(filters, before, strict=True):
        assert np.array_equal(column[1], untouched[1])


def test_all_plots_improbable_leaves_the_prediction():
    filters, estimates = filters_of(1, 4)
    columns, pairs = plots_of(2, 4, TIME + 2.0), hypotheses_of([0], [0, 2], [0, 1])
    predict_to_plots(filters, estimates, pairs, columns, np.zeros(len(pairs.slot)), np.inf, MODELS)
    predicted = tuple(a.copy() for a in filters)
    update_by_shares(filters, estimates, pairs, np.zeros(2), 1e-6, MODELS)
    assert estimates.time[0] == TIME + 2.0
    for column, want in zip(filters, predicted, strict=True):
        np.testing.assert_allclose(column, want, rtol=1e-12)


def test_an_older_plot_is_brought_forward_by_the_velocity():
    filters, estimates = filters_of(1, 5)
    columns, pairs = plots_of(1, 5, TIME - 2.0), hypotheses_of([0], [0, 1], [0])
    predict_to_plots(filters, estimates, pairs, columns, np.zeros(len(pairs.slot)), np.inf, MODELS)
    assert estimates.time[0] == TIME
    np.testing.assert_allclose(pairs.position[0], columns.position[0] + 2.0 * estimates.mean[0, 2:])
    np.testing.assert_allclose(pairs.noise[0], columns.covariance[0] + 4.0 * estimates.covariance[0, 2:, 2:])


@given(
    st.lists(st.tuples(st.floats(0.0, 20.0), st.floats(0.1, 0.99)), max_size=6), st.floats(0.01, 0.99), st.floats(0.01, 0.99)
)
def test_existence_and_visibility_are_a_markov_chain(looks, existence, visibility):
    by_hand, r, eta = textbook.ThreeStates(existence, visibility, *CHAIN), existence, visibility
    for dt, detection in looks:
        by_hand.wait(dt)
        by_hand.miss(detection)
        r, eta = after(r, eta, dt, CHAIN)
        r, eta, _ = missed(r, eta, detection)
    assert r == pytest.approx(by_hand.existence, rel=1e-9)
    assert eta == pytest.approx(by_hand.visibility, rel=1e-9)


def existing(tracks, radars, looked):
    one = np.full(tracks, 0.9), np.full(tracks, 0.8), np.zeros(tracks)
    never = np.full((tracks, radars), -np.inf)
    return ExistenceColumns(*one, np.full((tracks, radars), looked), np.zeros(tracks), never)


def detecting(probability, miss=1.0):
    return DetectionColumns(np.asarray(probability), np.full(len(probability), miss), np.zeros(len(probability)))


def test_looks_count_where_a_radar_covers_and_sends():
    """Track 0 is covered by a radar that turned twice; track 1 by none; the third radar covers both and sends nothing."""
    _, estimates = filters_of(2, 6)
    estimates.mean[:] = [[0.0, 0.0, 0.0, 0.0], [9000.0, 0.0, 0.0, 0.0]]
    radars = RadarColumns(np.zeros((2, 2)), np.array([1000.0, 1e5]), np.array([3.0, 2.0]), np.array([6.7, -np.inf]))
    life, by_hand = existing(2, 3, 0.0), textbook.ThreeStates(0.9, 0.8, *CHAIN)
    count_missed_looks(life, estimates, np.arange(2), radars, np.array([2, 1]), detecting([0.5, 0.9, 0.7]), 0.1, CHAIN)
    for _ in range(2):
        by_hand.wait(3.0)
        by_hand.miss(0.7)
    assert life.misses.tolist() == [2, 0]
    assert life.looked[:, 2].tolist() == [6.0, 6.7]
    assert life.existence.tolist() == pytest.approx([by_hand.existence, 0.9])
    assert life.visibility.tolist() == pytest.approx([by_hand.visibility, 0.8])


def test_looks_without_a_plot_before_a_plot_count_and_time_does_not_go_back():
    """Of one radar with a turn of 3 s: a plot after 9.1 s, so two misses; one of before the newest look, so none."""
    life, by_hand = existing(2, 1, 0.0), textbook.ThreeStates(0.9, 0.8, *CHAIN)
    predict_existence(life, np.arange(2), np.array([9.1, -3.0]), 0, 3.0, detecting([0.7]), CHAIN)
    for _ in range(2):
        by_hand.wait(3.0)
        by_hand.miss(0.7)
    by_hand.wait(3.1)
    assert life.time.tolist() == [9.1, 0.0]
    assert life.misses.tolist() == [2, 0]
    assert life.existence.tolist() == pytest.approx([by_hand.existence, 0.9])
