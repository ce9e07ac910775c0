"""The cost of groups of rows, measured in earlier cycles, and their distribution over chunks of about equal cost."""

from __future__ import annotations

import heapq

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.stage import Groups

TRUST = 0.5  # gain of a correction, in logarithms: one disturbed measurement does not dominate


class Costs:
    """Seconds a row of each group. Before the first measurement all rows cost the same.

    Only whole chunks are measured. The ratio of measured to expected time of a chunk corrects each of its groups alike. Groups are
    distributed again in every cycle, so over several cycles the estimates of single groups converge. A group is known by its number.
    """

    def __init__(self) -> None:
        self._rate = np.ones(0)

    def expected(self, groups: Groups) -> Floats:
        """What each group is expected to cost. Returns: (K,), seconds once something was measured."""
        if len(self._rate) != len(groups):
            self._rate = np.ones(len(groups))
        return np.asarray(self._rate * np.maximum(np.diff(groups.start), 1))

    def learn(self, expected: Floats, chunks: list[Ints], seconds: Floats) -> None:
        """Correct the costs by the time of each chunk. Args: expected: (K,); chunks: groups of each; seconds: (P,)."""
        together = np.array([expected[chunk].sum() for chunk in chunks])
        overall = max(seconds.sum(), 1e-9) / together.sum()
        for chunk, ratio in zip(chunks, np.maximum(seconds, 1e-9) / (together * overall), strict=True):
            self._rate[chunk] *= overall * ratio**TRUST


def deal(cost: Floats, count: int) -> list[Ints]:
    """Groups in at most so many chunks, the costliest group first, each to the chunk with the least so far.

    No chunk costs more than its share and one group. Chunks without a group are left out; groups are ascending in a chunk.
    Args: cost: (K,), not negative. Returns: the groups of each chunk, the costliest chunk first.
    Source: R. L. Graham, Bounds on multiprocessing timing anomalies, 1969 (LPT).
    """
    heap: list[tuple[float, int]] = [(0.0, k) for k in range(count)]
    chunks: list[list[int]] = [[] for _ in range(count)]
    load = np.zeros(count)
    for group in np.argsort(-cost, kind="stable").tolist():
        least, k = heapq.heappop(heap)
        chunks[k].append(group)
        load[k] = least + cost[group]
        heapq.heappush(heap, (float(load[k]), k))
    return [np.array(sorted(chunks[k]), np.int64) for k in np.argsort(-load, kind="stable") if chunks[k]]
