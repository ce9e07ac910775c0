"""Radar tracks by filterpy's IMMEstimator, one object a track: slow, and the reference that `imm` must equal to rounding."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import Measurements, Plots, Sensors, Tracks
from coastwatch.stage import Method
from coastwatch.tracks.motion import Motion
from coastwatch.tracks.table import RadarMemory
from coastwatch.tracks.upkeep import PlotOrigin, Upkeep


class FilterpyImm(Method):
    """As `imm`, with the same gates and upkeep; a track's filters are filterpy's objects at work, arrays in memory."""

    method: Literal["filterpy_imm"] = "filterpy_imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Motion = Motion()
    upkeep: Upkeep = Upkeep()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(self.motion)

    def step(
        self, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
    ) -> tuple[RadarMemory, Tracks, Measurements]:
        """The confirmed tracks of one region at time_s; see `Imm.step`."""
        from coastwatch.tracks.filterpy_bank import ObjectBank
        from coastwatch.tracks.management import track_region

        bank = ObjectBank(self.motion.parameters())
        given = self.motion, self.upkeep, self.plot_origin, bank, memory, plots, time_s
        return track_region(*given, sensors=sensors, region=region)
