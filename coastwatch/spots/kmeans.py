"""Spots by k-means on Earth-centred positions: seeded, warm-started, with a halo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Spots, Tracks
from coastwatch.stage import Method

SAMPLE_A_SPOT = 20  # tracks that seeds are sought among: more fit no better after a warm step or two
COLD_STEPS = 20  # of Lloyd on that sample
CELL_DEG = 0.02


@dataclass(frozen=True, eq=False)
class KMeansMemory:
    centre_m: Floats  # (K, 3) of the last cycle; no row before the first
    track_id: Ints  # (N,) of the last cycle
    spot: Ints  # (N,) of each of them: where the search begins; it decides how long that takes, not what it finds
    age: int = 0  # cycles since the centroids were last fitted to the tracks


class KMeansSpots(Method):
    """Neighbouring tracks in spots around centroids, each spot with a halo of tracks within reach of its border.

    k-means++ from `seed`, on a sample, at the first cycle and whenever the number of spots changes; one warm Lloyd step from the
    last centroids at every other cycle, or every `fit_every` cycles. Where the number follows that of the tracks it changes only when
    it is off by more than a quarter, so that births and deaths do not start all spots anew. Because of the halo the pairs that the
    next stage finds do not depend on the spots.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, section III-D (there: random start, no halo).
    """

    method: Literal["kmeans"] = "kmeans"
    count: Annotated[int, Field(ge=0)] = 0  # spots; 0: about one for every `tracks_per_spot` tracks
    tracks_per_spot: Annotated[int, Field(ge=1)] = 400
    halo_m: Annotated[float, Field(ge=0.0)] = 1500.0  # not under the gate of the association; 0: none, as in the paper
    warm_steps: Annotated[int, Field(ge=0)] = 1  # Lloyd steps a cycle; 0 keeps the centroids of the first cycle
    fit_every: Annotated[int, Field(ge=1)] = 1  # cycles from one such step to the next: centroids grow so old
    seed: Annotated[int, Field(ge=0)] = 0

    def init(self) -> KMeansMemory:
        none = np.zeros(0, np.int64)
        return KMeansMemory(np.zeros((0, 3)), none, none)

    def step(self, memory: KMeansMemory, tracks: Tracks) -> tuple[KMeansMemory, Spots]:
        """Spots of these tracks. Args: tracks: (N). Returns: memory and Spots with K >= 1 spots unless there is no track."""

        if len(tracks) == 0:
            none = np.zeros(0, np.int64)
            return memory, Spots(np.zeros((0, 3)), none, none, none)
        count, centre, age = self._spots_for(len(tracks), len(memory.centre_m)), memory.centre_m, memory.age + 1
        steps = 0
        if len(centre) != count:
            centre, age = self._cold(tracks.position_deg, count), 0
            guess, unknown = np.zeros(len(tracks), np.int64), np.arange(len(tracks))
        else:
            at = kernels.tables.match_ids.index_of(memory.track_id, tracks.track_id)
            guess, unknown = memory.spot[at], np.flatnonzero(at < 0)
            if age >= self.fit_every:
                steps, age = self.warm_steps, 0
        if len(unknown):
            guess[unknown] = _near(tracks.position_deg, unknown, centre)
        laid = kernels.geometry.centroids.lay(tracks.position_deg, guess, count)
        for _ in range(steps):
            centre = kernels.geometry.centroids.means(laid, centre)
        spot, halo_spot, halo_row = kernels.geometry.centroids.divided(laid, centre, self.halo_m)
        return KMeansMemory(centre, tracks.track_id, spot, age), Spots(centre, spot, halo_spot, halo_row)

    def _spots_for(self, tracks: int, before: int) -> int:
        """How many spots so many tracks are given, where there were so many before."""
        if self.count:
            return min(self.count, tracks)
        wanted = -(-tracks // self.tracks_per_spot)
        return before if before and abs(wanted - before) <= max(before // 4, 1) else wanted

    def _cold(self, position_deg: Floats, count: int) -> Floats:
        """Centroids of a sample of these positions, the same whatever was before. Args: (N, 2). Returns: (count, 3)."""

        rng = np.random.default_rng([self.seed, 0])
        size = min(SAMPLE_A_SPOT * max(count, self.tracks_per_spot), len(position_deg))
        rows = np.sort(rng.choice(len(position_deg), size, replace=False, shuffle=False))
        points = kernels.geometry.ellipsoid.ecef_of_rows(position_deg, rows).T
        along = np.argsort(points[np.ptp(points, axis=1).argmax()], kind="stable")
        points, rows = np.ascontiguousarray(points[:, along]), rows[along]
        seed, nearest = kernels.geometry.seeding.seeds(points, rng.random(count))
        centre = np.ascontiguousarray(points[:, seed].T)
        laid = kernels.geometry.centroids.lay(position_deg[rows], nearest, count)
        for _ in range(COLD_STEPS):
            centre = kernels.geometry.centroids.means(laid, centre)
        return centre


def _near(position_deg: Floats, rows: Ints, centre: Floats) -> Ints:
    """A centroid near each of these rows, the nearest to some track of its cell: good enough to begin a search."""
    from scipy.spatial import cKDTree

    cell = np.floor(position_deg[rows] / CELL_DEG).astype(np.int64) @ np.array([1 << 32, 1])
    _, some, of = np.unique(cell, return_index=True, return_inverse=True)
    nearest = np.asarray(cKDTree(centre).query(kernels.geometry.ellipsoid.ecef_of_rows(position_deg, rows[some]))[1], np.int64)
    return nearest[of]
