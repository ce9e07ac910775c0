"""What tracks were at the last p cycles, and how much they scattered in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats, Ints, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.lookup import find


@dataclass(frozen=True, eq=False)
class Window:
    """States of N tracks at the last p cycles, newest last."""

    time_s: Floats  # (p,) of the cycles; NaN before the first
    track_id: Ints  # (N,) sorted
    position_deg: Floats  # (N, p, 2) NaN before the first
    velocity_m_s: Floats  # (N, p, 2)

    @staticmethod
    def empty(p: int) -> Window:
        return Window(np.full(p, np.nan), np.zeros(0, np.int64), np.zeros((0, p, 2)), np.zeros((0, p, 2)))

    def extended(self, tracks: Tracks, time_s: float) -> Window:
        """The window one cycle later; tracks that are gone are forgotten. Args: tracks: (N) at `time_s`."""
        order = np.argsort(tracks.track_id, kind="stable")
        before = find(self.track_id, tracks.track_id[order])
        known = before >= 0
        rings = []
        for ring, value in ((self.position_deg, tracks.position_deg), (self.velocity_m_s, tracks.velocity_m_s)):
            out = np.full((len(order), *ring.shape[1:]), np.nan)
            out[known, :-1] = ring[before[known], 1:]
            out[:, -1] = value[order]
            rings.append(out)
        return Window(np.append(self.time_s[1:], time_s), tracks.track_id[order], rings[0], rings[1])

    def covariance(self, track_id: Ints, *, about_line: bool) -> Floats:
        """Sample covariance (divisor p - 1) of the last p states of tracks that are in the window, NaN where there are fewer.

        Args: about_line: of what is left of each component when its least-squares straight line in time is taken off; else, as
        eq. 7 has it, its mean alone. Returns: (N, 4, 4) of east, north, east rate, north rate.
        """
        row = find(self.track_id, track_id)
        newest = self.position_deg[row, -1:]
        metres = difference_m(self.position_deg[row], np.broadcast_to(newest, self.position_deg[row].shape))
        state = np.concatenate([metres, self.velocity_m_s[row]], axis=2)
        state = state - state.mean(axis=1, keepdims=True)
        if about_line:
            t = self.time_s - self.time_s.mean()
            state = state - t[:, None] * np.einsum("p,npk->nk", t, state)[:, None, :] / (t @ t)
        return np.asarray(np.einsum("npi,npj->nij", state, state) / (len(self.time_s) - 1))
