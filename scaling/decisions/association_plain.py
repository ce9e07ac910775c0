"""Track-to-track association the straightforward way, by whole arrays: a tree for the gate, numpy for windows, scipy for one-to-one.

What `scaling.decisions.association_cycle` compares with. The same statistic as `windowed_covariance`, of every pair within the gate.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from coastwatch.associations import WindowedCovariance
from coastwatch.associations.history import History
from coastwatch.batches import Floats, Ints, Tracks
from coastwatch.geodesy import earth_centred, scale_m_deg, wrap_deg
from coastwatch.kernels.association.history import RATES, singles

AT_ONCE = 20_000  # pairs, whose windows stay in the cache


def windows_of(history: History) -> Floats:
    """(N, W, 6) by row, oldest first, NaN where a track is younger: as one keeps them who has not thought of memory."""
    out = np.full((len(history.track_id), history.window, 6), np.nan)
    for age in range(len(history.ring)):
        has = history.length > age
        row = np.flatnonzero(has) if age == 0 else history.chain[has, age - 1]
        array = history.ring[-1 - age]
        out[has, -1 - age] = np.concatenate([array[:, :2], singles(array)[:, RATES]], axis=1)[row]
    return out[history.rank]


def gate(method: WindowedCovariance, tracks: Tracks) -> tuple[Ints, Ints]:
    """Pairs of tracks of different sources, the lower one first."""
    pairs = cKDTree(earth_centred(tracks.position_deg)).query_pairs(method.gate_m, output_type="ndarray")
    first, second = pairs[tracks.source[pairs[:, 0]] != tracks.source[pairs[:, 1]]].T
    swap = tracks.source[first] > tracks.source[second]
    return np.where(swap, second, first), np.where(swap, first, second)


def scores(method: WindowedCovariance, tracks: Tracks, windows: Floats, first: Ints, second: Ints) -> Floats:
    """The statistic of every pair, a few thousand at once. Returns: (A,)."""
    around = np.maximum(np.bincount(first, minlength=len(tracks)) - 1, 1) / (np.pi * method.gate_m**2)
    registration = method.registration * np.where(tracks.mmsi < 0, 1.0, 0.0)[:, None, None] * tracks.report_covariance
    known = tracks.known_covariance(method.unknown_velocity_sigma_m_s)
    out = np.empty(len(first))
    for begin in range(0, len(first), AT_ONCE):
        a, b = first[begin : begin + AT_ONCE], second[begin : begin + AT_ONCE]
        bias = np.zeros((len(a), 4, 4))
        bias[:, :2, :2] = registration[a] + registration[b]
        out[begin : begin + AT_ONCE] = _scores(method, windows[a], windows[b], known[a] + known[b], bias, around[a])
    return out


def _scores(method: WindowedCovariance, one: Floats, other: Floats, total: Floats, bias: Floats, around: Floats) -> Floats:
    there = ~np.isnan(one[:, :, 0] + other[:, :, 0])
    n = there.sum(axis=1)
    north, east = scale_m_deg(0.5 * (one[:, -1, 0] + other[:, -1, 0]))
    delta = other[:, :, :4] - one[:, :, :4]
    delta = np.stack(
        [wrap_deg(delta[:, :, 1]) * east[:, None], delta[:, :, 0] * north[:, None], delta[:, :, 2], delta[:, :, 3]], axis=2
    )
    off = np.where(there[:, :, None], delta - np.nanmean(delta, axis=1, keepdims=True), 0.0)
    gain = np.ones((len(one), 2))
    weight = (n - 1.0) / (n - 1.0 + method.prior)
    for block in range(2):
        part = slice(2 * block, 2 * block + 2)
        whole = np.einsum("ati,atj->aij", off[:, :, part], off[:, :, part])
        shown = np.trace(np.linalg.solve(total[:, part, part], whole), axis1=1, axis2=2) / (2.0 * np.maximum(n - 1, 1))
        gain[:, block] = np.where(n > 2, np.clip(1.0 + weight * (shown - 1.0), method.floor, method.cap), 1.0)
    root = np.sqrt(np.repeat(gain, 2, axis=1))
    low = np.linalg.cholesky(total * root[:, :, None] * root[:, None, :] + bias)
    older = np.maximum((one + other)[:, :, 4:] / (one + other)[:, -1:, 4:], 1.0)
    white = np.linalg.solve(low[:, None], (delta / np.sqrt(np.repeat(older, 2, axis=2)))[..., None])[..., 0]
    variance, diagonal = 2.0 * method.unrelated_speed_m_s**2, np.einsum("aii->ai", low)
    place = -np.log(2.0 * np.pi * diagonal[:, 0] * diagonal[:, 1] * around)[:, None] - 0.5 * (white[..., :2] ** 2).sum(axis=2)
    course = np.log(variance / (diagonal[:, 2] * diagonal[:, 3]))[:, None] + 0.5 / variance * (delta[..., 2:] ** 2).sum(axis=2)
    course = np.minimum(course - 0.5 * (white[..., 2:] ** 2).sum(axis=2) - np.log(older[..., 1]), 600.0)
    mixed = np.log(method.misled_share + (1.0 - method.misled_share) * np.exp(course))
    step = np.where(there, np.clip(place - np.log(older[..., 0]) + mixed, -method.step_limit, method.step_limit), 0.0)
    out = np.zeros(len(one))
    for t in range(step.shape[1]):
        out = np.maximum(method.forgetting * out + step[:, t], -method.step_limit)
    return out


def one_to_one(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> Ints:
    """Indices of the pairs of the best assignment, a dense matrix a component that has more than one pair."""
    sources = int(tracks.source.max()) + 1
    _, row = np.unique(first * sources + tracks.source[second], return_inverse=True)
    _, column = np.unique(second * sources + tracks.source[first], return_inverse=True)
    rows, nodes = row.max() + 1, row.max() + column.max() + 2
    label = connected_components(coo_matrix((np.ones(len(row)), (row, column + rows)), (nodes, nodes)), directed=False)[1][row]
    order = np.argsort(label, kind="stable")
    start = np.concatenate([[0], np.flatnonzero(np.diff(label[order])) + 1, [len(order)]])
    taken = [order[start[:-1][np.diff(start) == 1]]]
    for k in np.flatnonzero(np.diff(start) > 1):
        pairs = order[start[k] : start[k + 1]]
        (firsts, i), (seconds, j) = (np.unique(of[pairs], return_inverse=True) for of in (row, column))
        matrix = np.zeros((len(firsts), len(seconds)))
        matrix[i, j] = gain[pairs]
        best = dict(zip(*linear_sum_assignment(matrix, maximize=True), strict=True))
        taken.append(pairs[[best.get(a) == b for a, b in zip(i, j, strict=True)]])
    return np.sort(np.concatenate(taken))


def step(method: WindowedCovariance, tracks: Tracks, windows: Floats, run: Callable[..., object]) -> int:
    """All of it, each part by run(name, work, *given). Returns: how many pairs are taken."""
    first, second = run("gate", gate, method, tracks)  # type: ignore[misc]
    score = run("score", scores, method, tracks, windows, first, second)
    keep = np.flatnonzero(score > method.threshold)  # type: ignore[operator]
    first, second, gain = first[keep], second[keep], score[keep] - method.threshold  # type: ignore[has-type, index]
    taken = run("one-to-one", one_to_one, tracks, first, second, gain)
    count, pairs = len(tracks), (first[taken], second[taken])  # type: ignore[index]
    run("vessels", connected_components, coo_matrix((np.ones(len(pairs[0])), pairs), (count, count)), False)
    return len(pairs[0])
