"""What tracks were at the last W cycles: rows are tracks, so that differences of any pair can be made on the fly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats, Ints, Tracks
from coastwatch.kernels.lookup import find


@dataclass(frozen=True, eq=False)
class History:
    """Windows of N tracks, newest last, sorted by track_id."""

    track_id: Ints  # (N,)
    position_deg: Floats  # (N, W, 2)
    velocity_m_s: Floats  # (N, W, 2)
    variance: Floats  # (N, W, 2) traces of the covariances of position (m2) and velocity (m2/s2)
    length: Ints  # (N,) valid entries, at the end

    @staticmethod
    def empty(window: int) -> History:
        none = np.zeros(0, np.int64)
        return History(none, np.zeros((0, window, 2)), np.zeros((0, window, 2)), np.zeros((0, window, 2)), none)

    def extended(self, tracks: Tracks, variance: Floats) -> History:
        """The windows after this cycle, rows in the order of `tracks`; tracks that are gone are forgotten.

        Args: tracks: (N); variance: (N, 2) traces of the covariances of position and velocity of each.
        """
        window = self.position_deg.shape[1]
        row = find(self.track_id, tracks.track_id)
        known = row >= 0
        safe = np.where(known, row, 0) if len(self.track_id) else np.zeros(len(tracks), np.int64)
        new = [tracks.position_deg, tracks.velocity_m_s, variance]
        rings = []
        for ring, value in zip((self.position_deg, self.velocity_m_s, self.variance), new, strict=True):
            out = np.zeros((len(tracks), *ring.shape[1:]))
            if len(ring):
                out[:, :-1] = ring[safe, 1:]
            out[:, -1] = value
            rings.append(out)
        before = np.where(known, self.length[safe], 0) if len(self.length) else np.zeros(len(tracks), np.int64)
        length = np.minimum(before + 1, window).astype(np.int64)
        return History(tracks.track_id, rings[0], rings[1], rings[2], length)

    def sorted(self) -> History:
        """The same rows by track_id, as `find` needs them."""
        order = np.argsort(self.track_id, kind="stable")
        return History(
            self.track_id[order],
            self.position_deg[order],
            self.velocity_m_s[order],
            self.variance[order],
            self.length[order],
        )
