"""Fused tracks by covariance intersection: consistent whatever the correlation between the tracks."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Associations, FusedTracks, Ints, Measurements, Tracks, VesselBearings
from coastwatch.fused_tracks.vessel_tracks import NO_BEARINGS, Estimates, TrackArrays, VesselTracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Method, NoMemory


class CovarianceIntersection(Method):
    """Pairwise covariance intersection with the weight that makes the determinant smallest, most precise track first.

    Source: S. J. Julier and J. K. Uhlmann, A non-divergent estimation algorithm in the presence of unknown correlations, 1997.
    """

    method: Literal["covariance_intersection"] = "covariance_intersection"
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5
    steps: Annotated[int, Field(ge=4, le=60)] = 16  # steps of the golden-section search of the weight

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
        bearings: VesselBearings = NO_BEARINGS,
    ) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel.

        Args: tracks: (N); measurements, bearings: unused; associations: of its rows; kinds: SourceKind of each source.
        Returns: memory and FusedTracks, one row for each vessel number.
        """
        vessels = VesselTracks.of(associations)
        return memory, intersect(vessels, tracks, self.unknown_velocity_sigma_m_s, self.steps).at_time(time_s)


def intersect(vessels: VesselTracks, tracks: Tracks, velocity_sigma_m_s: float, steps: int) -> Estimates:
    """Vessels by covariance intersection of their tracks.

    Args: velocity_sigma_m_s: of tracks without covariance; steps: of the search of the weight.
    """
    out = Estimates.empty(vessels.vessel_count)
    settings = velocity_sigma_m_s, steps
    kernel = kernels.fusion.covariance_intersection.intersection
    in_blocks(kernel, vessels.vessel_count, *vessels, TrackArrays.of(tracks), *settings, out)
    return out
