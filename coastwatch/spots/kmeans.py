"""Spots by k-means on Earth-centred positions: centroids fitted by scikit-learn, each spot with a halo."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Spots, Struct, Tracks, column
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Count, CountOrZero, Method, NotNegative

SAMPLE_PER_SPOT = 20  # tracks that centroids are fitted to
NEIGHBOURS = 32  # nearest centroids of each centroid that are compared first
FIRST_STEPS, LATER_STEPS = 20, 2  # of Lloyd's algorithm: from k-means++, from the last centroids


@dataclass(frozen=True, eq=False)
class KMeansMemory(Struct):
    centre_m: Floats = column(np.float64, "K", 3)  # centroids; no row before the first cycle
    track_id: Ints = column(np.int64, "N")  # of the last cycle
    spot: Ints = column(np.int64, "N", rows_of="K")  # of each of them
    age: int = 0  # cycles since they were fitted


class KMeansSpots(Method):
    """Neighbouring tracks in spots around centroids, each spot with a halo of tracks near its border.

    A track is a member of the spot with the nearest centroid. Centroids are fitted to a sample of the tracks: by k-means++ from `seed`
    at the first cycle and whenever the number of spots changes, else every `fit_every` cycles from the last ones. With `count = 0`
    the number of spots changes only when it is off by more than a quarter. Tracks of one source alone are one spot. Because of the
    halo the pairs that the next stage finds do not depend on the spots.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, section III-D (there: centroids from 60 s ago, no halo).
    """

    method: Literal["kmeans"] = "kmeans"
    count: CountOrZero = 0  # spots; 0: about one for every `tracks_per_spot` tracks
    tracks_per_spot: Count = 400  # tracks
    halo_m: NotNegative = 1500.0  # at least the gate of the association; 0: no halo, as in the paper
    fit_every: Count = 20  # cycles
    seed: CountOrZero = 0  # whole number that k-means++ starts from

    def init(self) -> KMeansMemory:
        return KMeansMemory.empty()

    def step(self, memory: KMeansMemory, tracks: Tracks) -> tuple[KMeansMemory, Spots]:
        """Spots of these tracks. Args: tracks: (N). Returns: memory and Spots with K >= 1 spots unless there is no track."""
        if len(tracks) == 0:
            return memory, Spots.empty()
        position = kernels.geometry.ellipsoid.ecef_of_rows(tracks.position_deg, np.arange(len(tracks)))
        if (tracks.source == tracks.source[0]).all():  # tracks of one source are never compared with each other
            none = np.zeros(0, np.int64)
            return self.init(), Spots(position.mean(axis=0, keepdims=True), np.zeros(len(tracks), np.int64), none, none)
        count, centre, age = self._spots_for(len(tracks), len(memory.centre_m)), memory.centre_m, memory.age + 1
        if len(centre) != count:
            centre, age = self._fitted(position, tracks.track_id, count, None), 0
        elif age >= self.fit_every:
            centre, age = self._fitted(position, tracks.track_id, count, centre), 0
        spot, *halo = assigned(position, self._guess(memory, tracks, position, centre), centre, self.halo_m)
        return KMeansMemory(centre, tracks.track_id, spot, age), Spots(centre, spot, *halo)

    def _guess(self, memory: KMeansMemory, tracks: Tracks, position: Floats, centre: Floats) -> Ints:
        """A spot near each track: that of the last cycle, for a new track the nearest. Returns: (N,)."""
        from scipy.spatial import cKDTree

        before = kernels.tables.match_ids.index_of(memory.track_id, tracks.track_id)
        remembered = before >= 0 if len(memory.centre_m) == len(centre) else np.zeros(len(tracks), np.bool_)
        spot = np.zeros(len(tracks), np.int64)
        spot[remembered] = memory.spot[before[remembered]]
        spot[~remembered] = cKDTree(centre).query(position[~remembered])[1]
        return spot

    def _spots_for(self, tracks: int, before: int) -> int:
        """The number of spots. Args: tracks: N; before: the number of spots in the last cycle."""
        if self.count:
            return min(self.count, tracks)
        wanted = -(-tracks // self.tracks_per_spot)
        return before if before and abs(wanted - before) <= max(before // 4, 1) else wanted

    def _fitted(self, position: Floats, track_id: Ints, count: int, before: Floats | None) -> Floats:
        """Centroids of a sample of the positions, whatever their order. Args: (N, 3); before: (count, 3) to go on from."""
        size = min(SAMPLE_PER_SPOT * max(count, self.tracks_per_spot), len(position))
        chosen = np.random.default_rng([self.seed, 0]).choice(len(position), size, replace=False, shuffle=False)
        sample = position[np.argsort(track_id)[np.sort(chosen)]]
        if count == 1:
            mean: Floats = sample.mean(axis=0, keepdims=True)
            return mean
        # Imported here: it takes over a second, and a picture of one spot needs none of it.
        from sklearn.cluster import KMeans
        from threadpoolctl import threadpool_limits

        start, steps = ("k-means++", FIRST_STEPS) if before is None else (before, LATER_STEPS)
        fit = KMeans(count, init=start, n_init=1, max_iter=steps, random_state=self.seed)
        # One thread, because several threads add in a varying order.
        with threadpool_limits(1), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # fewer different positions than spots, or not converged: neither matters
            fitted: Floats = fit.fit(sample).cluster_centers_
        return fitted


def assigned(position: Floats, guess: Ints, centre: Floats, halo_m: float) -> tuple[Ints, Ints, Ints]:
    """The spot of each track, and the halos of the spots.

    Track b is within `halo_m` of a member a of spot j. Then b is at most 2 `halo_m` farther from the centroid of j than from its own: the
    distance of a to both differs from that of b by at most `halo_m`, and a is nearer to j. All such tracks are in the halo of j.
    Args: position: (N, 3), centre: (K, 3) Earth-centred; guess: (N,) a spot near each track, for speed alone.
    Returns: (N,) spots; (H,) spots and (H,) rows of the halos, sorted.
    """
    from scipy.spatial import cKDTree

    gap, near = cKDTree(centre).query(centre, k=np.arange(1, min(NEIGHBOURS, len(centre)) + 1))
    spot, margin = np.empty(len(position), np.int64), 2.0 * halo_m if halo_m > 0.0 else -1.0
    kernel = kernels.geometry.centroids.nearest_centroids
    parts = in_blocks(kernel, len(position), position, guess, centre, (near, gap), margin, spot)
    halo, row = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(halo * len(position) + row)
    return spot, halo[order], row[order]
