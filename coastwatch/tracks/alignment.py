"""Tracks of many centres, each at the time of its newest report, brought to the time of the picture."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import NotNegative, Settings


class ConstantVelocity(Settings):
    """Each track predicted at constant velocity, with the process noise of white acceleration.

    Tracks at the time of the picture, such as those of our own regional centres, are not changed.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 6.2.2.
    """

    method: Literal["constant_velocity"] = "constant_velocity"
    noise_m2_s3: NotNegative = 0.01  # density of the white acceleration

    def step(self, tracks: Tracks, time_s: float) -> Tracks:
        """The same tracks at `time_s`. Args: tracks: (N) each at its own time_s; a covariance of NaN stays NaN."""
        if bool((tracks.time_s == time_s).all()):
            return tracks
        moved, covariance = np.empty_like(tracks.position_deg), np.empty_like(tracks.covariance)
        states = tracks.position_deg, tracks.velocity_m_s, tracks.covariance
        advance, ahead_s = kernels.fusion.alignment.advance, time_s - tracks.time_s
        in_blocks(advance, len(tracks), ahead_s, states, self.noise_m2_s3, moved, covariance)
        return replace(tracks, time_s=np.full(len(tracks), float(time_s)), position_deg=moved, covariance=covariance)
