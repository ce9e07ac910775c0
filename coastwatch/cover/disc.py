"""No cover is learnt: a radar should see every vessel within its range."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch.batches import AisDetection, Associations, Bools, Measurements, Plots, RadarCover, Sensors, Tracks
from coastwatch.stage import Method, NoMemory


class DiscCover(Method):
    """A radar should see every vessel within its range."""

    method: Literal["disc"] = "disc"

    def init(self) -> NoMemory:
        return NoMemory()

    def step(
        self,
        memory: NoMemory,
        plots: Plots,
        tracks: Tracks,
        associations: Associations,
        measurements: Measurements,
        alarmed: Bools,
        jumped: Bools,
        sensors: Sensors,
        *,
        silent: Bools | None = None,
    ) -> tuple[NoMemory, RadarCover, AisDetection]:
        """Unchanged memory, no grid, and probability 1 for each AIS track. Args: as of `LearntCover.step`."""
        ids = tracks.track_id[tracks.source == sensors.ais_source]
        return memory, RadarCover.empty(), AisDetection(ids, np.ones(len(ids)))
