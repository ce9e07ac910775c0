"""Sparse one-to-one assignment against scipy's dense one, and that the order of pairs is of no matter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from coastwatch.kernels.association.assignment import assign

ROUNDING = 1e-9  # sums of a few gains of order 1


def pairs(seed: int, integer: bool):
    """Random pairs, each once, of up to 12 by 12 labels; integer gains make many ties."""
    rng = np.random.default_rng([seed, 3])
    rows, columns = rng.integers(1, 13, 2)
    there = rng.random((rows, columns)) < rng.random()
    first, second = np.nonzero(there)
    gain = rng.integers(-2, 4, len(first)).astype(float) if integer else rng.normal(0.5, 1.0, len(first))
    return rng.permutation(1000)[:rows][first] - 500, rng.permutation(1000)[:columns][second] + 10**12, gain


@given(st.integers(0, 10**9), st.booleans())
def test_as_good_as_dense_and_one_to_one(seed, integer):
    first, second, gain = pairs(seed, integer)
    taken = assign(first, second, gain)
    assert len(np.unique(first[taken])) == taken.sum()
    assert len(np.unique(second[taken])) == taken.sum()
    assert (gain[taken] > 0.0).all()
    firsts, i = np.unique(first, return_inverse=True)
    seconds, j = np.unique(second, return_inverse=True)
    dense = np.zeros((len(firsts), len(seconds)))
    dense[i, j] = np.maximum(gain, 0.0)
    best = dense[linear_sum_assignment(dense, maximize=True)].sum()
    assert gain[taken].sum() == pytest.approx(best, abs=ROUNDING)


@given(st.integers(0, 10**9), st.booleans())
def test_order_of_pairs_is_of_no_matter(seed, integer):
    first, second, gain = pairs(seed, integer)
    taken = assign(first, second, gain)
    order = np.random.default_rng([seed, 4]).permutation(len(first))
    assert np.array_equal(assign(first[order], second[order], gain[order]), taken[order])


@given(st.integers(0, 10**9), st.booleans())
def test_components_do_not_see_each_other(seed, integer):
    one, other = pairs(seed, integer), pairs(seed + 1, integer)
    both = assign(
        np.concatenate([one[0], other[0] + 10**6]),
        np.concatenate([one[1], other[1] + 10**6]),
        np.concatenate([one[2], other[2]]),
    )
    assert np.array_equal(both, np.concatenate([assign(*one), assign(*other)]))


def test_no_pair_and_no_gain():
    none = np.zeros(0, np.int64)
    assert assign(none, none, np.zeros(0)).shape == (0,)
    assert assign(np.array([1, 2]), np.array([1, 2]), np.array([0.0, np.nan])).tolist() == [False, False]


def test_two_small_gains_beat_one_large():
    first, second = np.array([0, 0, 1]), np.array([0, 1, 0])
    assert assign(first, second, np.array([3.0, 2.0, 2.0])).tolist() == [False, True, True]


def test_equal_gains_go_to_the_lowest_labels():
    first, second = np.array([5, 4, 5, 4]), np.array([8, 8, 9, 9])
    assert assign(first, second, np.ones(4)).tolist() == [False, True, True, False]
