"""What the groups of a work cost, as measured in earlier cycles, and chunks of equal cost."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.stage import Groups, Shared

TRUST = 0.5  # in what one chunk took against the others, in logarithms: one disturbed chunk does not turn everything round


class Costs:
    """Seconds a row of each group; before the first measurement all rows cost the same.

    Only whole chunks are measured: what a chunk took more or less than the others is laid to each of its groups alike, and because
    groups are dealt anew in every cycle it is the costly ones that come out costly. Groups are told apart by their number, as
    spots can be; where that tells nothing, chunks are less equal and nothing else.
    """

    def __init__(self) -> None:
        self._rate = np.ones(0)

    def expected(self, groups: Groups) -> Floats:
        """What each group is expected to cost. Returns: (K,), seconds once something was measured."""
        if len(self._rate) != len(groups):
            self._rate = np.ones(len(groups))
        return np.asarray(self._rate * np.maximum(np.diff(groups.start), 1))

    def learn(self, expected: Floats, part: Ints, seconds: Floats) -> None:
        """Takes over what each part took. Args: expected: (K,); part: (K,) of each group; seconds: (P,), every part with a group."""
        together = np.bincount(part, expected, len(seconds))
        overall = max(seconds.sum(), 1e-9) / together.sum()
        ratio = np.maximum(seconds, 1e-9) / (together * overall)
        self._rate = self._rate * overall * ratio[part] ** TRUST


def along(arrays: Shared, groups: Groups) -> Ints | None:
    """Groups in the order of the axis along which they are spread most, by their first row; none where the arrays do not say where
    it is. Returns: (K,)."""
    if "rank" not in arrays or "point" not in arrays or len(groups.row) == 0:
        return None
    first = groups.row[np.minimum(groups.start[:-1], len(groups.row) - 1)]
    point = arrays["point"][arrays["rank"][np.where(first >= 0, first, -1 - first)], :3]
    return np.argsort(point[:, np.ptp(point, axis=0).argmax()], kind="stable")


def chunks(expected: Floats, count: int, order: Ints | None) -> tuple[Ints, list[Ints]]:
    """Groups in at most so many chunks of about equal cost: the chunk of each group, and the groups of each, costliest chunk first.

    Args: expected: (K,) cost; order: (K,) in which neighbours in a chunk are cheaper than others, because they share their halo; none:
    all are alike, and they are dealt one by one.
    """

    count = min(count, len(expected))
    if order is None:
        part = kernels.tables.dealing.deal(expected, count)
    else:
        part, middle = np.empty(len(expected), np.int64), np.cumsum(expected[order]) - 0.5 * expected[order]
        part[order] = np.minimum(middle * (count / expected.sum()), count - 1).astype(np.int64)
    load = np.bincount(part, expected, count)
    rank = np.empty(count, np.int64)
    rank[np.argsort(-load, kind="stable")] = np.arange(count)
    part = rank[part]
    group, start = kernels.tables.sorting.by_key(part, int(np.count_nonzero(load)))
    return part, [group[a:b] for a, b in pairwise(start.tolist())]
