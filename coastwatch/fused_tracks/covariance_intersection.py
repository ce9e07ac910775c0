"""Fused tracks by covariance intersection: consistent whatever the correlation between the tracks."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Rows, Tracks
from coastwatch.fused_tracks.membership import Grouped, at_time, states, unwritten
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
        groups = Grouped(*associations.by_vessel)
        everyone, out = np.arange(len(groups), dtype=np.int32), unwritten(len(groups))
        intersected(groups, everyone, tracks, self.unknown_velocity_sigma_m_s, self.steps, out)
        return memory, at_time(time_s, out)


def intersected(
    groups: Grouped, which: Rows, tracks: Tracks, velocity_sigma_m_s: float, steps: int, out: tuple[Floats, Floats, Floats]
) -> None:
    """These vessels (B,) by covariance intersection of their tracks, into their rows of `out`."""

    in_blocks(
        kernels.fusion.covariance_intersection.intersection,
        len(which),
        which,
        *groups,
        states(tracks),
        velocity_sigma_m_s,
        steps,
        out,
    )
