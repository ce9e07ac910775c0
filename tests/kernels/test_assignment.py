"""Sparse one-to-one assignment against scipy's dense one, and that the order of pairs is of no matter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import linear_sum_assignment

from coastwatch.kernels.association.assignment import LARGEST, assign

pytestmark = pytest.mark.oracle

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


@pytest.mark.parametrize(
    "gain", [[np.inf, np.inf, 1.0, 1.0], [1e308, 1.0, 1.0, 1e308], [np.inf, 1.0, 1.0, np.inf], [np.inf, np.inf, np.inf, np.inf]]
)
def test_infinite_and_huge_gains_are_as_any_other_great_gain(gain):
    taken = assign(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), np.array(gain))
    assert taken.tolist() in ([True, False, False, True], [False, True, True, False])
    wanted = assign(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), np.minimum(gain, 1e9))
    assert taken.tolist() == wanted.tolist()


def test_rows_of_infinite_gains_do_not_leave_the_arrays():
    first, second = np.divmod(np.arange(900), 30)
    gain = np.random.default_rng([5, 0]).uniform(1.0, 9.0, 900)
    gain[first < 3] = np.inf
    assert assign(first, second, gain).sum() == 30


@given(st.integers(0, 10**6), st.booleans(), st.sampled_from([LARGEST - 1, LARGEST + 1, 2 * LARGEST]))
@settings(max_examples=12)
def test_the_largest_components_are_taken_greedily_and_others_exactly(seed, integer, n):
    rng = np.random.default_rng([seed, 5])
    first = np.concatenate([np.arange(n), np.arange(n)])  # a ring: one component
    second = np.concatenate([np.arange(n), (np.arange(n) + 1) % n]) + 7
    gain = rng.integers(1, 4, 2 * n).astype(float) if integer else rng.uniform(0.1, 1.0, 2 * n)
    order = rng.permutation(2 * n)
    first, second, gain = first[order], second[order], gain[order]
    taken = assign(first, second, gain)
    if n <= LARGEST:
        best = max(gain[first + 7 == second].sum(), gain[first + 7 != second].sum())
        assert gain[taken].sum() >= best - ROUNDING
        return
    rows, columns, wanted = set(), set(), np.zeros(2 * n, np.bool_)
    for a in np.lexsort((second, first, -gain)):
        if first[a] not in rows and second[a] not in columns:
            rows.add(first[a])
            columns.add(second[a])
            wanted[a] = True
    assert np.array_equal(taken, wanted)
