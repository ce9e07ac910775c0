"""Fused tracks with the cross-covariance of their errors, found by its exact recursion."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, FusedTracks, Ints, Tracks
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import Estimates, VesselTracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances
from coastwatch.stage import Positive


class Dependent(FusionMethod):
    """The best linear combination of the tracks of a vessel whose errors share process noise.

    The recursion is exact for tracks of Kalman filters with the process noise `noise_m2_s3`. Tracks of other filters, or aligned in
    time, come near. It begins with no correlation when two tracks become one vessel. Where the result is not a covariance, the
    tracks of that vessel count as independent.

    Source: Y. Bar-Shalom and L. Campo, The effect of the common process noise on the two-sensor fused-track covariance, 1986; for
    three tracks and more K. C. Chang, R. K. Saha, Y. Bar-Shalom, On optimal track-to-track fusion, 1997.
    """

    method: Literal["dependent"] = "dependent"
    noise_m2_s3: Positive = 0.09  # density of the white acceleration of vessels
    unknown_velocity_sigma_m_s: Positive = 0.5  # of a source that gives no covariance

    def init(self) -> CrossCovariances:
        return CrossCovariances.empty()

    def step(self, memory: CrossCovariances, given: FusionInput) -> tuple[CrossCovariances, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        vessels, tracks = VesselTracks.of(given.associations), given.tracks
        row = kernels.tables.counting_sort.preferred(*vessels, -tracks.source).astype(np.int64)
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        sizes = [int(n) for n in np.unique(vessels.size)]
        groups = [row[vessels.start[:-1][vessels.size == n][:, None] + np.arange(n)] for n in sizes]
        pairs = [_pairs(group) for group in groups]
        joined = tuple(np.concatenate([np.zeros(0, np.int64), *(pair[k].ravel() for pair in pairs)]) for k in (0, 1))
        after = memory.advanced(
            tracks.track_id, covariance, tracks.updated_s, (joined[0], joined[1]), float(given.time_s), self.noise_m2_s3
        )
        out, begin = Estimates.empty(vessels.vessel_count), 0
        for n, group, (first, _) in zip(sizes, groups, pairs, strict=True):
            cross = after.cross[begin : begin + first.size].reshape(*first.shape, 4, 4)
            begin += first.size
            _combine(np.flatnonzero(vessels.size == n), group, tracks, covariance[group], cross, out)
        return after, out.at_time(given.time_s)


def _pairs(group: Ints) -> tuple[Ints, Ints]:
    """First and second track of every pair of each vessel. Args: (B, n) tracks. Returns: (B, n (n - 1) / 2) each."""
    a, b = np.triu_indices(group.shape[1], 1)
    return group[:, a], group[:, b]


def _combine(vessel: Ints, group: Ints, tracks: Tracks, own: Floats, cross: Floats, out: Estimates) -> None:
    """Write the estimates of vessels of n tracks.

    Args: vessel: (B,); group: (B, n) rows of tracks; own: (B, n, 4, 4) covariances; cross: (B, n (n - 1) / 2, 4, 4).
    """
    count, n = group.shape
    lead = tracks.position_deg[group[:, 0]]
    if n == 1:
        out.position_deg[vessel], out.velocity_m_s[vessel], out.covariance[vessel] = (
            lead,
            tracks.velocity_m_s[group[:, 0]],
            own[:, 0],
        )
        return
    east_north = difference_m(tracks.position_deg[group].reshape(-1, 2), np.repeat(lead, n, axis=0)).reshape(count, n, 2)
    state = np.concatenate([east_north, tracks.velocity_m_s[group]], axis=2)
    joint = np.zeros((count, n, n, 4, 4))
    for k, (a, b) in enumerate(zip(*np.triu_indices(n, 1), strict=True)):
        joint[:, a, b], joint[:, b, a] = cross[:, k], cross[:, k].transpose(0, 2, 1)
    joint[:, np.arange(n), np.arange(n)] = own
    mean, covariance = _best(joint, state)
    out.position_deg[vessel] = offset_deg(lead, mean[:, :2])
    out.velocity_m_s[vessel], out.covariance[vessel] = mean[:, 2:], covariance


def _best(joint: Floats, state: Floats) -> tuple[Floats, Floats]:
    """The estimate of least variance of B states, each seen n times. Args: joint: (B, n, n, 4, 4) covariance; state: (B, n, 4)."""
    count, n = state.shape[:2]
    dense = joint.transpose(0, 1, 3, 2, 4).reshape(count, 4 * n, 4 * n)
    wrong: Bools = ~kernels.fusion.cross_covariance.positive(dense)
    blocks = np.kron(np.eye(n), np.ones((4, 4)))
    dense[wrong] *= blocks
    weight = np.linalg.solve(dense, np.tile(np.eye(4), (count, n, 1)))  # S^-1 G, (B, 4 n, 4)
    covariance = np.linalg.inv(weight.reshape(count, n, 4, 4).sum(axis=1))
    mean = (covariance @ weight.transpose(0, 2, 1) @ state.reshape(count, 4 * n, 1))[..., 0]
    return mean, 0.5 * (covariance + covariance.transpose(0, 2, 1))
