"""Leaves of multi-hypothesis tracks: growth by the plots of a look, looks without a plot, weights and pruning. Compiled by numba.

A leaf is one way to give plots to a track; its cost is the negative logarithm of its likelihood ratio against "no vessel". The rows of
a slot of the table stand together: they are the tree of its track, the chosen leaf first.
Sources: T. Kurien, Issues in the design of practical multitarget tracking algorithms, in Multitarget-Multisensor Tracking, 1990 (trees);
D. Musicki, R. Evans, M. Stankovic, Integrated probabilistic data association, IEEE Trans. AC 39(6), 1994 (existence).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Bools, Floats, Ints
from coastwatch.kernels.filters import imm
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.smoothing import Steps
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into
from coastwatch.kernels.tracks.existence import SURELY, after, missed

TWO_PI = 2.0 * math.pi
FAINT = 1e-250  # of a likelihood
ROUNDING = 1e-6  # of costs that are summed in another order
LEAST_MISS_COST = 6.0  # cost of a miss above that of its only plot, from which it may be left out
SIMILAR = 4.0  # squared Mahalanobis distance of similar positions, and of similar velocities: two standard deviations
LEAST_DIFFERENCE = 1.0  # of costs of leaves, one of which is left out as similar
LATER_GAIN = 3.0  # by which the gain of a tree from a plot may rise in later looks
LEAST = 1e-12  # of the probability that a vessel gives a plot


class LeafColumns(NamedTuple):
    """Leaves: L rows, windows of W plots, R radars, J models."""

    slot: Ints  # (L,)
    cost: Floats  # (L,)
    existence: Floats  # (L,) given this leaf
    visibility: Floats  # (L,)
    existence_time: Floats  # (L,) of both
    misses: Floats  # (L,) looks without a plot since the newest one
    mmsi: Ints  # (L,) of the vessel, -1: none is known
    plot: Ints  # (L, W) number of the plot or message of each look of the window, newest last, -1: none
    step: Ints  # (L, W) row of the step of the filter by it, -1: none
    radar_time: Floats  # (L, R) newest plot of each radar, -inf: none
    state: Floats  # (L, J, 5)
    covariance: Floats  # (L, J, 5, 5)
    mode: Floats  # (L, J)
    time: Floats  # (L,) of the newest plot
    mean: Floats  # (L, 4)
    spread: Floats  # (L, 4, 4)
    noise: Floats  # (L,)


class Look(NamedTuple):
    """One look of a radar at trees. S slots, M plots."""

    radar: int
    period: float
    detection: float  # probability of a plot of a visible vessel
    time: Floats  # (S,) of the look, -inf: no plot is in a gate of the tree
    before: Floats  # (S,) up to which the looks of this radar are in the tree
    nobody: Floats  # (M,) density of plots of none of these tracks
    lone: Bools  # (M,) plots in the gates of one confirmed track alone
    number: int  # of the first of these plots
    step: int  # row of the first new step


@jit
def _empty(leaves, count):  # type: ignore[no-untyped-def]
    """Room for so many leaves like these."""
    window, radars, models = leaves.plot.shape[1], leaves.radar_time.shape[1], leaves.mode.shape[1]
    return LeafColumns(
        np.empty(count, np.int64),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count, np.int64),
        np.empty((count, window), np.int64),
        np.empty((count, window), np.int64),
        np.empty((count, radars)),
        np.empty((count, models, 5)),
        np.empty((count, models, 5, 5)),
        np.empty((count, models)),
        np.empty(count),
        np.empty((count, 4)),
        np.empty((count, 4, 4)),
        np.empty(count),
    )


@jit
def _copy(leaves, i, out, k):  # type: ignore[no-untyped-def]
    """Leaf k of out becomes leaf i."""
    out.slot[k], out.cost[k], out.misses[k], out.time[k] = leaves.slot[i], leaves.cost[i], leaves.misses[i], leaves.time[i]
    out.existence[k], out.visibility[k] = leaves.existence[i], leaves.visibility[i]
    out.existence_time[k], out.noise[k], out.mmsi[k] = leaves.existence_time[i], leaves.noise[i], leaves.mmsi[i]
    copy_into(out.plot[k], leaves.plot[i])
    copy_into(out.step[k], leaves.step[i])
    copy_into(out.radar_time[k], leaves.radar_time[i])
    copy_into(out.mode[k], leaves.mode[i])
    copy_into(out.state[k], leaves.state[i])
    copy_into(out.covariance[k], leaves.covariance[i])
    copy_into(out.mean[k], leaves.mean[i])
    copy_into(out.spread[k], leaves.spread[i])


@jit
def _fade(leaves, k, time, chain):  # type: ignore[no-untyped-def]
    """Predict existence and visibility of leaf k to a time, in place."""
    dt = time - leaves.existence_time[k]
    leaves.existence[k], leaves.visibility[k] = after(leaves.existence[k], leaves.visibility[k], dt, chain)
    leaves.existence_time[k] = max(leaves.existence_time[k], time)


@jit
def _miss(leaves, k, detection):  # type: ignore[no-untyped-def]
    """Leaf k after a look that gave it no plot, in place."""
    leaves.existence[k], leaves.visibility[k], nothing = missed(leaves.existence[k], leaves.visibility[k], detection)
    leaves.cost[k] -= math.log(nothing)
    leaves.misses[k] += 1


@jit
def _take(leaves, k, m, look, columns, motion, work, step):  # type: ignore[no-untyped-def]
    """Leaf k takes plot m, in place.

    Args: motion: renewal, models; work: `imm.Workspace`, z (2,), noise (2, 2); step: Steps and the row of them that is written.
    """
    inside, z, noise = work
    renewal, models = motion
    steps, a = step
    estimates = Estimates(leaves.time, leaves.mean, leaves.spread, leaves.noise)
    found = max(leaves.existence[k] * leaves.visibility[k] * look.detection, LEAST)
    copy_into(z, columns.position[m])
    copy_into(noise, columns.covariance[m])
    state, covariance, mode, dt = leaves.state[k], leaves.covariance[k], leaves.mode[k], columns.time[m] - leaves.time[k]
    if dt > 0.0:
        copy_into(inside.mean, leaves.mean[k])
        copy_into(inside.spread, leaves.spread[k])
        imm.predict_from_moments(state, covariance, mode, models, dt, renewal, inside)
        leaves.time[k] = columns.time[m]
        imm.combine(state, covariance, mode, models, k, estimates)
    else:
        imm.bring_forward(z, noise, -dt, leaves.mean[k], leaves.spread[k])
    copy_into(steps.predicted_mean[a], leaves.mean[k])
    copy_into(steps.predicted_covariance[a], leaves.spread[k])
    log_likelihood = imm.update_filter(state, covariance, mode, z, noise, inside)
    imm.combine(state, covariance, mode, models, k, estimates)
    steps.time[a] = leaves.time[k]
    copy_into(steps.mean[a], leaves.mean[k])
    copy_into(steps.covariance[a], leaves.spread[k])
    leaves.cost[k] -= math.log(found) + log_likelihood - math.log(look.nobody[m])
    leaves.existence[k], leaves.visibility[k], leaves.misses[k] = SURELY, 1.0, 0
    leaves.plot[k, -1], leaves.step[k, -1] = look.number + m, look.step + a
    leaves.radar_time[k, look.radar] = max(leaves.radar_time[k, look.radar], columns.time[m])


@jit
def _reach(leaves, k, look, n, chain):  # type: ignore[no-untyped-def]
    """Bring leaf k of the tree in slot n to a look, past the looks before it that gave no plot, in place."""
    for missing in range(int((look.time[n] - look.before[n]) / look.period - 0.5)):  # one less than the turns, rounded
        _fade(leaves, k, look.before[n] + (missing + 1) * look.period, chain)
        _miss(leaves, k, look.detection)
    _fade(leaves, k, look.time[n], chain)


@jit
def promising(leaves, first, plot, look, columns, chain, motion, bounds):  # type: ignore[no-untyped-def]
    """Which plots of which leaves may be among the cheapest children of their tree, (A,): the others need no filter.

    Args: as of `grow`; motion: renewal and models; bounds: leaves of a tree that one is chosen from, and their gap, as of `cheapest`.
    """
    keep, price, one = np.ones(len(plot), np.bool_), np.empty(len(plot)), _empty(leaves, 1)
    work = imm.workspace(len(motion[1])), np.empty(2), np.empty((2, 2)), price
    i = 0
    while i < len(leaves.slot):
        n, end = leaves.slot[i], i + 1
        while end < len(leaves.slot) and leaves.slot[end] == n:
            end += 1
        low, high = first[i], first[end]
        if look.time[n] > -math.inf and high - low + end - i > bounds[0]:
            every = np.empty(high - low + end - i)
            for leaf in range(i, end):
                _copy(leaves, leaf, one, 0)
                _reach(one, 0, look, n, chain)
                _price(leaves, leaf, one, (first[leaf], first[leaf + 1], plot), look, columns, motion, work)
                _miss(one, 0, look.detection)
                every[high - low + leaf - i] = one.cost[0]
            copy_into(every, price[low:high])
            every.sort()
            keep[low:high] = price[low:high] <= min(every[bounds[0] - 1], every[0] + bounds[1]) + ROUNDING
        i = end
    return keep


@jit
def _price(leaves, leaf, one, plots, look, columns, motion, work):  # type: ignore[no-untyped-def]
    """Write the cost of the children of a leaf with each of its plots, but for rounding.

    Args: one: that leaf at the look, in row 0, whose filter is overwritten; plots: first, end, rows of columns; work: `imm.Workspace`,
    z (2,), noise (2, 2), and the costs, which are written.
    """
    inside, z, noise, price = work
    state, covariance, mode, at = one.state[0], one.covariance[0], one.mode[0], -math.inf
    base = one.cost[0] - math.log(max(one.existence[0] * one.visibility[0] * look.detection, LEAST))
    for a in range(plots[0], plots[1]):
        m = plots[2][a]
        dt = columns.time[m] - leaves.time[leaf]
        copy_into(z, columns.position[m])
        copy_into(noise, columns.covariance[m])
        if dt <= 0.0:
            imm.bring_forward(z, noise, -dt, leaves.mean[leaf], leaves.spread[leaf])
        if max(dt, 0.0) != at:
            at = max(dt, 0.0)
            copy_into(state, leaves.state[leaf])
            copy_into(covariance, leaves.covariance[leaf])
            copy_into(mode, leaves.mode[leaf])
            if dt > 0.0:
                copy_into(inside.mean, leaves.mean[leaf])
                copy_into(inside.spread, leaves.spread[leaf])
                imm.predict_from_moments(state, covariance, mode, motion[1], dt, motion[0], inside)
        likelihood = 0.0
        for j in range(len(mode)):
            p = covariance[j]
            ee, en, nn = p[0, 0] + noise[0, 0], p[1, 0] + noise[1, 0], p[1, 1] + noise[1, 1]
            east, north, determinant = z[0] - state[j, 0], z[1] - state[j, 1], ee * nn - en * en
            square = (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant
            likelihood += mode[j] * math.exp(-0.5 * square) / math.sqrt(determinant)
        price[a] = base - math.log(max(likelihood, FAINT) / TWO_PI) + math.log(look.nobody[m])


@jit
def grow(leaves, first, plot, look, columns, chain, renewal, models):  # type: ignore[no-untyped-def]
    """The children of leaves: each without a plot and with each of its plots. And the Steps of their filters, (A,).

    Trees without a look stay as they are. Where a plot is alone and near the prediction, and a miss would be dear, there is no child
    without it: both would go on alike (similar hypotheses of a tree that is alone: Liland, section 4.3).
    Args: leaves: LeafColumns; first: (L + 1,) first plot of each leaf; plot: (A,) rows of columns, PlotColumns; look: Look; chain:
    ExistenceChain; renewal: as of `imm.predict_filter`; models: (J,) MODEL.
    """
    out, work = _empty(leaves, len(leaves.slot) + len(plot)), (imm.workspace(len(models)), np.empty(2), np.empty((2, 2)))
    count = len(plot)
    steps = Steps(np.empty(count), np.empty((count, 4)), np.empty((count, 4, 4)), np.empty((count, 4)), np.empty((count, 4, 4)))
    k = 0
    for i in range(len(leaves.slot)):
        _copy(leaves, i, out, k)
        unseen = k
        k += 1
        n = leaves.slot[i]
        time = look.time[n]
        if time == -math.inf:
            continue
        _reach(out, unseen, look, n, chain)
        for w in range(out.plot.shape[1] - 1):
            out.plot[unseen, w], out.step[unseen, w] = out.plot[unseen, w + 1], out.step[unseen, w + 1]
        out.plot[unseen, -1] = out.step[unseen, -1] = -1
        for a in range(first[i], first[i + 1]):
            _copy(out, unseen, out, k)
            _take(out, k, plot[a], look, columns, (renewal, models), work, (steps, a))
            k += 1
        if time - leaves.radar_time[i, look.radar] > 0.5 * look.period:
            _miss(out, unseen, look.detection)
        is_lone = k == unseen + 2 and look.lone[plot[first[i]]]
        if is_lone and out.cost[unseen] - out.cost[unseen + 1] > LEAST_MISS_COST and _is_similar(steps, first[i]):
            _copy(out, unseen + 1, out, unseen)
            k = unseen + 1
    return _cut(out, k), steps


@jit
def _is_similar(steps, a):  # type: ignore[no-untyped-def]
    """Whether a step moved its position by less than one standard deviation of the prediction."""
    p = steps.predicted_covariance[a]
    east, north = steps.mean[a, 0] - steps.predicted_mean[a, 0], steps.mean[a, 1] - steps.predicted_mean[a, 1]
    square = p[1, 1] * east * east - 2.0 * p[1, 0] * east * north + p[0, 0] * north * north
    return square < p[0, 0] * p[1, 1] - p[1, 0] * p[1, 0]


@jit
def _cut(leaves, count):  # type: ignore[no-untyped-def]
    """The first so many of these leaves."""
    return LeafColumns(
        leaves.slot[:count],
        leaves.cost[:count],
        leaves.existence[:count],
        leaves.visibility[:count],
        leaves.existence_time[:count],
        leaves.misses[:count],
        leaves.mmsi[:count],
        leaves.plot[:count],
        leaves.step[:count],
        leaves.radar_time[:count],
        leaves.state[:count],
        leaves.covariance[:count],
        leaves.mode[:count],
        leaves.time[:count],
        leaves.mean[:count],
        leaves.spread[:count],
        leaves.noise[:count],
    )


@jit
def miss_looks(leaves, turns, look, chain):  # type: ignore[no-untyped-def]
    """Lower existence and visibility of leaves by looks of a radar without a plot, in place. Args: turns: (S,); look: Look."""
    for i in range(len(leaves.slot)):
        n = leaves.slot[i]
        if n < 0:  # a spare row
            continue
        for missing in range(turns[n]):
            _fade(leaves, i, look.before[n] + (missing + 1) * look.period, chain)
            _miss(leaves, i, look.detection)


@jit
def cheapest(start, cost, most, gap):  # type: ignore[no-untyped-def]
    """Which leaves are among so many of the least cost of their tree, and within the gap above the least. (L,), start: (T + 1,)"""
    keep = np.zeros(len(cost), np.bool_)
    for t in range(len(start) - 1):
        first, end = start[t], start[t + 1]
        if end - first == 1:
            keep[first] = True
            continue
        order = np.argsort(cost[first:end], kind="mergesort")
        for place in range(min(most, end - first)):
            keep[first + order[place]] = cost[first + order[place]] <= cost[first + order[0]] + gap
    return keep


@jit
def _gains(start, cost, plot, plots, null):  # type: ignore[no-untyped-def]
    """What trees gain by each plot: by how much the cost of a tree rises if it may not have it.

    Returns: the tree that gains most, -1: none has the plot; its gain; the largest gain of another tree, -inf: none. (P,) each.
    Args: start: (T + 1,); cost: (L,); plot: (L, W) numbers below plots, -1: none; plots: P; null: (T,) cost of "no vessel".
    """
    tree, gain, next_gain = np.full(plots, -1), np.full(plots, -np.inf), np.full(plots, -np.inf)
    done = np.full(plots, -1)
    for t in range(len(start) - 1):
        for i in range(start[t], start[t + 1]):
            for m in plot[i]:
                if m < 0 or done[m] == t:
                    continue
                done[m] = t
                having, without = cost[i], null[t]
                for j in range(start[t], start[t + 1]):
                    has = False
                    for w in range(plot.shape[1]):
                        has |= plot[j, w] == m
                    if has:
                        having = min(having, cost[j])
                    else:
                        without = min(without, cost[j])
                saved = without - having
                if saved > gain[m]:
                    tree[m], gain[m], next_gain[m] = t, saved, gain[m]
                else:
                    next_gain[m] = max(next_gain[m], saved)
    return tree, gain, next_gain


@jit
def _are_similar(mean, other, spread):  # type: ignore[no-untyped-def]
    """Whether two positions, and two velocities, are within two standard deviations. Args: (4,), (4,), spread: (4, 4)."""
    for a in (0, 2):
        one, two = mean[a] - other[a], mean[a + 1] - other[a + 1]
        ee, en, nn = spread[a, a], spread[a + 1, a], spread[a + 1, a + 1]
        if nn * one * one - 2.0 * en * one * two + ee * two * two >= SIMILAR * (ee * nn - en * en):
            return False
    return True


@jit
def drop_similar(start, leaves, rows, plot, plots, null, confirmed, keep):  # type: ignore[no-untyped-def]
    """Drop leaves of confirmed trees beside a cheaper leaf of the tree that has their plots and more. Writes `keep`.

    Both must be alike in position and velocity, and the dearer one must cost more than what other trees gain by those more plots.
    Then no choice needs it (similar hypotheses: Liland, section 4.3, there of trees that are alone).
    Args: start: (T + 1,); leaves: LeafColumns; rows: (L,) of these leaves; plot: (L, W) numbers below plots, -1: none; null: (T,)
    cost of "no vessel"; confirmed: (T,); keep: (L,) leaves that stay.
    """
    cost, mmsi = leaves.cost[rows], leaves.mmsi[rows]
    tree, gain, next_gain = _gains(start, cost, plot, plots, null)
    for t in range(len(start) - 1):
        if not confirmed[t]:
            continue
        for i in range(start[t], start[t + 1]):
            for j in range(start[t], start[t + 1]):
                if not keep[i]:
                    break
                if not keep[j] or mmsi[i] != mmsi[j]:
                    continue
                dearer = cost[i] - cost[j] - LEAST_DIFFERENCE
                for w in range(plot.shape[1]):
                    m = plot[j, w]
                    if plot[i, w] == m:
                        continue
                    if plot[i, w] >= 0 or m < 0:
                        dearer = -1.0
                        break
                    others = next_gain[m] if tree[m] == t else gain[m]
                    dearer -= max(others + LATER_GAIN, 0.0)
                if dearer >= 0.0 and _are_similar(leaves.mean[rows[i]], leaves.mean[rows[j]], leaves.spread[rows[i]]):
                    keep[i] = False


@jit
def pruned(start, keep, chosen):  # type: ignore[no-untyped-def]
    """Rows of the leaves to keep, those of a tree together, the chosen one first, and the first of each tree. Args: chosen: (T,)."""
    rows, begin, at = np.empty(keep.sum() + len(chosen), np.int64), np.zeros(len(start), np.int64), 0
    for t in range(len(chosen)):
        rows[at] = chosen[t]
        at += 1
        for i in range(start[t], start[t + 1]):
            if keep[i] and i != chosen[t]:
                rows[at] = i
                at += 1
        begin[t + 1] = at
    return rows[:at], begin


@jit
def weigh(start, cost, existence, null):  # type: ignore[no-untyped-def]
    """The probability of each leaf (L,), and that the vessel of each tree exists (T,). Args: null: (T,) cost of "no vessel"."""
    share, exists = np.empty(len(cost)), np.zeros(len(null))
    for t in range(len(null)):
        least = null[t]
        for i in range(start[t], start[t + 1]):
            least = min(least, cost[i])
        total = math.exp(least - null[t])
        for i in range(start[t], start[t + 1]):
            share[i] = math.exp(least - cost[i])
            total += share[i]
        for i in range(start[t], start[t + 1]):
            share[i] /= total
            exists[t] += share[i] * existence[i]
        exists[t] = min(exists[t], SURELY)
    return share, exists
