"""Rows of multi-hypothesis trees: where they stand among spare rows, and which trees share plots, beside plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.kernels.tracks.hypothesis_trees import drop_similar
from coastwatch.kernels.tracks.tree_rows import RECENT, linked_trees, rows_of, tree_rows
from coastwatch.tracks.radar.leaves import Leaves

SLOTS = 40


def leaves_of(slot, plot, mmsi) -> Leaves:
    """Leaves of these trees whose filters are of no matter."""
    rows = Leaves.empty(W=plot.shape[1], R=1, J=1, L=len(slot))
    for name in rows.__dataclass_fields__:
        getattr(rows, name)[:] = 0
    rows.slot[:], rows.plot[:], rows.mmsi[:] = slot, plot, mmsi
    return rows


def random_leaves(seed: int) -> Leaves:
    """Trees of one to three leaves in any order of slots, with spare rows between them."""
    rng = np.random.default_rng(seed)
    slots = rng.permutation(SLOTS)[:30]
    slot = np.repeat(np.column_stack([slots, np.full(30, -1)]).ravel(), rng.integers(1, 4, 60))
    plot = rng.integers(-3, 60, (len(slot), 3)).clip(-1)
    plot[plot >= 30] += RECENT  # the others are looked up in a hash table
    return leaves_of(slot, plot, rng.integers(-40, 12, len(slot)).clip(-1))


def sharing(leaves: Leaves, heard: list[tuple[int, int]], looked: set[int]) -> set[int]:
    """The slots reached from those that were looked at by plots and MMSI, one step after the other."""
    things: dict[int, set[object]] = {}
    for row, n in enumerate(leaves.slot.tolist()):
        if n >= 0:
            held = {("plot", p) for p in leaves.plot[row].tolist() if p >= 0}
            things.setdefault(n, set()).update(held | {("mmsi", m) for m in [int(leaves.mmsi[row])] if m >= 0})
    trees = set(things)
    for n, name in heard:
        things.setdefault(n, set()).add(("mmsi", name))
    reached = set(looked)
    while more := {n for n in things if n not in reached and any(things[n] & things.get(m, set()) for m in reached)}:
        reached |= more
    return reached & trees


@pytest.mark.parametrize("seed", range(20))
def test_trees_linked_to_those_looked_at_are_found(seed):
    leaves, rng = random_leaves(seed), np.random.default_rng(100 + seed)
    looked = np.zeros(SLOTS, np.bool_)
    looked[rng.permutation(SLOTS)[:3]] = True
    name = rng.integers(0, 12, 2)
    trees = tree_rows(leaves.slot, leaves.step, SLOTS)
    found = set(np.flatnonzero(linked_trees(leaves.columns, trees, name, looked)).tolist())
    heard = [(int(np.flatnonzero(looked)[0]), mmsi) for mmsi in name.tolist()]
    assert found == sharing(leaves, heard, set(np.flatnonzero(looked).tolist()))


def test_rows_of_slots_stand_together_without_spare_ones():
    leaves = random_leaves(3)
    trees = tree_rows(leaves.slot, leaves.step, SLOTS)
    slots = np.unique(leaves.slot[leaves.slot >= 0])
    assert np.array_equal(leaves.slot[rows_of(trees, slots)], np.sort(leaves.slot[leaves.slot >= 0]))
    assert trees.rows == np.flatnonzero(leaves.slot >= 0).max() + 1


@pytest.mark.parametrize(
    ("cost", "off_m", "wanted", "stays"),
    [
        pytest.param(3.0, 5.0, None, False, id="alike and nobody wants its plot"),
        pytest.param(0.5, 5.0, None, True, id="nearly as cheap"),
        pytest.param(3.0, 50.0, None, True, id="elsewhere"),
        pytest.param(3.0, 5.0, 4.0, True, id="another tree would pay more for the plot"),
        pytest.param(3.0, 5.0, -9.0, False, id="another tree has the plot only at a loss"),
    ],
)
def test_a_leaf_without_a_plot_goes_where_a_cheaper_one_says_the_same(cost, off_m, wanted, stays):
    """The first tree has plot 7 or none. The second one has it too, and gains so much by it."""
    leaves = leaves_of(np.array([0, 0, 1, 1]), np.array([[5, 7], [5, -1], [6, -1], [8, -1]]), np.full(4, -1))
    leaves.cost[:] = 0.0, cost, 0.0, 20.0
    if wanted is not None:
        leaves.plot[3, 1] = 7
        leaves.cost[3] = -wanted
    leaves.combined_covariance[:] = np.diag([100.0, 100.0, 1.0, 1.0])
    leaves.combined_mean[1, 0] = off_m
    keep = np.ones(4, np.bool_)
    start, null = np.array([0, 2, 4]), np.full(2, 30.0)
    drop_similar(start, leaves.columns, np.arange(4), leaves.plot, 9, null, np.ones(2, np.bool_), keep)
    assert keep.tolist() == [True, stays, True, True]


def test_leaves_of_a_tentative_tree_all_stay():
    leaves, keep = leaves_of(np.array([0, 0]), np.array([[5, 7], [5, -1]]), np.full(2, -1)), np.ones(2, np.bool_)
    leaves.cost[1] = 3.0
    leaves.combined_covariance[:] = np.eye(4)
    start, null = np.array([0, 2]), np.full(1, 30.0)
    drop_similar(start, leaves.columns, np.arange(2), leaves.plot, 9, null, np.zeros(1, np.bool_), keep)
    assert keep.all()
