"""Spots by k-means on Earth-centred positions: seeded, warm-started, with a halo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Floats, Ints, Spots, Tracks
from coastwatch.geodesy import earth_centred
from coastwatch.stage import Method


@dataclass(frozen=True, eq=False)
class KMeansMemory:
    centre_m: Floats  # (K, 3) of the last cycle; no row before the first
    age: int = 0  # cycles since they were last fitted to the tracks


class KMeansSpots(Method):
    """Neighbouring tracks in spots around centroids, each spot with a halo of tracks within reach of its border.

    k-means++ from `seed` at the first cycle and whenever the number of spots changes; one warm Lloyd step from the last
    centroids at every other cycle, or every `fit_every` cycles. Because of the halo the pairs that the next stage finds do not
    depend on the spots.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, section III-D (there: random start, no halo).
    """

    method: Literal["kmeans"] = "kmeans"
    count: Annotated[int, Field(ge=0)] = 0  # spots; 0: one for every `tracks_per_spot` tracks
    tracks_per_spot: Annotated[int, Field(ge=1)] = 400
    halo_m: Annotated[float, Field(ge=0.0)] = 1500.0  # not under the gate of the association; 0: none, as in the paper
    warm_steps: Annotated[int, Field(ge=0)] = 1  # Lloyd steps a cycle; 0 keeps the centroids of the first cycle
    fit_every: Annotated[int, Field(ge=1)] = 1  # cycles from one such step to the next: centroids grow so old
    seed: Annotated[int, Field(ge=0)] = 0

    def init(self) -> KMeansMemory:
        return KMeansMemory(np.zeros((0, 3)))

    def step(self, memory: KMeansMemory, tracks: Tracks) -> tuple[KMeansMemory, Spots]:
        """Spots of these tracks. Args: tracks: (N). Returns: memory and Spots with K >= 1 spots unless there is no track."""
        points = earth_centred(tracks.position_deg)
        count = min(self.count or int(np.ceil(len(tracks) / self.tracks_per_spot)), len(tracks))
        if count == 0:
            none = np.zeros(0, np.int64)
            return memory, Spots(np.zeros((0, 3)), none, none, none)
        centre, age = memory.centre_m, memory.age + 1
        if len(centre) != count:
            centre, age = self._cold(points, count), 0
        elif age >= self.fit_every:
            age = 0
            for _ in range(self.warm_steps):
                centre = _means(points, _nearest(points, centre), centre)
        spot = _nearest(points, centre)
        halo_spot, halo_row = _halo(points, centre, spot, self.halo_m)
        return KMeansMemory(centre, age), Spots(centre, spot, halo_spot, halo_row)

    def _cold(self, points: Floats, count: int) -> Floats:
        if count == 1:
            return np.asarray(points.mean(0, keepdims=True))
        from sklearn.cluster import KMeans

        shift = points.mean(0)
        found = KMeans(count, init="k-means++", n_init=1, max_iter=50, random_state=self.seed).fit(points - shift)
        centre: Floats = np.asarray(found.cluster_centers_, np.float64) + shift
        return centre


def _nearest(points: Floats, centre: Floats) -> Ints:
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(centre).query(points)[1], np.int64)


def _means(points: Floats, spot: Ints, centre: Floats) -> Floats:
    """Mean of the points of each spot; an empty spot keeps its centre."""
    size = np.bincount(spot, minlength=len(centre))
    total = np.stack([np.bincount(spot, points[:, k], minlength=len(centre)) for k in range(3)], axis=1)
    return np.where(size[:, None] > 0, total / np.maximum(size, 1)[:, None], centre)


def _halo(points: Floats, centre: Floats, spot: Ints, reach_m: float) -> tuple[Ints, Ints]:
    """Spots, other than its own, whose cell may hold a point within reach of each point: (H,) spot and (H,) row, sorted.

    If x lies in cell A and y in cell B, no farther apart than r, then y is no farther than r from the plane between the centres
    of A and B, and |y - A| <= |y - B| + 2 r: both are necessary, so that no pair within reach is lost.
    """
    from scipy.spatial import cKDTree

    tree, own = cKDTree(centre), np.linalg.norm(points - centre[spot], axis=1)
    near = min(8, len(centre))
    while True:
        found = tree.query(points, k=np.arange(1, near + 1))
        distance, index = np.asarray(found[0]), np.asarray(found[1])
        within = distance <= (own + 2.0 * reach_m)[:, None]
        if near == len(centre) or not within[:, -1].any():
            break
        near = min(near * 2, len(centre))
    row, column = np.nonzero(within & (index != spot[:, None]))
    other = index[row, column]
    gap = np.linalg.norm(centre[other] - centre[spot[row]], axis=1)
    to_border = (distance[row, column] ** 2 - own[row] ** 2) / (2.0 * np.maximum(gap, 1e-9))
    keep = (to_border <= reach_m) | (gap == 0.0)
    order = np.lexsort((row[keep], other[keep]))
    return other[keep][order].astype(np.int64), row[keep][order].astype(np.int64)
