"""Clusters of trees and their leaves, small ones at random and vessels that meet, for tests and timings of the global hypothesis."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints

Given = tuple[Ints, Floats, Ints]
"""First leaf of each tree (T + 1,), costs (L,) and resources (L, m) of the leaves, -1: none."""


def forest(seed: int, trees: int, most: int, resources: int, integer: bool = False) -> Given:
    """Trees of random leaves that want up to three of a few resources; the more they have, the less they cost."""
    rng = np.random.default_rng([seed, 17])
    start = np.concatenate([[0], np.cumsum(rng.integers(1, most + 1, trees))])
    leaves = int(start[-1])
    resource = np.argsort(rng.random((leaves, resources)), axis=1)[:, :3]
    resource[rng.random(resource.shape) < 0.4] = -1
    gain = rng.normal(5.0, 3.0, resource.shape) * (resource >= 0)
    cost = -gain.sum(axis=1)
    return start, np.round(cost) if integer else cost, resource


def meeting(seed: int, trees: int) -> Given:
    """Vessels round a point: the 20 best leaves of each, by the distances of plots of three looks; a plot is worth 6, a miss costs 2."""
    rng = np.random.default_rng([seed, 19])
    place = rng.normal(0.0, 60.0, (trees, 2))
    cost, resource = np.zeros((trees, 1)), np.zeros((trees, 1, 0), np.int64)
    for look in range(3):
        plots = place + rng.normal(0.0, 20.0, place.shape)
        square = ((place[:, None] - plots) ** 2).sum(axis=2) / 20.0**2
        of_look = np.concatenate([0.5 * square - 6.0, np.full((trees, 1), 2.0)], axis=1)
        cost = (cost[:, :, None] + of_look[:, None]).reshape(trees, -1)
        plot = np.append(np.arange(trees) + look * trees, -1)
        resource = np.concatenate(
            [np.repeat(resource, trees + 1, axis=1), np.tile(plot, resource.shape[1])[None, :, None].repeat(trees, 0)], axis=2
        )
        best = np.argsort(cost, axis=1, kind="stable")[:, :20]
        cost, resource = np.take_along_axis(cost, best, 1), np.take_along_axis(resource, best[:, :, None], 1)
    return np.arange(0, 20 * trees + 1, 20), cost.ravel(), resource.reshape(-1, 3)
