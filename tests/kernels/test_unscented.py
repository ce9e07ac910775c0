"""Unscented IMM-JPDA: the kernels against the textbook, look after look; zero padding; speed that turns negative."""

from __future__ import annotations

import numpy as np
import pytest
import unscented_textbook as textbook

from coastwatch import kernels
from coastwatch.kernels.filters.unscented import MotionRules
from coastwatch.kernels.tracks.polar_update import PolarPlots

pytestmark = pytest.mark.oracle

ROUNDING = 1e-9  # of sums in another order, over ten looks
GATE, DETECTION, PERIOD_S = 13.8, 0.95, 2.4
NOISE = np.array([[np.radians(0.1) ** 2, 0.05**2], [0.05**2, np.radians(0.06) ** 2]])
RULES = MotionRules(np.array([200.0, 60.0]), NOISE, pads_zeros=False)
SITE = np.array([100.0, -50.0])
NEVER = np.full(3, -np.inf)


def tracks_of(count: int, seed: int) -> tuple:
    """Time, state, covariance, mode of tracks close together, near north of the site, where bearings wrap."""
    rng = np.random.default_rng([seed, 81])
    state, covariance = np.zeros((count, 2, 5)), np.zeros((count, 2, 5, 5))
    state[:, :, :2] = SITE + np.array([0.0, -900.0]) + rng.normal(0.0, 12.0, (count, 1, 2))
    state[:, :, 2], state[:, :, 3] = rng.uniform(-np.pi, np.pi, (count, 1)), rng.uniform(1.0, 8.0, (count, 1))
    state[:, 1, 4] = rng.normal(0.0, 0.01, count)
    root = rng.normal(size=(count, 2, 5, 8)) * np.array([8.0, 8.0, 0.05, 0.4, 0.01])[:, None]
    covariance[:] = root @ root.swapaxes(-1, -2) / 8.0
    covariance[:, 0, 4], covariance[:, 0, :, 4] = 0.0, 0.0
    return np.zeros(count), state, covariance, rng.dirichlet([2.0, 2.0], count)


def plots_of(time: float, tracks: tuple, rng: np.random.Generator) -> PolarPlots:
    """A plot near each track but one, and clutter; all at one time."""
    _, state, _, _ = tracks
    dt = time - tracks[0]
    x = state[:, 0]
    own = x[:, :2] + dt[:, None] * x[:, 3:4] * np.column_stack([np.sin(x[:, 2]), np.cos(x[:, 2])])
    position = np.vstack([own[1:] + rng.normal(0.0, 8.0, own[1:].shape), own[:2] + rng.normal(0.0, 40.0, (2, 2))])
    off = position - SITE
    polar = np.column_stack([np.hypot(*off.T), np.arctan2(off[:, 0], off[:, 1])])
    return PolarPlots(np.full(len(off), time), position, polar, np.tile([36.0, np.radians(0.3) ** 2], (len(off), 1)))


@pytest.mark.parametrize("seed", range(2))
def test_ten_looks_are_those_of_the_textbook(seed):
    rng, tracks = np.random.default_rng([seed, 82]), tracks_of(3, seed)
    _, state, covariance, mode = tracks
    slow = [
        ([(s[0, :4], p[0, :4, :4]), (s[1], p[1])], m)
        for s, p, m in zip(state.copy(), covariance.copy(), mode.copy(), strict=True)
    ]
    shared = False
    for look in range(10):
        now = PERIOD_S * (look + 1)
        plots, density = plots_of(now, tracks, rng), 1e-6 * np.linspace(500.0, 1500.0, 4)
        pairs = kernels.tracks.polar_update.predict_to_plots(tracks, plots, NEVER, 0.5 * PERIOD_S, SITE, GATE, RULES)
        weight = DETECTION * (mode[pairs.track] * pairs.likelihood).sum(axis=1) / density[pairs.plot]
        weight /= 1.0 - DETECTION * (1.0 - np.exp(-0.5 * GATE))
        share = kernels.association.marginals.marginals(pairs.plot, pairs.track, weight, 4, 3, 8)
        kernels.tracks.polar_update.update_by_shares(tracks, plots, pairs, share, SITE)
        slow = [textbook.mixed_and_predicted(models, m, PERIOD_S, RULES.sojourn, NOISE) for models, m in slow]
        seen = list(zip(plots.polar, plots.variance, strict=True))
        slow, expected = textbook.looked(slow, seen, SITE, GATE, DETECTION, density)
        dense = np.zeros((3, 4))
        dense[pairs.track, pairs.plot] = share
        np.testing.assert_allclose(dense, expected, rtol=1e-7, atol=ROUNDING)
        shared |= bool((np.sort(expected, axis=0)[-2] > 0.05).any())
        for n, (models, of) in enumerate(slow):
            np.testing.assert_allclose(mode[n], of, atol=ROUNDING)
            for model, (x, p) in enumerate(models):
                size = 4 + model
                off = state[n, model, :size] - x
                off[2] = textbook.wrapped(off[2])
                np.testing.assert_allclose(off, 0.0, atol=1e3 * ROUNDING)  # metres
                np.testing.assert_allclose(covariance[n, model, :size, :size], p, rtol=1e-6, atol=1e3 * ROUNDING)
    assert shared, "no plot was of two tracks"


def test_a_track_that_took_a_plot_in_this_look_is_not_due_and_stays():
    tracks = tracks_of(3, 1)
    plots = plots_of(PERIOD_S, tracks, np.random.default_rng([83]))
    before = [column.copy() for column in tracks]
    hit = np.array([PERIOD_S - 0.1, -np.inf, PERIOD_S - 0.1])
    pairs = kernels.tracks.polar_update.predict_to_plots(tracks, plots, hit, 0.5 * PERIOD_S, SITE, GATE, RULES)
    assert set(pairs.track.tolist()) == {1}
    for column, old in zip(tracks, before, strict=True):
        assert np.array_equal(column[[0, 2]], old[[0, 2]])


def test_zero_padding_pulls_turns_straight():
    rates = []
    for pads_zeros in (False, True):
        tracks = tracks_of(1, 5)
        tracks[1][:, 1, 4] = 0.02
        for k in range(1, 6):
            kernels.filters.unscented.predict_tracks(
                tracks, np.arange(1), np.full(1, 5.0 * k), RULES._replace(pads_zeros=pads_zeros)
            )
        rates.append(float(tracks[1][0, 1, 4]))
    assert rates[0] == pytest.approx(0.02, rel=1e-9)
    assert rates[1] < 0.9 * rates[0]


def test_a_negative_speed_is_turned_round():
    mean, covariance = np.array([0.0, 0.0, 3.0, -2.0]), np.diag([1.0, 1.0, 0.1, 0.2])
    covariance[0, 3] = covariance[3, 0] = 0.3
    kernels.filters.unscented.turn_round(mean, covariance, 4)
    assert mean[3] == 2.0
    assert mean[2] == pytest.approx(3.0 - np.pi)
    assert covariance[0, 3] == covariance[3, 0] == -0.3


def test_the_cartesian_moments_are_those_of_many_draws():
    tracks, rng = tracks_of(2, 3), np.random.default_rng([84])
    mean, covariance = kernels.filters.unscented.cartesian(tracks, 0.0, RULES)
    for n in range(2):
        model = rng.random(200_000) < tracks[3][n, 1]
        drawn = np.empty((len(model), 4))
        for m in (0, 1):
            rows = model == bool(m)
            x = rng.multivariate_normal(tracks[1][n, m, :4], tracks[2][n, m, :4, :4], rows.sum())
            drawn[rows] = np.column_stack([x[:, :2], x[:, 3] * np.sin(x[:, 2]), x[:, 3] * np.cos(x[:, 2])])
        np.testing.assert_allclose(mean[n], drawn.mean(axis=0), atol=0.05)
        np.testing.assert_allclose(covariance[n], np.cov(drawn.T), rtol=0.05, atol=0.3)
