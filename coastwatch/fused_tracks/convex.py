"""Fused tracks by convex combination: the best estimate where the errors of the tracks are independent."""

from __future__ import annotations

from typing import Literal

from coastwatch import kernels
from coastwatch.batches import FusedTracks
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import VesselTracks, estimated
from coastwatch.stage import NoMemory, NotNegative, Positive


class Convex(FusionMethod):
    """Each track weighed by the inverse of its covariance, position and velocity together, cross-covariance neglected.

    `registration` adds that share of a radar report's covariance to the position covariance of a radar track. So a radar bias as
    large as the specified noise does not outweigh a good AIS position.

    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 9.3.3 (P12 = 0 in eq. 12 and 13 of the paper).
    """

    method: Literal["convex"] = "convex"
    registration: NotNegative = 0.0  # share of a radar report's covariance that is added
    unknown_velocity_sigma_m_s: Positive = 0.5

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: FusionInput) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        vessels, kernel = VesselTracks.of(given.associations), kernels.fusion.convex_combination.convex
        out = estimated(kernel, vessels, given.tracks, self.unknown_velocity_sigma_m_s, self.registration)
        return memory, out.at_time(given.time_s)
