"""The past that is decided: after a window of looks the choice of a plot is final, and its state is smoothed by the later ones."""

from __future__ import annotations

from dataclasses import replace

from coastwatch import kernels
from coastwatch.batches import Bools
from coastwatch.tracks.radar.leaves import Decided, Forest
from coastwatch.tracks.radar.multi_hypothesis.choice import Pruned
from coastwatch.tracks.radar.table import Status, Table


def decide(forest: Forest, table: Table, pruned: Pruned, looked: Bools) -> Forest:
    """This forest with the states that became final by a look, of confirmed tracks.

    Args: forest: with the steps of the leaves that stay; pruned: these leaves; looked: (S,) trees that were looked at.
    """
    path = pruned.leaves.step[pruned.start[:-1]]
    final = looked[pruned.slot] & (table.status[pruned.slot] == Status.CONFIRMED) & (path[:, 0] >= 0)
    if not final.any():
        return forest
    path, steps = path[final], forest.steps
    mean, covariance = kernels.filters.smoothing.fixed_lag(steps.columns, path)
    first = path[:, 0]
    new = Decided(table.track_id[pruned.slot[final]], steps.time_s[first], mean, covariance, steps.radar[first])
    return replace(forest, decided=Decided.join([forest.decided, new]))
