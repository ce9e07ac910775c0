"""Radar tracks by interacting multiple models, all tracks of a region at once."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import Measurements, Plots, Sensors, Tracks
from coastwatch.stage import Method
from coastwatch.tracks.motion import Motion
from coastwatch.tracks.table import RadarMemory
from coastwatch.tracks.upkeep import PlotOrigin, Upkeep


class Imm(Method):
    """Plots of all radars of a region in order of time, global nearest neighbour, IMM filters compiled by numba.

    Source: H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching
    coefficients, IEEE Trans. AC 33(8), 1988.
    """

    method: Literal["imm"] = "imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Motion = Motion()
    upkeep: Upkeep = Upkeep()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(self.motion)

    def step(
        self, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
    ) -> tuple[RadarMemory, Tracks, Measurements]:
        """The confirmed tracks of one region at time_s.

        Args: plots: of this region, that arrived in this cycle; region: its number.
        Returns: memory; tracks predicted to time_s, sorted by track_id, which is never reused; the plots that they took.
        Raises: ValueError where the memory is of a scenario with other radars.
        """
        from coastwatch.tracks.compiled_bank import CompiledBank
        from coastwatch.tracks.management import track_region

        bank = CompiledBank(self.motion.parameters())
        given = self.motion, self.upkeep, self.plot_origin, bank, memory, plots, time_s
        return track_region(*given, sensors=sensors, region=region)
