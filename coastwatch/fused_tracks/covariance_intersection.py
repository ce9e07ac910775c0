"""Fused tracks by covariance intersection: consistent whatever the correlation between the tracks."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Rows, Tracks
from coastwatch.fused_tracks.membership import Grouped, at_time, by_vessel, states, unwritten
from coastwatch.kernels.threads import in_blocks
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
        groups = by_vessel(associations.vessel)
        everyone = np.arange(len(groups), dtype=np.int32)
        return memory, at_time(time_s, intersected(groups, everyone, tracks, self.unknown_velocity_sigma_m_s, self.steps))


def intersected(
    groups: Grouped, which: Rows, tracks: Tracks, velocity_sigma_m_s: float, steps: int
) -> tuple[Floats, Floats, Floats]:
    """Position (B, 2), velocity (B, 2) and covariance (B, 4, 4) of these vessels (B,) by covariance intersection of their tracks."""
    from coastwatch.kernels.fusing import intersection

    out = unwritten(len(which))
    in_blocks(intersection, len(which), which, *groups, states(tracks), velocity_sigma_m_s, steps, out)
    return out
