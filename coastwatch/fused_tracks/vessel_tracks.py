"""The tracks of each vessel, and the arrays that the kernels of fusion take and write."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Rows, Tracks
from coastwatch.kernels.threads import in_blocks


class VesselTracks(NamedTuple):
    """Which tracks each vessel has: vessel v the rows row[start[v]:start[v + 1]]. Every vessel has one or more."""

    start: Rows  # (V + 1,)
    row: Rows  # (N,)

    @classmethod
    def of(cls, associations: Associations) -> VesselTracks:
        return cls(*associations.by_vessel)

    @property
    def vessel_count(self) -> int:
        """V, the number of vessels."""
        return len(self.start) - 1

    @property
    def size(self) -> Rows:
        """Tracks of each vessel. (V,)"""
        return np.diff(self.start)

    def take(self, vessels: Ints | Rows) -> VesselTracks:
        """These vessels (B,), in this order."""
        size = self.size[vessels]
        start = np.append(0, np.cumsum(size)).astype(np.int32)
        entry = np.arange(start[-1]) + np.repeat(self.start[vessels] - start[:-1], size)
        return VesselTracks(start, self.row[entry])


class Estimates(NamedTuple):
    """Estimates of V vessels, as the kernels write them."""

    position_deg: Floats  # (V, 2)
    velocity_m_s: Floats  # (V, 2)
    covariance: Floats  # (V, 4, 4)

    @classmethod
    def empty(cls, vessels: int) -> Estimates:
        """Of so many vessels, with no value yet."""
        return cls(np.empty((vessels, 2)), np.empty((vessels, 2)), np.empty((vessels, 4, 4)))

    def at_time(self, time_s: float) -> FusedTracks:
        return FusedTracks(np.full(len(self.position_deg), float(time_s)), *self)


class TrackArrays(NamedTuple):
    """What the kernels read of N tracks."""

    position_deg: Floats  # (N, 2)
    velocity_m_s: Floats  # (N, 2)
    covariance: Floats  # (N, 4, 4)
    report_covariance: Floats  # (N, 2, 2)
    mmsi: Ints  # (N,)

    @classmethod
    def of(cls, tracks: Tracks) -> TrackArrays:
        return cls(tracks.position_deg, tracks.velocity_m_s, tracks.covariance, tracks.report_covariance, tracks.mmsi)


def estimated(
    kernel: Callable[..., None], vessels: VesselTracks, tracks: Tracks, sigma_m_s: float, setting: object
) -> Estimates:
    """The estimates that a kernel of fusion makes of these vessels, over threads.

    Args: sigma_m_s: of the velocity of tracks without covariance; setting: of the kernel.
    """
    out, arrays = Estimates.empty(vessels.vessel_count), TrackArrays.of(tracks)
    in_blocks(kernel, vessels.vessel_count, vessels.start, vessels.row, arrays, sigma_m_s, setting, out)
    return out
