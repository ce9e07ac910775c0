"""No cover is learnt: a radar should see every vessel within its range."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch.batches import AisDetection, RadarCover
from coastwatch.cover.inputs import CoverInput, CoverOutput
from coastwatch.stage import Method, NoMemory


class DiscCover(Method):
    """A radar should see every vessel within its range."""

    method: Literal["disc"] = "disc"

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: CoverInput) -> tuple[NoMemory, CoverOutput]:
        """Unchanged memory, no grid, and probability 1 for each AIS track."""
        ids = given.tracks.track_id[given.tracks.source == given.sensors.ais_source]
        return memory, CoverOutput(RadarCover.empty(), AisDetection(ids, np.ones(len(ids))))
