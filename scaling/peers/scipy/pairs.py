"""Association by the sample covariance of a window of differences: k-d tree, numpy.cov, scipy's assignment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scaling.peers.exchange import AIS, RADAR, Floats, Ints, Stopwatch, TaskResult, TrackHistory

LIMIT = 100.0  # of the statistic of a pair; README.md: how it was chosen
Statistics = Callable[[Floats, Ints, Ints], Floats]


def association(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Pairs of each cycle, with numpy.cov and numpy.linalg.solve once per pair."""
    return _associate(history, watch, statistic_by_pair)


def association_batched(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Pairs of each cycle, with the same statistic for all pairs at once."""
    return _associate(history, watch, statistic_by_batch)


def _associate(history: TrackHistory, watch: Stopwatch, statistics: Statistics) -> TaskResult:
    """The pairs of every measured cycle; filling the windows is not timed."""
    radar, ais = (np.flatnonzero(history.source == s) for s in (RADAR, AIS))
    states = np.concatenate([history.position_m, history.velocity_m_s], axis=2)
    pairs = [np.zeros((0, 3), np.int64)]
    for cycle in range(history.first, len(history.time_s)):
        window = np.ascontiguousarray(states[max(0, cycle + 1 - history.settings["window"]) : cycle + 1].swapaxes(0, 1))
        with watch.lap():
            first, second = pairs_in_gate(window[:, -1, :2], radar, ais, history.settings["gate_m"])
            x = statistics(window, first, second)
            near = x < LIMIT
            chosen = one_to_one(first[near], second[near], x[near])
        first, second = first[near][chosen], second[near][chosen]
        pairs.append(np.stack([np.full(len(first), cycle), first, second], axis=1))
    return watch.result(("numpy", "scipy"), unit="track", units=len(history.track_id), pairs=np.concatenate(pairs))


def pairs_in_gate(position: Floats, radar: Ints, ais: Ints, gate_m: float) -> tuple[Ints, Ints]:
    """Rows of radar and AIS tracks within a distance in metres, one row pair each. Returns: (A,), (A,)."""
    lists: Any = cKDTree(position[ais]).query_ball_point(position[radar], gate_m)  # an array of lists; scipy-stubs: one list
    first = np.repeat(radar, [len(near) for near in lists])
    return first, ais[np.concatenate([np.zeros(0, np.int64), *lists]).astype(np.int64)]


def statistic_by_pair(window: Floats, first: Ints, second: Ints) -> Floats:
    """d' S^-1 d of each pair: d is the last difference, S the sample covariance over the window. Args: window: (N, W, 4)."""
    out = np.zeros(len(first))
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        delta = window[b] - window[a]
        out[k] = delta[-1] @ np.linalg.solve(np.cov(delta.T), delta[-1])
    return out


def statistic_by_batch(window: Floats, first: Ints, second: Ints) -> Floats:
    """The same for all pairs at once."""
    delta = window[second] - window[first]
    centred = delta - delta.mean(axis=1, keepdims=True)
    phi = centred.swapaxes(1, 2) @ centred / (window.shape[1] - 1)
    last = delta[:, -1]
    statistic: Floats = np.einsum("pi,pi->p", last, np.linalg.solve(phi, last[..., None])[..., 0])
    return statistic


def one_to_one(first: Ints, second: Ints, x: Floats) -> Ints:
    """Indices of the pairs of the cheapest assignment in each connected component; as many pairs as possible."""
    if not len(first):
        return np.zeros(0, np.int64)
    count = int(max(first.max(), second.max())) + 1
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    component = connected_components(graph, directed=False)[1][first]
    order = np.argsort(component, kind="stable")
    chosen = []
    for pairs in np.split(order, np.flatnonzero(np.diff(component[order])) + 1):
        if len(pairs) == 1:
            chosen.append(int(pairs[0]))
            continue
        rows, columns = (np.unique(side[pairs], return_inverse=True)[1] for side in (first, second))
        cost = np.full((rows.max() + 1, columns.max() + 1), LIMIT * len(pairs))
        index = np.full(cost.shape, -1)
        cost[rows, columns], index[rows, columns] = x[pairs], pairs
        assigned = index[linear_sum_assignment(cost)]
        chosen += assigned[assigned >= 0].tolist()
    return np.array(chosen, np.int64)
