"""The choice of one leaf a tree, and which leaves stay."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Unproven
from coastwatch.tracks.radar.leaves import Forest, Leaves
from coastwatch.tracks.radar.table import Status

WIDEST = 60.0  # of the cost of "no vessel"
LEAST_STEP = 1e-9  # of costs: the chosen leaf is the cheapest of its tree
MORE_LEAVES, WIDER_GAP = 4, 2.0  # times the leaves and the gap of those that stay: from so many leaves of a tree one is chosen
TAKEN = 1e6  # added to the cost of a leaf whose plot another tree has


class Pruning(NamedTuple):
    """How many leaves stay; the fields are settings of `MultiHypothesis`."""

    window: int
    leaves: int
    score_gap: float
    price_rounds: int
    search_nodes: int

    @property
    def candidates(self) -> tuple[int, float]:
        """How many leaves of a tree one is chosen from, and within which gap."""
        return MORE_LEAVES * self.leaves, WIDER_GAP * self.score_gap


class Pruned(NamedTuple):
    """The leaves of T trees that stay, the chosen one of each tree first."""

    leaves: Leaves  # (L,)
    slot: Ints  # (T,) of each tree
    start: Ints  # (T + 1,) first leaf
    share: Floats  # (L,) probability of each leaf
    existence: Floats  # (T,)
    unproven: Unproven  # clusters whose choice may not be the best one


def choose_and_prune(rules: Pruning, forest: Forest, leaves: Leaves, looked: Bools, status: Ints) -> Pruned:
    """Choose a leaf of each tree, and drop leaves that contradict what is final now, or cost too much.

    Of a tree that was looked at only the children of the oldest ancestor in the window of the chosen leaf stay. A plot that one tree has
    for good is taken from all others. Of the rest the cheapest stay, each plot at the price of the global choice: by their costs alone,
    ships close together would keep leaves that all share a plot, and nothing would be left to choose. Writes the costs of "no vessel" and
    the count of lost choices of the forest.
    Args: leaves: grown from those of the forest; looked: (S,) trees that were looked at; status: (S,).
    """
    trees, start = kernels.tracks.hypothesis_trees, starts(leaves.slot)
    kept = np.flatnonzero(trees.cheapest(start, leaves.cost, *rules.candidates))
    cost, plot, of_slot = leaves.cost[kept], leaves.plot[kept], leaves.slot[kept]
    start = starts(of_slot)
    slot = of_slot[start[:-1]]
    null, seen, of = forest.null_cost[slot], looked[slot], np.repeat(np.arange(len(slot)), np.diff(start))
    number, plots = _numbered(plot)
    chosen, has, priced, unproven = _chosen(rules, cost, (number, plots), leaves.mmsi[kept], start, null)
    displaced = ~has & (_least(cost, start) < null)
    forest.nulled[slot[seen]] = np.where(displaced, forest.nulled[slot] + 1, 0)[seen]
    final = plot[chosen, 0]
    keep = (plot[:, 0] == final[of]) | ~seen[of]
    decided = np.unique(final[seen & has & (final >= 0)])  # one that the choice calls no vessel has no plot
    if len(decided):
        keep &= ~np.isin(plot[:, 1:], decided).any(axis=1)
    keep[chosen] = True
    priced[chosen] = _least(np.where(keep, priced, np.inf), start) - LEAST_STEP
    first = np.append(0, np.cumsum(np.bincount(of[keep], minlength=len(slot))))
    keep[keep] = trees.cheapest(first, priced[keep], rules.leaves, rules.score_gap)
    if (confirmed := status[slot] == Status.CONFIRMED).any():
        trees.drop_similar(start, leaves.columns, kept, number, plots, null, confirmed, keep)
    rows, start = trees.pruned(start, keep, chosen)
    forest.null_cost[slot] = null = np.clip(null - cost[chosen], -WIDEST, WIDEST)
    leaves = leaves.take(kept[rows])
    leaves.cost[:] -= np.repeat(cost[chosen], np.diff(start))
    share, existence = trees.weigh(start, leaves.cost, leaves.existence, null)
    existence[ended(forest.nulled[slot], status[slot], rules.window)] = 0.0
    return Pruned(leaves, slot, start, share, existence, unproven)


def ended(nulled: Ints, status: Ints, window: int) -> Bools:
    """Which trees end because others have their plots: a tentative one at once, a confirmed one after a window of looks."""
    out: Bools = (nulled >= window) | ((nulled > 0) & (status != Status.CONFIRMED))
    return out


def starts(slot: Ints) -> Ints:
    """First leaf of each tree, and the end. (T + 1,) Args: slot: (L,) of each leaf."""
    return np.append(np.flatnonzero(np.diff(slot, prepend=-1)), len(slot))


def _least(cost: Floats, start: Ints) -> Floats:
    """The least cost of each tree. (T,) Args: cost: (L,); start: (T + 1,)."""
    return np.asarray(np.minimum.reduceat(cost, start[:-1])) if len(cost) else cost


def _numbered(plot: Ints) -> tuple[Ints, int]:
    """Plots by numbers from 0 on, in their order, and how many there are: a window may reach far back. Args: (L, W), -1: none."""
    held = plot >= 0
    numbers, number = np.unique(plot[held], return_inverse=True)
    out = np.full(plot.shape, -1)
    out[held] = number
    return out, len(numbers)


def _chosen(
    rules: Pruning, cost: Floats, plots: tuple[Ints, int], mmsi: Ints, start: Ints, null: Floats
) -> tuple[Ints, Bools, Floats, Unproven]:
    """The global hypothesis: the leaf of each tree (T,), which trees have one there, the costs of leaves with prices (L,), and unproven
    choices.

    A tree without a leaf there has its cheapest one whose newest plot no other tree has.

    Args: cost: (L,), mmsi: (L,), all of the leaves; plots: as of `_numbered`.
    """
    resource, count = plots
    choose = kernels.association.global_hypothesis.choose
    named = mmsi >= 0
    if named.any():  # two vessels do not have one MMSI
        names, number = np.unique(mmsi[named], return_inverse=True)
        of_names = np.full(len(mmsi), -1)
        of_names[named] = count + number
        resource, count = np.column_stack([of_names, resource]), count + len(names)
    choice = choose(start, cost, resource, count, null, rules.price_rounds, rules.search_nodes)
    has = choice.leaf >= 0
    taken = np.zeros(count + 1, np.bool_)
    taken[resource[choice.leaf[has], -1]] = True
    taken[-1] = False  # of leaves without a plot
    cheapest = kernels.tracks.hypothesis_trees.cheapest
    free = np.flatnonzero(cheapest(start, cost + np.where(taken[resource[:, -1]], TAKEN, 0.0), 1, 0.0))
    price = np.append(choice.price, 0.0)[resource].sum(axis=1)  # the last: of no plot
    return np.where(has, choice.leaf, free), has, cost + price, Unproven.of(choice.excess)
