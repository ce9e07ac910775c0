"""The global hypothesis: one leaf of each tree, so that no resource is used twice and the costs sum to the least. Compiled by numba.

A tree is a vessel, a leaf one way to give measurements to it, a resource a measurement or an identity. Trees that share a resource form a
cluster, and clusters are independent. If the cheapest leaves of a cluster share nothing, they are the answer. Else:
1. Each resource has a price (Lagrange multiplier), raised while several trees want it (subgradient ascent). The relaxed choice is a lower
   bound; giving the trees their leaves one after the other, by these prices, an upper bound.
2. Leaves whose reduced cost exceeds the gap between both go. The rest is searched by branch and bound, depth first, to a limit of nodes.
3. Where this limit was reached, exchanges lower the cost: a tree takes another leaf, and up to `DISPLACED` trees choose again.
The work is bounded by counts alone, so the answer is a function of the arrays. Of equal leaves the lower row is preferred.

Sources: A. B. Poore, N. Rijavec, A Lagrangian relaxation algorithm for multidimensional assignment problems arising from multitarget
tracking, SIAM J. Optimization 3(3), 1993; M. L. Fisher, The Lagrangian relaxation method for solving integer programming problems,
Management Science 27(1), 1981; E. Liland, AIS aided multi hypothesis tracker, NTNU 2017, (4.21) to (4.23).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.association.connected_components import components
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into
from coastwatch.kernels.tables.counting_sort import counting_sort

PROVEN = 1e-7  # difference of two bounds that are one
STALE, SHORTER = 4, 0.6  # after so many rounds without a better lower bound, the steps of prices are shorter by this factor
LEAST_STEP = 1e-3  # of the gap between the bounds: shorter steps find no better choice
FIRST_GAP = 10.0  # assumed until the first upper bound
DISPLACED = 3  # trees that choose again in an exchange
SWEEPS = 50  # of exchanges through all trees, at most


class Choice(NamedTuple):
    """The global hypothesis of T trees in C clusters."""

    leaf: Ints  # (T,) row of the leaf, -1: null
    cluster: Ints  # (T,)
    excess: Floats  # (C,) by which the cost of the cluster exceeds its lower bound: 0 where proven, infinite where no choice was found
    price: Floats  # (resources,) of the best lower bound found; 0 where the cheapest leaves of a cluster share nothing


class Cluster(NamedTuple):
    """The problem of one cluster: trees and resources are numbered from 0."""

    start: Ints  # (K + 1,) first leaf of each tree
    cost: Floats  # (L,)
    resource: Ints  # (L, m), -1: none
    row: Ints  # (L,) of the leaf among those of all clusters, -1: null
    resources: int


@jit
def choose(start, cost, resource, resources, null, rounds, nodes):  # type: ignore[no-untyped-def]
    """The leaf of each tree in the global hypothesis: Choice.

    Args: start: (T + 1,) first leaf of each tree; cost: (L,); resource: (L, m) of the leaves, below `resources`, -1: none, each once in a
    leaf; null: (T,) cost of no leaf at all, infinite where a tree must have one; rounds: of prices; nodes: of branch and bound, each of a
    cluster at most.
    """
    trees = len(start) - 1
    cluster = _clusters(start, resource, resources)
    clusters = cluster.max() + 1 if trees else 0
    leaf, contested = _cheapest(start, cost, resource, resources, null, cluster, clusters)
    excess, number, price = np.zeros(clusters), np.full(resources, -1), np.zeros(resources)
    first, by_cluster = counting_sort(cluster, clusters)
    for c in range(clusters):
        if contested[c]:
            members = by_cluster[first[c] : first[c + 1]]
            problem = _problem(members, start, cost, resource, null, number)
            pick, excess[c], of_problem = solve(problem, rounds, nodes)
            for k in range(len(members)):
                leaf[members[k]] = problem.row[pick[k]] if pick[k] >= 0 else -1
            _write_prices(problem, of_problem, resource, price)
    return Choice(leaf, cluster, excess, price)


@jit
def _write_prices(cluster, of_cluster, resource, price):  # type: ignore[no-untyped-def]
    """Write the prices of the resources of a cluster among those of all, price. Args: of_cluster: by the numbers of the cluster."""
    for i in range(len(cluster.row)):
        if cluster.row[i] < 0:
            continue
        for m in range(resource.shape[1]):
            r = cluster.resource[i, m]
            if r >= 0:
                price[resource[cluster.row[i], m]] = of_cluster[r]


@jit
def solve(cluster, rounds, nodes):  # type: ignore[no-untyped-def]
    """The leaf of each tree of one cluster (K,), -1 if no choice was found; the excess; the prices. Args: cluster: Cluster."""
    pick, price, upper, lower = _prices(cluster, rounds)
    if upper - lower < PROVEN:
        return pick, 0.0, price
    upper, proven = _branch_and_bound(cluster, price, upper, pick, nodes)
    if proven:
        return pick, 0.0 if upper < np.inf else np.inf, price
    if upper < np.inf:
        upper = _exchange(cluster, pick, upper)
    excess = upper - lower
    return pick, excess if excess > PROVEN else 0.0, price


@jit
def _clusters(start, resource, resources):  # type: ignore[no-untyped-def]
    """The cluster of each tree, (T,)."""
    trees = len(start) - 1
    first, second, count = np.empty(resource.size, np.int64), np.empty(resource.size, np.int64), 0
    for t in range(trees):
        for i in range(start[t], start[t + 1]):
            for r in resource[i]:
                if r >= 0:
                    first[count], second[count] = t, trees + r
                    count += 1
    return components(first[:count], second[:count], trees + resources)[:trees]


@jit
def _cheapest(start, cost, resource, resources, null, cluster, clusters):  # type: ignore[no-untyped-def]
    """The cheapest leaf of each tree, -1: null, and the clusters in which these share a resource, or a tree has no leaf."""
    leaf, contested, user = np.full(len(start) - 1, -1), np.zeros(clusters, np.bool_), np.full(resources, -1)
    for t in range(len(leaf)):
        least = null[t]
        for i in range(start[t], start[t + 1]):
            if cost[i] < least or (cost[i] == least and leaf[t] < 0):
                least, leaf[t] = cost[i], i
        if leaf[t] < 0:
            contested[cluster[t]] |= least == np.inf
            continue
        for r in resource[leaf[t]]:
            if r >= 0:
                contested[cluster[t]] |= user[r] >= 0
                user[r] = t
    return leaf, contested


@jit
def _problem(members, start, cost, resource, null, number):  # type: ignore[no-untyped-def]
    """The Cluster of these trees, null as a leaf without resources. Args: number: (resources,) all -1, and again after the call."""
    most, trees, resources = 0, len(members), 0
    for t in members:
        most += start[t + 1] - start[t] + 1
    begin, row = np.zeros(trees + 1, np.int64), np.full(most, -1)
    costs, needs = np.empty(most), np.full((most, resource.shape[1]), -1)
    at = 0
    for k in range(trees):
        t = members[k]
        for i in range(start[t], start[t + 1]):
            row[at], costs[at] = i, cost[i]
            for m in range(resource.shape[1]):
                r = resource[i, m]
                if r >= 0:
                    if number[r] < 0:
                        number[r] = resources
                        resources += 1
                    needs[at, m] = number[r]
            at += 1
        if null[t] < np.inf:
            costs[at] = null[t]
            at += 1
        begin[k + 1] = at
    for i in row[:at]:
        if i >= 0:
            for r in resource[i]:
                if r >= 0:
                    number[r] = -1
    return Cluster(begin, costs[:at], needs[:at], row[:at], resources)


@jit
def _reduce(cluster, price, reduced, low, pick):  # type: ignore[no-untyped-def]
    """The lower bound by these prices. Written: reduced: (L,) costs with prices, low: (K,) least of each tree, pick: (K,) its leaf."""
    bound = 0.0
    for r in range(cluster.resources):
        bound -= price[r]
    for k in range(len(low)):
        low[k], pick[k] = np.inf, -1
        for i in range(cluster.start[k], cluster.start[k + 1]):
            reduced[i] = cluster.cost[i]
            for r in cluster.resource[i]:
                if r >= 0:
                    reduced[i] += price[r]
            if reduced[i] < low[k]:
                low[k], pick[k] = reduced[i], i
        bound += low[k]
    return bound


@jit
def _mark(cluster, leaf, used, owner):  # type: ignore[no-untyped-def]
    """Write the owner of the resources of a leaf. Args: used: (resources,), -1: free."""
    for r in cluster.resource[leaf]:
        if r >= 0:
            used[r] = owner


@jit
def _is_free(cluster, leaf, used):  # type: ignore[no-untyped-def]
    """Whether nobody owns a resource of a leaf."""
    free = True
    for r in cluster.resource[leaf]:
        free &= r < 0 or used[r] < 0
    return free


@jit
def _cheapest_free(cluster, tree, value, used):  # type: ignore[no-untyped-def]
    """The leaf of a tree of least value (L,) whose resources are free, -1: none."""
    least, best = np.inf, -1
    for i in range(cluster.start[tree], cluster.start[tree + 1]):
        if value[i] < least and _is_free(cluster, i, used):
            least, best = value[i], i
    return best


@jit
def _repair(cluster, reduced, low, used, pick):  # type: ignore[no-untyped-def]
    """A choice, into pick: trees in the order of their least reduced costs, each its cheapest free leaf. Returns: its cost, or infinity."""
    used[:] = -1
    total = 0.0
    for k in np.argsort(low, kind="mergesort"):
        pick[k] = _cheapest_free(cluster, k, reduced, used)
        if pick[k] < 0:
            return np.inf
        _mark(cluster, pick[k], used, k)
        total += cluster.cost[pick[k]]
    return total


@jit
def _move_prices(cluster, pick, gap, price, wanted):  # type: ignore[no-untyped-def]
    """Raise the prices of resources that several leaves want, lower the others, in place. Returns: whether any price changed."""
    wanted[:] = 0.0
    for i in pick:
        for r in cluster.resource[i]:
            if r >= 0:
                wanted[r] += 1.0
    square = 0.0
    for r in range(cluster.resources):
        if wanted[r] > 1.0 or price[r] > 0.0:
            square += (wanted[r] - 1.0) ** 2
    if square > 0.0:
        for r in range(cluster.resources):
            price[r] = max(price[r] + gap * (wanted[r] - 1.0) / square, 0.0)
    return square > 0.0


@jit
def _prices(cluster, rounds):  # type: ignore[no-untyped-def]
    """The best choice by prices (K,), -1: none; the prices of the best lower bound; upper and lower bound."""
    trees = len(cluster.start) - 1
    best, best_price, upper, lower = np.full(trees, -1), np.zeros(cluster.resources), np.inf, -np.inf
    price, wanted, used = np.zeros(cluster.resources), np.empty(cluster.resources), np.empty(cluster.resources, np.int64)
    reduced, low, pick, repaired = np.empty(len(cluster.cost)), np.empty(trees), np.full(trees, -1), np.full(trees, -1)
    step, stale = 1.0, 0
    for _ in range(rounds):
        bound = _reduce(cluster, price, reduced, low, pick)
        if bound == np.inf:  # a tree without a leaf
            break
        if bound > lower + PROVEN:
            lower, stale = bound, 0
            copy_into(best_price, price)
        else:
            stale += 1
            if stale == STALE:
                step, stale = SHORTER * step, 0
                if step < LEAST_STEP:
                    break
        total = _repair(cluster, reduced, low, used, repaired)
        if total < upper:
            upper = total
            copy_into(best, repaired)
        gap = upper - bound if upper < np.inf else FIRST_GAP
        if upper - lower < PROVEN or not _move_prices(cluster, pick, step * gap, price, wanted):
            break
    return best, best_price, upper, lower


@jit
def _survivors(cluster, reduced, low, slack):  # type: ignore[no-untyped-def]
    """The leaves of which each costs less than this beyond the least of its tree: order of the trees, the fewest leaves first (K,);
    first leaf of each in this order (K + 1,); leaves, the cheapest first."""
    trees = len(low)
    left = np.zeros(trees, np.int64)
    for k in range(trees):
        for i in range(cluster.start[k], cluster.start[k + 1]):
            left[k] += reduced[i] - low[k] < slack
    order, first, leaves = np.argsort(left, kind="mergesort"), np.zeros(trees + 1, np.int64), np.empty(left.sum(), np.int64)
    at = 0
    for depth in range(trees):
        k = order[depth]
        for i in range(cluster.start[k], cluster.start[k + 1]):
            if reduced[i] - low[k] < slack:
                leaves[at] = i
                at += 1
        one = leaves[first[depth] : at]
        leaves[first[depth] : at] = one[np.argsort(reduced[one], kind="mergesort")]
        first[depth + 1] = at
    return order, first, leaves


@jit
def _next_leaf(cluster, leaves, at, end, reduced, room, used):  # type: ignore[no-untyped-def]
    """The place of the next free leaf from `at` on, `end` if there is none. Args: room: a leaf costs less."""
    for place in range(at, end):
        if reduced[leaves[place]] >= room:
            return end
        if _is_free(cluster, leaves[place], used):
            return place
    return end


@jit
def _branch_and_bound(cluster, price, upper, pick, nodes):  # type: ignore[no-untyped-def]
    """Better choices than `upper`, into pick. Returns: cost, and whether all were looked at within so many nodes."""
    trees = len(pick)
    reduced, low, held = np.empty(len(cluster.cost)), np.empty(trees), np.full(trees, -1)
    bound = _reduce(cluster, price, reduced, low, held)
    if bound == np.inf:
        return np.inf, True
    order, first, leaves = _survivors(cluster, reduced, low, upper - bound - PROVEN)
    rest, spent = np.zeros(trees + 1), np.zeros(trees + 1)  # least cost of the trees from here on, cost of those before
    for depth in range(trees - 1, -1, -1):
        rest[depth] = rest[depth + 1] + low[order[depth]]
    spent[0] = bound - rest[0]
    used, at, depth = np.full(cluster.resources, -1), first[:-1].copy(), 0
    held[:] = -1
    while depth >= 0 and nodes > 0:
        nodes -= 1
        if held[depth] >= 0:
            _mark(cluster, held[depth], used, -1)
            held[depth] = -1
        room, end = upper - PROVEN - spent[depth] - rest[depth + 1], first[depth + 1]
        place = _next_leaf(cluster, leaves, at[depth], end, reduced, room, used)
        if place == end:
            at[depth] = first[depth]
            depth -= 1
            continue
        held[depth], at[depth] = leaves[place], place + 1
        spent[depth + 1] = spent[depth] + reduced[held[depth]]
        _mark(cluster, held[depth], used, depth)
        if depth < trees - 1:
            depth += 1
        else:
            upper = _keep(cluster, order, held, upper, pick)
    return upper, depth < 0


@jit
def _keep(cluster, order, held, upper, pick):  # type: ignore[no-untyped-def]
    """The cost of a whole choice, which becomes pick if it is less than `upper`; else `upper`."""
    total = 0.0
    for i in held:
        total += cluster.cost[i]
    if total >= upper:
        return upper
    for depth in range(len(order)):
        pick[order[depth]] = held[depth]
    return total


@jit
def _displaced(cluster, tree, leaf, used, others):  # type: ignore[no-untyped-def]
    """How many other trees own a resource of a leaf, into others; more than `DISPLACED` are not all listed."""
    count = 0
    for r in cluster.resource[leaf]:
        if r < 0 or used[r] < 0 or used[r] == tree:
            continue
        known = False
        for k in range(count):
            known |= others[k] == used[r]
        if not known:
            if count == DISPLACED:
                return count + 1
            others[count] = used[r]
            count += 1
    return count


@jit
def _choose_again(cluster, others, count, before, chosen, used):  # type: ignore[no-untyped-def]
    """The change of cost if these trees, one after the other, take their cheapest free leaves, into chosen; infinite if one has none.

    Args: others, before, chosen: the first `count` are trees, their leaves so far and written; used: marked for what they take.
    """
    change = 0.0
    for k in range(count):
        chosen[k] = _cheapest_free(cluster, others[k], cluster.cost, used)
        if chosen[k] < 0:
            return np.inf
        change += cluster.cost[chosen[k]] - cluster.cost[before[k]]
        _mark(cluster, chosen[k], used, others[k])
    return change


@jit
def _try_leaf(cluster, tree, leaf, pick, least, used, work):  # type: ignore[no-untyped-def]
    """Let a tree take a leaf and others choose again, if this costs less. Returns: change of the cost, 0: nothing was changed.

    Args: least: (K,) cost of the cheapest leaf of each tree; work: (3, DISPLACED + 1).
    """
    others, before, chosen = work
    count = _displaced(cluster, tree, leaf, used, others)
    change = cluster.cost[leaf] - cluster.cost[pick[tree]]
    if count > DISPLACED:
        return 0.0
    possible = change
    for k in range(count):
        before[k], chosen[k] = pick[others[k]], -1
        possible += least[others[k]] - cluster.cost[before[k]]
    if possible >= -PROVEN:
        return 0.0
    others[count], before[count], chosen[count] = tree, pick[tree], leaf
    for k in range(count + 1):
        _mark(cluster, before[k], used, -1)
    _mark(cluster, leaf, used, tree)
    change += _choose_again(cluster, others, count, before, chosen, used)
    better = change < -PROVEN
    if not better:
        for k in range(count + 1):
            if chosen[k] >= 0:
                _mark(cluster, chosen[k], used, -1)
    for k in range(count + 1):
        pick[others[k]] = chosen[k] if better else before[k]
        _mark(cluster, pick[others[k]], used, others[k])
    return change if better else 0.0


@jit
def _exchange(cluster, pick, cost):  # type: ignore[no-untyped-def]
    """Lower the cost of a choice by exchanges until none helps, in place. Returns: its cost."""
    used, work, least = np.full(cluster.resources, -1), np.empty((3, DISPLACED + 1), np.int64), np.full(len(pick), np.inf)
    for k in range(len(pick)):
        _mark(cluster, pick[k], used, k)
        for i in range(cluster.start[k], cluster.start[k + 1]):
            least[k] = min(least[k], cluster.cost[i])
    for _ in range(SWEEPS):
        before = cost
        for k in range(len(pick)):
            for i in range(cluster.start[k], cluster.start[k + 1]):
                if i != pick[k]:
                    cost += _try_leaf(cluster, k, i, pick, least, used, work)
        if cost == before:
            break
    return cost
