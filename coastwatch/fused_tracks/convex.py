"""Fused tracks by convex combination: the best estimate where the errors of the tracks are independent."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, FusedTracks, Ints, Tracks
from coastwatch.fused_tracks.membership import rounds
from coastwatch.geodesy import difference_m, offset_deg
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
        self, memory: NoMemory, tracks: Tracks, associations: Associations, time_s: float, kinds: Ints
    ) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel. Args: tracks: (N); associations: of its rows; kinds: SourceKind of each source.

        Returns: memory and FusedTracks, one row for each vessel number.
        """
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        together = np.bincount(associations.vessel, minlength=1)[associations.vessel] > 1
        doubted = together & (tracks.mmsi < 0)
        covariance[doubted, :2, :2] += self.registration * tracks.report_covariance[doubted]
        plan = rounds(associations.vessel, np.argsort(np.argsort(np.linalg.det(covariance), kind="stable"), kind="stable"))
        if not plan:
            return memory, FusedTracks.empty()
        _, row = plan[0]
        position, velocity, fused = tracks.position_deg[row], tracks.velocity_m_s[row], covariance[row]
        for who, row in plan[1:]:
            shift = np.concatenate(
                [difference_m(tracks.position_deg[row], position[who]), tracks.velocity_m_s[row] - velocity[who]], axis=1
            )
            gain = np.linalg.solve(fused[who] + covariance[row], fused[who]).swapaxes(1, 2)
            mean = np.einsum("gij,gj->gi", gain, shift)
            less = fused[who] - gain @ fused[who]
            fused[who] = 0.5 * (less + less.swapaxes(1, 2))
            position[who] = offset_deg(position[who], mean[:, :2])
            velocity[who] = velocity[who] + mean[:, 2:]
        return memory, FusedTracks(np.full(len(position), float(time_s)), position, velocity, fused)
