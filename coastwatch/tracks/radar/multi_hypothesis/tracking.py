"""The association of multi-hypothesis tracks: leaves grow by the plots of a look, one of each tree is chosen, the others are pruned."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Messages
from coastwatch.kernels.filters.gaussian import Estimates, squared_distance
from coastwatch.kernels.tracks.columns import PlotColumns, RadarColumns
from coastwatch.kernels.tracks.hypothesis_trees import Look
from coastwatch.kernels.tracks.tree_rows import TreeRows
from coastwatch.stage import Count, Positive
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.leaves import FilterSteps, Forest, Leaves
from coastwatch.tracks.radar.life.existence import merge_duplicates
from coastwatch.tracks.radar.messages import WithMessages, leave
from coastwatch.tracks.radar.messages.sequential import rounds
from coastwatch.tracks.radar.multi_hypothesis.choice import Pruning, choose_and_prune, ended, starts
from coastwatch.tracks.radar.multi_hypothesis.messages import take_round
from coastwatch.tracks.radar.multi_hypothesis.trees import (
    AGREED,
    OWNED,
    decide,
    decide_open,
    forest_of,
    keep_heard,
    shares,
    with_linked,
    with_roots,
    without_ended,
    write_chosen,
)
from coastwatch.tracks.radar.parts import Parts, begin_look, begin_tracks, candidates_by_largest_noise
from coastwatch.tracks.radar.plot_association import LOOKS, PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory, Status, Table

ELLIPSE = 4.0  # squared distance of the ellipse that people see: two standard deviations
LEAST_SHARE = 0.01  # probability of a leaf that widens the covariance of its track


class MultiHypothesis(PlotAssociation):
    """Each track keeps several ways to give it the plots of the last looks. The cheapest choice over all tracks is reported.

    Source: E. Liland, AIS aided multi hypothesis tracker, NTNU 2017; with probabilities of existence as `jipda` has them.
    """

    upkeep: ClassVar[str] = "existence"
    banks: ClassVar[tuple[str, ...]] = ("compiled",)
    messages: ClassVar[tuple[str, ...]] = ("sequential", "guiding", "none")
    method: Literal["multi_hypothesis"] = "multi_hypothesis"
    window: Annotated[int, Field(ge=1, le=12)] = 3  # looks of a track, after which the choice of a plot is final
    leaves: Annotated[int, Field(ge=1, le=500)] = 20  # of a track, at most
    score_gap: Positive = (
        12.0  # a leaf that costs so much more than the cheapest of its track, with the prices of its plots, is dropped
    )
    patience: Count = 8  # looks without a plot of its chosen leaf after which a track ends; not `upkeep.delete_misses`
    price_rounds: Annotated[int, Field(ge=1, le=1000)] = 200  # number of rounds of the global choice in a cluster, at most
    search_nodes: Annotated[int, Field(ge=1, le=100_000)] = 2000  # number of nodes of its branch and bound, at most

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Grow, choose and prune by a batch of one radar. Returns: memory, the slot of the chosen leaf that took each plot, or -1."""
        forest, table, rules = forest_of(memory, self.window), memory.table, parts.existence
        radar, sensors = int(batch.sensor[0]), parts.sensors.radars
        expected = begin_look(parts, memory, batch)
        nobody = expected.untracked_per_m2
        period_s, before_s = float(sensors.period_s[radar]), table.looked_s[:, radar].copy()
        unseen_s, trees = np.full(len(before_s), -np.inf), forest.trees()
        lone = np.zeros(len(batch.time), np.bool_)
        look = Look(radar, period_s, expected.detection, unseen_s, before_s, nobody, lone, forest.next_plot, trees.steps)
        grown, steps = _grown(parts, forest, trees, batch, look, (table.status, *self._pruning.candidates))
        looked = np.isfinite(look.time)
        grown = with_linked(forest, trees, grown, looked)
        pruned = choose_and_prune(self._pruning, forest, grown, looked, table.status)
        forest = forest.replaced(trees, pruned.slot, pruned.leaves, steps)
        next_plot, unproven = forest.next_plot + len(batch.time), forest.unproven + pruned.unproven
        forest = replace(forest, next_plot=next_plot, unproven=unproven)
        taken = write_chosen(parts, table, pruned, looked, look.number, batch)
        if memory.plots_alone.models:
            _update_plots_alone(parts, memory, taken, batch)
        at = pruned.slot[looked[pruned.slot]]
        table.looked_s[at, radar] = look.time[at]
        forest = decide(forest, table, pruned, looked)
        plots = shares(table, pruned, len(batch.time), look.number)
        memory = memory.with_clutter(parts.clutter, batch, np.clip(1.0 - plots[2], 0.0, 1.0), period_s)
        free = np.clip(1.0 - plots[0], 0.0, 1.0)
        if rules.rates.learnt:
            memory.rates.false_plots[radar] += (free * expected.false_per_m2 / nobody).sum()
        existence = free * expected.unborn_per_m2 / nobody
        existence[plots[1] > OWNED] = 0.0
        return _begin(parts, replace(memory, forest=forest), existence, batch), taken

    def take_messages(
        self, parts: Parts, rules: WithMessages, memory: RadarMemory, messages: Messages, until_s: float
    ) -> RadarMemory:
        """The memory after these messages, each at its own time, those without a common track together."""
        for some in rounds(parts, rules, memory.table, messages):
            memory = take_round(self._pruning, parts, rules, memory, some)
        return memory

    def leave_messages(
        self, parts: Parts, rules: WithMessages, memory: RadarMemory, since_s: float, time_s: float
    ) -> RadarMemory:
        """The memory after tracks have left messages that contradict their plots.

        Each begins again with one leaf, which is its row of the table. What it had is decided as it is.
        """
        slots = leave(rules, parts, memory, since_s, time_s, max(LOOKS, self.window))  # the last looks are not decided yet
        if not len(slots):
            return memory
        forest, table = forest_of(memory, self.window), memory.table
        forest = decide_open(forest, table, slots[table.status[slots] == Status.CONFIRMED])
        forest = with_roots(forest, table, slots, np.full(len(slots), -1))
        return replace(memory, forest=forest.compact(table.live))

    @property
    def _pruning(self) -> Pruning:
        return Pruning(self.window, self.leaves, self.score_gap, self.price_rounds, self.search_nodes)

    def end_slice(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Count the looks that gave a tree no plot, confirm and delete tracks. Args: time_s: of the newest plot, or now."""
        forest, table, rules = forest_of(memory, self.window), memory.table, parts.existence
        radars, ours, every = parts.radars(memory), parts.ours, parts.sensors.radars
        detection, missed = rules.by_number(memory.rates, every)[0].probability, kernels.tracks.hypothesis_trees.miss_looks
        touched = np.zeros(len(table.track_id), np.bool_)
        for place, radar in enumerate(ours.tolist()):
            turns = _turns(table, radars, place, radar, rules.look_slack)
            if turns.any():
                period_s, before_s, none = float(radars.period[place]), table.looked_s[:, radar], np.zeros(0)
                look = Look(radar, period_s, float(detection[radar]), none, before_s, none, none > 0.0, 0, 0)
                missed(forest.leaves.columns, turns, look, rules.chain)
                table.looked_s[:, radar] += turns * look.period
                touched |= turns > 0
        if touched.any():
            keep_heard(forest, time_s)
            _write_existence(self.window, table, forest, touched)
        memory = replace(memory, forest=forest.with_room("S", len(table.track_id)))
        upkeep = rules.model_copy(update={"delete_misses": self.patience})
        return upkeep.end_slice(memory, radars, ours, every, time_s, memory.forest.until_s)

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Merge tracks of one vessel."""
        memory = merge_duplicates(parts.existence, memory, parts.sensors.radars.period_s, time_s)
        forest = without_ended(memory.forest, memory.table)
        return replace(memory, forest=forest.compact(memory.table.live))

    def predict(self, parts: Parts, memory: RadarMemory, slots: Ints, time_s: float) -> tuple[Estimates, Floats]:
        """The tracks in these slots (N), predicted to a time: the mean of the chosen leaf, and the covariance of all leaves about it.

        And how far from there the likeliest leaf is that lies outside the ellipse of the chosen one, m; NaN: none does. (N,)
        """
        table, leaves = memory.table, memory.forest.leaves
        now = parts.bank.predict(table.filters, table.estimates, slots, time_s)
        start = starts(leaves.slot)
        without_null = np.full(len(start) - 1, np.inf)
        share, _ = kernels.tracks.hypothesis_trees.weigh(start, leaves.cost, leaves.existence, without_null)
        place = np.full(len(table.track_id), -1)
        place[slots] = np.arange(len(slots))
        share[start[:-1]] = 0.0  # the chosen ones
        others = np.flatnonzero((share > LEAST_SHARE) & (place[leaves.slot] >= 0))
        weight, of = share[others][:, None, None], place[leaves.slot[others]]
        ahead = parts.bank.predict(leaves.filters, leaves.estimates, others, time_s)
        apart = ahead.mean - now.mean[of]
        outer = apart[:, :, None] * apart[:, None, :]
        covariance = now.covariance.copy()
        np.add.at(covariance, of, weight * (ahead.covariance + outer - now.covariance[of]))
        apart, alternative_m = apart[:, :2], np.full(len(slots), np.nan)
        outside = (weight[:, 0, 0] > AGREED) & (squared_distance(apart, now.covariance[of, :2, :2]) > ELLIPSE)
        rows = np.flatnonzero(outside)
        rows = rows[np.argsort(weight[rows, 0, 0], kind="stable")]  # the likeliest is written last
        alternative_m[of[rows]] = np.hypot(*apart[rows].T)
        return now._replace(covariance=covariance), alternative_m


def _grown(
    parts: Parts, forest: Forest, trees: TreeRows, batch: PlotColumns, look: Look, bounds: tuple[Ints, int, float]
) -> tuple[Leaves, FilterSteps]:
    """The children of the leaves of trees with a plot in a gate, and the steps of their filters.

    The time of the look of each tree, and which plots are alone, are written into `look`.
    Args: bounds: status of each slot (S,), leaves of a tree that one is chosen from, and their gap.
    """
    status, most, gap = bounds
    leaves, rules = forest.leaves, parts.existence
    pairs = candidates_by_largest_noise(parts, leaves.estimates, np.flatnonzero(leaves.slot >= 0), batch)
    of_tree = leaves.slot[pairs.track]
    other = np.full(len(batch.time), -1)
    other[pairs.plot] = of_tree
    shared = np.bincount(pairs.plot, other[pairs.plot] != of_tree, len(batch.time)) > 0.0
    confirmed = np.append(status == Status.CONFIRMED, False)  # the last: of no tree
    look.lone[:] = ~shared & confirmed[other]
    due = batch.time[pairs.plot] - leaves.radar_s[pairs.track, look.radar] > 0.5 * look.period
    leaf, plot = pairs.track[due], pairs.plot[due]
    np.maximum.at(look.time, leaves.slot[leaf], batch.time[plot])
    rows = kernels.tracks.tree_rows.rows_of(trees, np.flatnonzero(np.isfinite(look.time)))
    place = np.empty(len(leaves), np.int64)
    place[rows] = np.arange(len(rows))
    first, by_leaf = kernels.tables.counting_sort.counting_sort(place[leaf], len(rows))
    plot, parents = plot[by_leaf], leaves.take(rows).columns
    motion, promising = (parts.bank.prior.renewal_s, parts.bank.models), kernels.tracks.hypothesis_trees.promising
    kept = promising(parents, first, plot, look, batch, rules.chain, motion, (most, gap))
    if not kept.all():
        first, plot = np.append(0, np.cumsum(kept)).astype(first.dtype)[first], plot[kept]  # of one type: compiled once
    grow = kernels.tracks.hypothesis_trees.grow
    grown, steps = grow(parents, first, plot, look, batch, rules.chain, motion[0], motion[1])
    radar = np.full(len(plot), look.radar)
    new = FilterSteps(steps.time, steps.mean, steps.covariance, steps.predicted_mean, steps.predicted_covariance, radar)
    return Leaves(*grown), new


def _update_plots_alone(parts: Parts, memory: RadarMemory, taken: Ints, batch: PlotColumns) -> None:
    """Update the filters of plots alone by the plots that chosen leaves took, in place. Args: taken: (M,) slot of each plot, -1: none."""
    plot = np.flatnonzero(taken >= 0)
    plot = plot[np.argsort(taken[plot], kind="stable")]
    share, every = np.ones(len(plot)), np.arange(len(plot))
    plots_alone.update(memory.plots_alone, memory.table, parts, taken[plot], plot, share, every, batch)


def _begin(parts: Parts, memory: RadarMemory, existence: Floats, batch: PlotColumns) -> RadarMemory:
    """A track for each plot that is probably of a vessel without one. Args: existence: (M,)."""
    plots = np.flatnonzero(existence >= parts.existence.begin_existence)
    if not len(plots):
        return memory
    memory = begin_tracks(parts.bank, memory, plots, batch)
    table, forest = memory.table, memory.forest
    slots = table.live[-len(plots) :]
    table.existence[slots] = existence[plots]
    numbers = forest.next_plot - len(batch.time) + plots
    return replace(memory, forest=with_roots(forest, table, slots, numbers))


def _turns(table: Table, radars: RadarColumns, place: int, radar: int, slack: float) -> Ints:
    """The looks of a radar at each slot that are over and gave it no plot. (S,) A radar that does not cover a track has not looked."""
    live, out = table.live, np.zeros(len(table.track_id), np.int64)
    newest = float(radars.newest[place])
    if not math.isfinite(newest):
        return out
    turns = np.floor((newest - table.looked_s[live, radar]) / radars.period[place] - slack)
    ahead = np.maximum(newest - table.updated_s[live], 0.0)[:, None]
    position = table.combined_mean[live, :2] + ahead * table.combined_mean[live, 2:]
    inside = ((position - radars.site[place]) ** 2).sum(axis=1) <= radars.range[place] ** 2
    over = turns > 0.0
    table.looked_s[live[over & ~inside], radar] = newest
    out[live[over & inside]] = turns[over & inside].astype(np.int64)
    return out


def _write_existence(window: int, table: Table, forest: Forest, touched: Bools) -> None:
    """Existence, visibility and misses of these slots (S,) by their leaves, in place."""
    leaves, trees = forest.leaves, forest.trees()
    slots = np.flatnonzero(touched & (trees.leaves > 0))
    rows, start = kernels.tracks.tree_rows.rows_of(trees, slots), np.append(0, np.cumsum(trees.leaves[slots]))
    weigh = kernels.tracks.hypothesis_trees.weigh
    _, existence = weigh(start, leaves.cost[rows], leaves.existence[rows], forest.null_cost[slots])
    existence[ended(forest.nulled[slots], table.status[slots], window)] = 0.0
    first = trees.first[slots]
    table.existence[slots], table.visibility[slots] = existence, leaves.visibility[first]
    table.existence_s[slots], table.misses[slots] = leaves.existence_s[first], leaves.misses[first]
