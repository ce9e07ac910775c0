"""The tracks of each vessel combined one after the other, the most precise first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coastwatch.batches import Floats, FusedTracks, Ints, Tracks
from coastwatch.fused_tracks.membership import rounds
from coastwatch.geodesy import difference_m, offset_deg

Combine = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
"""(first (G, 4, 4), second (G, 4, 4), second less first (G, 4)) -> mean relative to the first (G, 4), covariance (G, 4, 4)."""


def combined(tracks: Tracks, covariance: Floats, vessel: Ints, time_s: float, combine: Combine) -> FusedTracks:
    """One estimate a vessel. Args: tracks: (N); covariance: (N, 4, 4); vessel: (N,) of each track, 0..V-1. Returns: (V)."""
    precise_first = np.argsort(np.argsort(np.linalg.det(covariance), kind="stable"), kind="stable")
    plan = rounds(vessel, precise_first)
    if not plan:
        return FusedTracks.empty()
    _, row = plan[0]
    position, velocity, fused = tracks.position_deg[row], tracks.velocity_m_s[row], covariance[row]
    for who, row in plan[1:]:
        moved, faster = difference_m(tracks.position_deg[row], position[who]), tracks.velocity_m_s[row] - velocity[who]
        mean, fused[who] = combine(fused[who], covariance[row], np.concatenate([moved, faster], axis=1))
        position[who] = offset_deg(position[who], mean[:, :2])
        velocity[who] = velocity[who] + mean[:, 2:]
    return FusedTracks(np.full(len(position), float(time_s)), position, velocity, fused)
