"""Radar tracks by interacting multiple models with a turn to each side and a change of speed."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import Measurements, Plots, Sensors, Tracks
from coastwatch.stage import Method
from coastwatch.tracks.manoeuvres import Manoeuvres
from coastwatch.tracks.table import RadarMemory
from coastwatch.tracks.upkeep import PlotOrigin, Upkeep


class SidedImm(Method):
    """As `imm`, but a model to each side of what turns, one of what changes speed, and a prior of when a motion ends.

    A turn is linearised about its rate, so one model for both sides believes too soon in the rate it began with.
    Source: see coastwatch/kernels/sided_motion.py.
    """

    method: Literal["sided_imm"] = "sided_imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Manoeuvres = Manoeuvres()
    upkeep: Upkeep = Upkeep()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(self.motion)

    def step(
        self, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
    ) -> tuple[RadarMemory, Tracks, Measurements]:
        """The confirmed tracks of one region at time_s; see `Imm.step`."""
        from coastwatch.tracks.management import track_region
        from coastwatch.tracks.sided_bank import SidedBank

        bank = SidedBank(self.motion.renewal_s, self.motion.table())
        given = self.motion, self.upkeep, self.plot_origin, bank, memory, plots, time_s
        return track_region(*given, sensors=sensors, region=region)
