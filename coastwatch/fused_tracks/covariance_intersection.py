"""Fused tracks by covariance intersection: consistent whatever the correlation between the tracks."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import FusedTracks, Tracks
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import Estimates, VesselTracks, estimated
from coastwatch.stage import NoMemory, Positive


class CovarianceIntersection(FusionMethod):
    """Pairwise covariance intersection with the weight that makes the determinant smallest, most precise track first.

    Source: S. J. Julier and J. K. Uhlmann, A non-divergent estimation algorithm in the presence of unknown correlations, 1997.
    """

    method: Literal["covariance_intersection"] = "covariance_intersection"
    unknown_velocity_sigma_m_s: Positive = 0.5
    steps: Annotated[int, Field(ge=4, le=60)] = 16  # steps of the golden-section search of the weight

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: FusionInput) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        vessels = VesselTracks.of(given.associations)
        return memory, intersect(vessels, given.tracks, self.unknown_velocity_sigma_m_s, self.steps).at_time(given.time_s)


def intersect(vessels: VesselTracks, tracks: Tracks, velocity_sigma_m_s: float, steps: int) -> Estimates:
    """Vessels by covariance intersection of their tracks.

    Args: velocity_sigma_m_s: of tracks without covariance; steps: of the search of the weight.
    """
    return estimated(kernels.fusion.covariance_intersection.intersection, vessels, tracks, velocity_sigma_m_s, steps)
