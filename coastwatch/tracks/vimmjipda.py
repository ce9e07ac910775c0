"""Radar tracks with a probability of existence: the methods, joint integrated probabilistic data association with multiple models."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import Measurements, Plots, Sensors, Tracks
from coastwatch.stage import Method
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.existence import ExistenceManagement
from coastwatch.tracks.filter_bank import CompiledBank
from coastwatch.tracks.joint_association import JointAssociation
from coastwatch.tracks.motion import Manoeuvres, Motion
from coastwatch.tracks.region import track_region
from coastwatch.tracks.table import RadarMemory


class Vimmjipda(Method):
    """Visibility, interacting multiple models and joint integrated probabilistic data association: two constant velocities and a turn.

    Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements,
    Journal of Advances in Information Fusion 17(2), 2022, sections III to V, for radars alone.
    """

    method: Literal["vimmjipda"] = "vimmjipda"
    motion: Motion = Motion()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(
        self, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
    ) -> tuple[RadarMemory, Tracks, Measurements]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = JointAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, sensors)
        return track_region(tracker, memory, plots, time_s, sensors, region)


class SidedVimmjipda(Method):
    """As `vimmjipda`, with the models of `sided_imm`."""

    method: Literal["sided_vimmjipda"] = "sided_vimmjipda"
    motion: Manoeuvres = Manoeuvres()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=len(self.motion.models))

    def step(
        self, memory: RadarMemory, plots: Plots, time_s: float, sensors: Sensors, region: int
    ) -> tuple[RadarMemory, Tracks, Measurements]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = JointAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, sensors)
        return track_region(tracker, memory, plots, time_s, sensors, region)
