"""The global hypothesis against an integer linear program, and what it promises of clusters too large to prove."""

from __future__ import annotations

import numpy as np
import pytest
from global_hypothesis_textbook import by_milp
from hypothesis import given, settings, strategies as st
from hypothesis_clusters import forest, meeting

from coastwatch.kernels.association.global_hypothesis import choose

pytestmark = pytest.mark.oracle

ROUNDING = 1e-6  # sums of a few costs of order 10; the solver and HiGHS stop at 1e-7
ROUNDS, NODES = 100, 2000


def cost_of(leaf, cost, null):
    return float(np.where(leaf >= 0, cost[leaf], null).sum())


def check_one_each(leaf, start, resource):
    taken = np.flatnonzero(leaf >= 0)
    assert ((leaf >= start[:-1]) & (leaf < start[1:]))[taken].all()
    used = resource[leaf[taken]]
    used = used[used >= 0]
    assert len(np.unique(used)) == len(used)


@settings(max_examples=20)
@given(st.integers(0, 10**9), st.integers(1, 6), st.booleans(), st.booleans())
def test_as_cheap_as_the_program(seed, trees, integer, may_be_null):
    start, cost, resource = forest(seed, trees, 12, 6, integer)
    null = np.random.default_rng([seed, 18]).normal(-3.0, 3.0, trees) if may_be_null else np.full(trees, np.inf)
    best = by_milp(start, cost, resource, 6, null)
    choice = choose(start, cost, resource, 6, null, ROUNDS, NODES)
    if np.isinf(best):
        assert np.isinf(choice.excess).any()
        return
    assert (choice.excess == 0.0).all()
    check_one_each(choice.leaf, start, resource)
    assert cost_of(choice.leaf, cost, null) == pytest.approx(best, abs=ROUNDING)


@settings(max_examples=30)
@given(st.integers(0, 10**9))
def test_unproven_choices_are_between_their_bounds(seed):
    start, cost, resource = forest(seed, 6, 12, 6)
    null = np.zeros(6)
    best = by_milp(start, cost, resource, 6, null)
    choice = choose(start, cost, resource, 6, null, 3, 2)
    check_one_each(choice.leaf, start, resource)
    above = cost_of(choice.leaf, cost, null) - best
    assert -ROUNDING <= above <= choice.excess.sum() + ROUNDING


def test_example_of_the_thesis():
    """Figure 4.9 at time step 2, as the matrices (4.25) have it: columns are leaves, the first four of one tree."""
    of_measurements = np.array(
        [[0, 1, 1, 0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 1, 0, 1, 0], [0, 0, 0, 1, 0, 0, 1, 1, 1], [0] * 8 + [1]]
    )
    resource = np.full((9, 2), -1)
    for leaf, column in enumerate(of_measurements.T):
        resource[leaf, : column.sum()] = np.flatnonzero(column)
    start, null = np.array([0, 4, 9]), np.full(2, np.inf)
    cost = np.array([4.0, 1.0, -6.0, -1.0, 5.0, -1.0, -2.0, -7.0, -4.0])
    choice = choose(start, cost, resource, 4, null, ROUNDS, NODES)
    assert choice.leaf.tolist() == [2, 8]  # leaves 3 and 9: the cheapest two, 3 and 8, share a measurement
    assert choice.excess.tolist() == [0.0]


def test_ties_go_to_the_lower_row():
    start, resource = np.array([0, 2, 4]), np.array([[0], [1], [0], [1]])
    assert choose(start, np.zeros(4), resource, 2, np.full(2, np.inf), ROUNDS, NODES).leaf.tolist() == [0, 3]
    assert choose(start, np.zeros(4), np.full((4, 1), -1), 0, np.zeros(2), ROUNDS, NODES).leaf.tolist() == [0, 2]


def test_finds_a_choice_where_the_greedy_one_fails():
    start, resource = np.array([0, 2, 3]), np.array([[0], [1], [0]])
    choice = choose(start, np.array([-9.0, 0.0, -1.0]), resource, 2, np.full(2, np.inf), ROUNDS, NODES)
    assert choice.leaf.tolist() == [1, 2]


def test_trees_that_cannot_all_have_a_leaf():
    start, resource, cost = np.array([0, 1, 2]), np.zeros((2, 1), np.int64), np.array([-1.0, -2.0])
    impossible = choose(start, cost, resource, 1, np.full(2, np.inf), ROUNDS, NODES)
    assert impossible.leaf.tolist() == [-1, -1]
    assert impossible.excess.tolist() == [np.inf]
    with_null = choose(start, cost, resource, 1, np.zeros(2), ROUNDS, NODES)
    assert with_null.leaf.tolist() == [-1, 1]


def test_no_tree_and_a_tree_without_leaf():
    none = np.zeros(0, np.int64)
    assert len(choose(np.zeros(1, np.int64), np.zeros(0), none.reshape(0, 2), 0, np.zeros(0), ROUNDS, NODES).leaf) == 0
    alone = choose(np.array([0, 0, 1]), np.zeros(1), np.full((1, 2), -1), 0, np.array([1.0, np.inf]), ROUNDS, NODES)
    assert alone.leaf.tolist() == [-1, 0]


def test_clusters_do_not_see_each_other():
    one, other = forest(1, 5, 9, 6), forest(2, 6, 9, 6)
    start = np.concatenate([one[0], one[0][-1] + other[0][1:]])
    resource = np.concatenate([one[2], np.where(other[2] >= 0, other[2] + 6, -1)])
    both = choose(start, np.concatenate([one[1], other[1]]), resource, 12, np.zeros(11), ROUNDS, NODES)
    apart = [choose(*given, 6, np.zeros(len(given[0]) - 1), ROUNDS, NODES).leaf for given in (one, other)]
    shifted = np.where(apart[1] >= 0, apart[1] + one[0][-1], -1)
    assert np.array_equal(both.leaf, np.concatenate([apart[0], shifted]))


@pytest.mark.parametrize("seed", range(20))
def test_prices_bound_the_cost_from_below(seed):
    """Weak duality: the cheapest leaf of each tree with prices, less the price of every resource, costs no more than the choice."""
    start, cost, resource = forest(seed, 6, 9, 5)
    null = np.zeros(6)
    found = choose(start, cost, resource, 5, null, ROUNDS, NODES)
    priced = cost + np.append(found.price, 0.0)[resource].sum(axis=1)
    bound = np.minimum(np.minimum.reduceat(priced, start[:-1]), null).sum() - found.price.sum()
    without_prices = np.minimum(np.minimum.reduceat(cost, start[:-1]), null).sum()
    assert (found.price >= 0.0).all()
    assert without_prices - 1e-9 <= bound <= cost_of(found.leaf, cost, null) + 1e-9


def test_a_resource_that_two_trees_want_has_the_price_of_the_one_that_loses_it():
    start, cost, resource = np.array([0, 2, 4]), np.array([-9.0, -4.0, -9.0, -7.0]), np.array([[0], [-1], [0], [-1]])
    found = choose(start, cost, resource, 1, np.zeros(2), ROUNDS, NODES)
    assert found.leaf.tolist() == [0, 3]
    assert 2.0 - 1e-6 <= found.price[0] <= 5.0 + 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_large_clusters_are_close_to_the_program(seed):
    """As 44 to 50 vessels that meet: each tree has 20 leaves with plots of three looks."""
    trees = 44 + 3 * seed
    start, cost, resource = meeting(seed, trees)
    null = np.zeros(trees)
    best = by_milp(start, cost, resource, 3 * trees, null)
    choice = choose(start, cost, resource, 3 * trees, null, ROUNDS, NODES)
    check_one_each(choice.leaf, start, resource)
    above = cost_of(choice.leaf, cost, null) - best
    assert -ROUNDING <= above <= choice.excess.sum() + ROUNDING
    assert above < 20.0  # what is asked of a cost of some -600, in which a plot is worth 6
