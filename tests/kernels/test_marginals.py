"""Association probabilities of sparse pairs against the enumeration of all joint assignments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from marginals_textbook import by_enumeration, by_sum_product

from coastwatch.kernels.association.marginals import marginals, plots_of_tracks, sum_product

pytestmark = pytest.mark.oracle

EXACT = 10
ROUNDING = 1e-12
SETTLED = 1e-7  # sum-product stops when no message changes by 1e-9


def random_weights(tracks: int, plots: int, seed: int):
    """Weights from 1e-4 to 1e6, some pairs outside the gate."""
    rng = np.random.default_rng([seed, 61])
    inside = rng.random((tracks, plots)) < rng.uniform(0.2, 1.0)
    return 10.0 ** rng.uniform(-4.0, 6.0, (tracks, plots)) * inside


def of_pairs(weight, exact=EXACT, order=None):
    """The kernel, on the pairs of a dense matrix in this order, as a dense matrix."""
    track, plot = np.nonzero(weight)
    order = np.arange(len(track)) if order is None else order(len(track))
    track, plot = track[order], plot[order]
    out = np.zeros_like(weight)
    out[track, plot] = marginals(plot, track, weight[track, plot], *weight.shape[::-1], exact)
    return out


@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 10**9))
def test_exact_as_enumeration(tracks, plots, seed):
    weight = random_weights(tracks, plots, seed)
    np.testing.assert_allclose(of_pairs(weight), by_enumeration(weight), rtol=0.0, atol=ROUNDING)


@given(st.integers(1, 6), st.integers(0, 10**9), st.booleans())
def test_one_track_or_one_plot_needs_no_loop(count, seed, one_plot):
    weight = random_weights(1, count, seed)
    weight = weight.T if one_plot else weight
    want = by_enumeration(weight)
    np.testing.assert_allclose(of_pairs(weight, exact=0), want, rtol=0.0, atol=ROUNDING)
    track, plot = np.nonzero(weight)
    got = sum_product(track, plot, weight[track, plot], *weight.shape)
    np.testing.assert_allclose(got, want[track, plot], rtol=0.0, atol=ROUNDING)


@given(st.integers(2, 5), st.integers(2, 5), st.integers(0, 10**9))
def test_sum_product_as_dense_matrices_say(tracks, plots, seed):
    weight = np.minimum(random_weights(tracks, plots, seed), 100.0)  # larger ones take the oracle too long to settle
    np.testing.assert_allclose(of_pairs(weight, exact=0), by_sum_product(weight), rtol=0.0, atol=SETTLED)


def test_two_clusters_do_not_touch_each_other():
    one, other = random_weights(3, 4, 1), random_weights(4, 2, 2)
    both = np.zeros((7, 6))
    both[:3, :4], both[3:, 4:] = one, other
    got = of_pairs(both)
    assert np.array_equal(got[:3, :4], of_pairs(one))
    assert np.array_equal(got[3:, 4:], of_pairs(other))


@given(st.integers(0, 10**9))
def test_the_order_of_pairs_is_of_no_matter(seed):
    weight = random_weights(5, 4, seed)
    shuffled = of_pairs(weight, order=np.random.default_rng([seed, 62]).permutation)
    np.testing.assert_allclose(shuffled, of_pairs(weight), rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("exact", [0, EXACT])
def test_two_certain_tracks_share_one_plot(exact):
    """Weights as of an identity that both tracks claim: half each, without overflow or lost digits."""
    weight = np.array([[1e13, 0.0, 0.0], [1e13, 1e-3, 0.0], [0.0, 1e-3, 1e13]])
    got = of_pairs(weight, exact)
    assert got[2, 2] == pytest.approx(1.0)
    assert got[:, 0].sum() == pytest.approx(1.0, abs=1e-3)
    assert got[0, 0] == pytest.approx(0.5, abs=1e-3)


def test_many_rows_over_few_columns_stay_finite():
    """Three hundred tracks that all claim three plots."""
    got = of_pairs(np.full((300, 3), 1e12))
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, 1.0 / 300.0, rtol=1e-9)


@given(st.integers(0, 10**6))
def test_a_large_cluster_is_one_to_one(seed):
    weight = random_weights(40, 40, seed)
    got = of_pairs(weight)
    assert (got >= 0.0).all()
    assert (got.sum(axis=1) <= 1.0 + ROUNDING).all()
    assert got.sum(axis=0).max() < 1.05  # sum-product is exact to a few per cent


def test_no_pair():
    none = np.zeros(0, np.int64)
    assert len(marginals(none, none, np.zeros(0), 3, 2, EXACT)) == 0


def test_who_took_which_plot():
    plot, track, share = np.array([0, 0, 1, 2, 2, 3]), np.array([0, 1, 1, 0, 3, 3]), np.array([0.9, 0.1, 0.4, 0.05, 0.3, 0.3])
    by, hit, best = plots_of_tracks(plot, track, share, 5, 5, 0.5)
    assert by.tolist() == [0, -1, -1, -1, -1]
    assert hit.tolist() == [0, 3]  # track 3 took one of two
    assert best.tolist() == [0, 1, -1, 3, -1]  # of two alike the last
