"""Fused tracks by covariance intersection: consistent whatever the correlation between the tracks."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks
from coastwatch.fused_tracks.pairwise import combined
from coastwatch.stage import Method, NoMemory


class CovarianceIntersection(Method):
    """Pairwise covariance intersection with the weight that makes the determinant smallest, most precise track first.

    Source: S. J. Julier and J. K. Uhlmann, A non-divergent estimation algorithm in the presence of unknown correlations, 1997.
    """

    method: Literal["covariance_intersection"] = "covariance_intersection"
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5
    steps: Annotated[int, Field(ge=4, le=60)] = 16  # of the golden-section search of the weight

    def init(self) -> NoMemory:
        return NoMemory()

    def step(
        self,
        memory: NoMemory,
        tracks: Tracks,
        measurements: Measurements,
        associations: Associations,
        time_s: float,
        kinds: Ints,
    ) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel. Args: tracks: (N); measurements: unused; associations: of its rows; kinds: SourceKind of each source.

        Returns: memory and FusedTracks, one row for each vessel number.
        """
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        return memory, combined(
            tracks, covariance, associations.vessel, time_s, lambda a, b, shift: intersect(a, b, shift, self.steps)
        )


def intersect(first: Floats, second: Floats, shift: Floats, steps: int) -> tuple[Floats, Floats]:
    """Mean (relative to the first) and covariance of the intersection of estimates whose determinant is smallest.

    Args: first, second: (G, 4, 4); shift: (G, 4) second less first; steps: of the search. Returns: (G, 4), (G, 4, 4).
    """
    inverse_1, inverse_2 = np.linalg.inv(first), np.linalg.inv(second)
    ratio = (np.sqrt(5.0) - 1.0) / 2.0

    def log_det(w: Floats) -> Floats:
        blend = w[:, None, None] * inverse_1 + (1.0 - w)[:, None, None] * inverse_2
        return np.asarray(-np.linalg.slogdet(blend)[1])

    low, high = np.zeros(len(first)), np.ones(len(first))
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = log_det(left), log_det(right)
    for _ in range(steps):
        down = at_left < at_right
        low, high = np.where(down, low, left), np.where(down, right, high)
        kept, value = np.where(down, left, right), np.where(down, at_left, at_right)
        probe = np.where(down, high - ratio * (high - low), low + ratio * (high - low))
        at_probe = log_det(probe)
        left, right = np.where(down, probe, kept), np.where(down, kept, probe)
        at_left, at_right = np.where(down, at_probe, value), np.where(down, value, at_probe)
    candidates = np.stack([0.5 * (low + high), np.zeros(len(first)), np.ones(len(first))])
    best = np.argmin(np.stack([log_det(w) for w in candidates]), axis=0)
    w = candidates[best, np.arange(len(first))]
    out = np.linalg.inv(w[:, None, None] * inverse_1 + (1.0 - w)[:, None, None] * inverse_2)
    out = 0.5 * (out + out.swapaxes(1, 2))
    mean = np.einsum("gij,gjk,gk->gi", out, (1.0 - w)[:, None, None] * inverse_2, shift)
    return mean, out
