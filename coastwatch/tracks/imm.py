"""Radar tracks by interacting multiple models: the methods, all tracks of a region at once."""

from __future__ import annotations

from typing import Literal

from coastwatch.stage import Method
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.filter_bank import CompiledBank
from coastwatch.tracks.motion import Manoeuvres, Motion
from coastwatch.tracks.plot_association import NearestNeighbour
from coastwatch.tracks.region import RegionInput, RegionOutput, update_region
from coastwatch.tracks.table import RadarMemory
from coastwatch.tracks.track_management import PlotOrigin, TrackManagement


class Imm(Method):
    """Plots of all radars of a region in order of time, global nearest neighbour, IMM filters compiled by numba.

    Source: H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching
    coefficients, IEEE Trans. AC 33(8), 1988.
    """

    method: Literal["imm"] = "imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Motion = Motion()
    upkeep: TrackManagement = TrackManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region at time_s.

        Raises: ValueError where the memory is of a scenario with other radars.
        """
        tracker = NearestNeighbour(CompiledBank(self.motion), self.upkeep, self.plot_origin, self.clutter, given.sensors)
        return update_region(tracker, memory, given, by_radar=self.plot_origin != "known")


class SidedImm(Method):
    """As `imm`, but a model to each side of what turns, one of what changes speed, and a prior of when a motion ends.

    A turn is linearised about its rate, so one model for both sides believes too soon in the rate it began with.
    Source: see coastwatch/kernels/filters/imm.py.
    """

    method: Literal["sided_imm"] = "sided_imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Manoeuvres = Manoeuvres()
    upkeep: TrackManagement = TrackManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=len(self.motion.models))

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region at time_s; see `Imm.step`."""
        tracker = NearestNeighbour(CompiledBank(self.motion), self.upkeep, self.plot_origin, self.clutter, given.sensors)
        return update_region(tracker, memory, given, by_radar=self.plot_origin != "known")


class FilterpyImm(Method):
    """As `imm`, with the same gates and upkeep, by filterpy: one IMMEstimator a track, slow, the reference for `imm`."""

    method: Literal["filterpy_imm"] = "filterpy_imm"
    plot_origin: PlotOrigin = "estimated"
    motion: Motion = Motion()
    upkeep: TrackManagement = TrackManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region at time_s; see `Imm.step`."""
        from coastwatch.tracks.filterpy_bank import FilterpyBank  # filterpy is slow to import, and few runs use it

        tracker = NearestNeighbour(FilterpyBank(self.motion), self.upkeep, self.plot_origin, self.clutter, given.sensors)
        return update_region(tracker, memory, given, by_radar=self.plot_origin != "known")
