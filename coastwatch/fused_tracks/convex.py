"""Fused tracks by convex combination: the best estimate where the errors of the tracks are independent."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks
from coastwatch.fused_tracks.pairwise import combined
from coastwatch.stage import Method, NoMemory


class Convex(Method):
    """Each track weighed by the inverse of its covariance, position and velocity together, cross-covariance neglected.

    `registration` adds that share of a radar report's covariance to the position of a radar track before it is weighed, so that a
    bias of the radar as large as its specification does not pull the vessel off a good AIS position.

    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 9.3.3 (P12 = 0 in eq. 12 and 13 of the paper).
    """

    method: Literal["convex"] = "convex"
    registration: Annotated[float, Field(ge=0.0)] = 0.0
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5

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
        together = np.bincount(associations.vessel, minlength=1)[associations.vessel] > 1
        doubted = together & (tracks.mmsi < 0)
        covariance[doubted, :2, :2] += self.registration * tracks.report_covariance[doubted]
        return memory, combined(tracks, covariance, associations.vessel, time_s, weigh)


def weigh(first: Floats, second: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Mean (relative to the first) and covariance of two estimates with independent errors.

    Args: first, second: (G, 4, 4); shift: (G, 4) second less first. Returns: (G, 4), (G, 4, 4).
    """
    gain = np.linalg.solve(first + second, first).swapaxes(1, 2)
    less = first - gain @ first
    return np.einsum("gij,gj->gi", gain, shift), 0.5 * (less + less.swapaxes(1, 2))
