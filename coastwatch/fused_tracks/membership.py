"""The tracks of each vessel one after the other, and the arrays that the kernels take of them and give back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats, FusedTracks, Rows, Tracks


class Grouped(NamedTuple):
    """The tracks of vessel v are row[start[v]:start[v + 1]]."""

    start: Rows  # (V + 1,)
    row: Rows  # (N,)

    def __len__(self) -> int:
        return len(self.start) - 1


def states(tracks: Tracks) -> tuple[Floats, Floats, Floats, Floats]:
    """What the kernels read of tracks."""
    return tracks.position_deg, tracks.velocity_m_s, tracks.covariance, tracks.report_covariance


def unwritten(vessels: int) -> tuple[Floats, Floats, Floats]:
    """What the kernels write: position, velocity and covariance of so many vessels."""
    return np.empty((vessels, 2)), np.empty((vessels, 2)), np.empty((vessels, 4, 4))


def at_time(time_s: float, out: tuple[Floats, Floats, Floats]) -> FusedTracks:
    """The vessels that were written, at one time."""
    return FusedTracks(np.full(len(out[0]), float(time_s)), *out)
