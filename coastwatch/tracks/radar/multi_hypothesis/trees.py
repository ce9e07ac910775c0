"""Trees of leaves beside the table of tracks: roots of new tracks, what a look writes into the slots of its trees, and the decided past.

After a window of looks the choice of a plot is final, and its state is smoothed by the later ones.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints
from coastwatch.kernels.tracks.columns import NAMES, PlotColumns
from coastwatch.kernels.tracks.existence import SURELY
from coastwatch.kernels.tracks.tree_rows import TreeRows
from coastwatch.tracks.radar.leaves import Decided, FilterSteps, Forest, Leaves
from coastwatch.tracks.radar.multi_hypothesis.choice import WIDEST, Pruned
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory, Status, Table

HELD = 0.9  # an id of this probability is that of the only leaf of a track of another tracker
HEARD = 0.9  # least existence of a track whose next message is not late
AGREED = 0.02  # leaves above this probability must have one MMSI, so that the track has it
NAMED = 0.995  # probability of an MMSI on which the leaves agree
OWNED = 0.3  # a plot that a confirmed track has with more than this probability begins no track
OF_LEAVES = ("slot", "cost", "existence", "mmsi", "plot", "step")  # columns that a table of tracks does not have


def forest_of(memory: RadarMemory, looks: int) -> Forest:
    """The leaves of the live tracks, with one of each track that has none. Args: looks: of a window.

    Raises: ValueError where the memory is of another window.
    """
    table, forest, window = memory.table, memory.forest, looks + 1
    if not len(forest.leaves):
        count, models = table.radar_s.shape[1], table.mode_probability.shape[1]
        forest = replace(forest, leaves=Leaves.empty(W=window, R=count, J=models))
    if forest.leaves.plot.shape[1] != window:
        raise ValueError(f"memory of radar tracks: got a window of {forest.leaves.plot.shape[1] - 1}, needed {looks}")
    forest = without_ended(forest.with_room("S", len(table.track_id)), table)
    roots = table.live[forest.trees().leaves[table.live] == 0]
    return with_roots(forest, table, np.sort(roots), np.full(len(roots), -1)) if len(roots) else forest


def without_ended(forest: Forest, table: Table) -> Forest:
    """This forest without the leaves of tracks that have ended. Their open states are decided now: no look comes that could change them."""
    ended = forest.trees().leaves > 0
    ended[table.live] = False
    gone = np.flatnonzero(ended)
    if len(gone):
        forest = decide_open(forest, table, gone[table.status[gone] == Status.CONFIRMED])
        forest.leaves.slot[kernels.tracks.tree_rows.rows_of(forest.trees(), gone)] = -1
    return forest


def with_roots(forest: Forest, table: Table, slots: Ints, plots: Ints) -> Forest:
    """This forest with a leaf for each of these tracks, which have none. Args: plots: (N,) number of the newest plot, -1: unknown."""
    forest = forest.with_room("S", len(table.track_id))
    trees, count, width = forest.trees(), len(slots), forest.leaves.plot.shape[1]
    window, step = np.full((2, count, width), -1)
    window[:, -1] = plots
    step[:, -1] = trees.steps + np.arange(count)
    mean, covariance = table.combined_mean[slots], table.combined_covariance[slots]
    radar = np.where(np.isfinite(table.radar_s[slots]).any(axis=1), table.radar_s[slots].argmax(axis=1), -1)
    steps = FilterSteps(table.updated_s[slots], mean, covariance, mean, covariance, radar)
    of_table = {f.name: getattr(table, f.name)[slots] for f in fields(Leaves) if f.name not in OF_LEAVES}
    own = {"slot": slots, "cost": np.zeros(count), "existence": np.full(count, SURELY), "plot": window, "step": step}
    new = Leaves(**own, mmsi=table.probable_ids(slots, HELD), **of_table)
    existence = np.clip(table.existence[slots], 1.0 - SURELY, SURELY)
    forest = forest.replaced(trees, slots, new, steps)
    forest.null_cost[slots] = np.clip(np.log(existence) - np.log1p(-existence), -WIDEST, WIDEST)
    forest.nulled[slots] = 0
    forest.until_s[slots] = -np.inf
    return forest


def with_linked(forest: Forest, trees: TreeRows, grown: Leaves, looked: Bools, heard: Ints | None = None) -> Leaves:
    """These leaves of trees that were looked at, and those of trees that share a plot or an MMSI with them, behind them.

    The choice of all other trees stands. Args: heard: MMSI of the messages that trees may take now.
    """
    names = np.zeros(0, np.int64) if heard is None else heard
    others = np.flatnonzero(kernels.tracks.tree_rows.linked_trees(forest.leaves.columns, trees, names, looked) & ~looked)
    if not len(others):
        return grown
    return Leaves.join([grown, forest.leaves.take(kernels.tracks.tree_rows.rows_of(trees, others))])


def write_chosen(parts: Parts, table: Table, pruned: Pruned, looked: Bools, first: int, batch: PlotColumns) -> Ints:
    """Write the chosen leaf of each tree that was looked at into its slot. Args: looked: (S,); first: number of the first plot.

    Returns: (M,) slot that took each plot or message, -1: none.
    """
    here, leaves = looked[pruned.slot], pruned.leaves
    slots, rows = pruned.slot[here], pruned.start[:-1][here]
    for f in fields(Leaves):
        if f.name not in OF_LEAVES:
            getattr(table, f.name)[slots] = getattr(leaves, f.name)[rows]
    table.existence[slots] = pruned.existence[here]
    new = leaves.plot[rows, -1] - first
    got = np.flatnonzero(new >= 0)
    taken = np.full(len(batch.time), -1)
    taken[new[got][::-1]] = slots[got][::-1]
    kernels.tracks.track_life.record(table.life, slots[got], new[got], batch)
    table.note_moved(parts.clutter, slots)
    if (leaves.mmsi >= 0).any() or (table.ids[slots, 0] >= 0).any():
        _write_names(table, pruned)
    return taken


def _write_names(table: Table, pruned: Pruned) -> None:
    """Write the MMSI of each tree whose probable leaves agree on it, and none where they do not, in place."""
    first, mmsi, slots = pruned.start[:-1], pruned.leaves.mmsi, pruned.slot
    exists = np.repeat(np.add.reduceat(pruned.share, first), np.diff(pruned.start))
    heard = pruned.share > AGREED * exists
    heard[first] = True  # the chosen ones
    least = np.minimum.reduceat(np.where(heard, mmsi, np.iinfo(np.int64).max), first)
    agreed = (least >= 0) & (least == np.maximum.reduceat(np.where(heard, mmsi, -1), first))
    table.ids[slots, 0] = np.where(agreed, least, -1)
    table.id_probability[slots, 1] = np.where(agreed, NAMED, 0.0)
    table.id_probability[slots, 2 : NAMES + 1] = 0.0
    unknown = np.where(agreed, 0.0, table.id_probability[slots, 0])
    table.id_probability[slots, 0] = unknown
    table.id_probability[slots, NAMES + 1] = 1.0 - table.id_probability[slots, 1] - unknown


def keep_heard(forest: Forest, time_s: float) -> None:
    """Let radar looks lower the existence of tracks whose next message is not late no further than `HEARD`, in place.

    A message proves its vessel, whatever radars miss.
    """
    leaves, trees, heard = forest.leaves, forest.trees(), forest.until_s >= time_s
    slots = np.flatnonzero(heard & (trees.leaves > 0))
    if not len(slots):
        return
    rows = kernels.tracks.tree_rows.rows_of(trees, slots)
    rows = rows[leaves.mmsi[rows] >= 0]
    leaves.existence[rows] = np.maximum(leaves.existence[rows], HEARD)
    chosen = leaves.cost[trees.first[slots]]
    forest.null_cost[slots] = np.maximum(forest.null_cost[slots], chosen + math.log(HEARD / (1.0 - HEARD)))


def shares(table: Table, pruned: Pruned, count: int, first: int) -> tuple[Floats, Floats, Floats]:
    """The probability of each plot (M) that it is of a track; of the confirmed track that has it most; and of one that moves.

    Args: count: M, of plots or messages; first: number of the first.
    """
    leaves = pruned.leaves
    new = np.flatnonzero(leaves.plot[:, -1] >= first)
    plot, share, slot = leaves.plot[new, -1] - first, pruned.share[new], leaves.slot[new]
    confirmed: Bools = table.status[slot] == Status.CONFIRMED
    pair, of = np.unique(np.column_stack([plot[confirmed], slot[confirmed]]), axis=0, return_inverse=True)
    owned = np.zeros(count)
    np.maximum.at(owned, pair[:, 0], np.bincount(of.ravel(), share[confirmed], len(pair)))
    of_any, of_moving = (np.asarray(np.bincount(plot, one, count), np.float64) for one in (share, share * table.moving(slot)))
    return of_any, owned, of_moving


def decide(forest: Forest, table: Table, pruned: Pruned, looked: Bools) -> Forest:
    """This forest with the states that became final by a look, of confirmed tracks.

    Args: forest: with the steps of the leaves that stay; pruned: these leaves; looked: (S,) trees that were looked at.
    """
    path = pruned.leaves.step[pruned.start[:-1]]
    final = looked[pruned.slot] & (table.status[pruned.slot] == Status.CONFIRMED)
    return _with_decided(forest, table.track_id[pruned.slot[final]], path[final])


def decide_open(forest: Forest, table: Table, slots: Ints) -> Forest:
    """This forest with the states of the chosen leaves of these tracks that no look has made final yet."""
    if not len(forest.leaves):  # of a tracker that decides at once
        return forest
    trees = forest.trees()
    slots = slots[trees.leaves[slots] > 0]
    if not len(slots):
        return forest
    path = forest.leaves.step[trees.first[slots]]
    for place in range(1, path.shape[1]):
        forest = _with_decided(forest, table.track_id[slots], path[:, place:])
    return forest


def _with_decided(forest: Forest, number: Ints, path: Ints) -> Forest:
    """This forest with the oldest states of these paths, smoothed by those after them, where there is a measurement.

    Args: number: (T,) of the tracks; path: (T, W) rows of steps, oldest first, -1: none.
    """
    held = path[:, 0] >= 0
    if not held.any():
        return forest
    number, path, steps = number[held], path[held], forest.steps
    mean, covariance = kernels.filters.smoothing.fixed_lag(steps.columns, path)
    first = path[:, 0]
    new = Decided(number, steps.time_s[first], mean, covariance, steps.radar[first])
    return replace(forest, decided=Decided.join([forest.decided, new]))
