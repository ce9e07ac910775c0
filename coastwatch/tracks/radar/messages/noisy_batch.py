"""Method C of Hem and Brekke: the newest AIS message of each id as if it came with the next plots."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Messages
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.messages.weighing import take_at_once
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory


class NoisyBatch(MessageSettings):
    """The newest AIS message of each id since the last plots, taken at the time of the plots that follow: method C.

    Of a paper, for comparison.
    """

    method: Literal["noisy_batch"] = "noisy_batch"
    sigma_m: Annotated[float, Field(gt=0.0)] = 8.0  # per axis, in place of their own noise: they are older than the plots

    def take(self, parts: Parts, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """The memory after these messages, as if they were of this time."""
        order = np.argsort(messages.mmsi, kind="stable")
        newest = order[np.diff(messages.mmsi[order], append=-1) != 0]
        ids, size = np.unique(messages.mmsi, return_counts=True)
        messages = messages.take(np.sort(newest))
        noise = np.tile(self.sigma_m**2 * np.eye(2), (len(messages), 1, 1))
        now = replace(messages, time_s=np.full(len(messages), until_s), covariance=noise)
        return take_at_once(parts, self, memory, now, size[np.searchsorted(ids, now.mmsi)])
