"""Radar tracks with a probability of existence, with and without AIS messages: the methods."""

from __future__ import annotations

from typing import Literal

from coastwatch.stage import Method
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.filter_bank import CompiledBank
from coastwatch.tracks.joint.association import JointAssociation, LiteralAssociation
from coastwatch.tracks.joint.existence import ExistenceManagement
from coastwatch.tracks.joint.messages import (
    MessageAssociation,
    MessageSettings,
    MessagesInTurn,
    NoisyMessages,
    in_order,
    positions_alone,
)
from coastwatch.tracks.motion import Manoeuvres, Motion
from coastwatch.tracks.region import RegionInput, RegionOutput, update_region
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

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = JointAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors)
        return update_region(tracker, memory, given)


class VimmjipdaLiteral(Method):
    """As `vimmjipda`, with the weights and the initiation of tracks as the paper prints them."""

    method: Literal["vimmjipda_literal"] = "vimmjipda_literal"
    motion: Motion = Motion()
    upkeep: ExistenceManagement = ExistenceManagement(confirm_existence=0.999)
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = LiteralAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors)
        return update_region(tracker, memory, given)


class SidedVimmjipda(Method):
    """As `vimmjipda`, with the models of `sided_imm`."""

    method: Literal["sided_vimmjipda"] = "sided_vimmjipda"
    motion: Manoeuvres = Manoeuvres()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=len(self.motion.models))

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = JointAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors)
        return update_region(tracker, memory, given)


class VimmjipdaSequential(Method):
    """As `vimmjipda`, with AIS messages as measurements, each at its own time: method A of Hem and Brekke.

    A track says whose messages are in it (`Tracks.held_mmsi`), so that its AIS track is not fused with it again.
    """

    method: Literal["vimmjipda_sequential"] = "vimmjipda_sequential"
    motion: Motion = Motion()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()
    messages: MessageSettings = MessageSettings()
    message_velocities: bool = True  # speed and course of messages are used; false: positions alone, as in the paper

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`."""
        tracker = MessageAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors, self.messages)
        used = given.messages if self.message_velocities else positions_alone(given.messages)
        take = MessagesInTurn(tracker.take_one_by_one, in_order(used, memory, self.upkeep.late_s))
        return update_region(tracker, memory, given, take_messages=take)


class VimmjipdaPreciseBatch(Method):
    """As `vimmjipda_sequential`, with the messages of one id since the last plots as one measurement: method B."""

    method: Literal["vimmjipda_precise_batch"] = "vimmjipda_precise_batch"
    motion: Motion = Motion()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()
    messages: MessageSettings = MessageSettings()
    message_velocities: bool = True  # speed and course of messages are used; false: positions alone, as in the paper

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """As of `VimmjipdaSequential`."""
        tracker = MessageAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors, self.messages)
        used = given.messages if self.message_velocities else positions_alone(given.messages)
        take = MessagesInTurn(tracker.take_clusters, in_order(used, memory, self.upkeep.late_s))
        return update_region(tracker, memory, given, take_messages=take)


class VimmjipdaNoisyBatch(Method):
    """As `vimmjipda_sequential`, with the newest message of each id as if it came with the next plots: method C."""

    method: Literal["vimmjipda_noisy_batch"] = "vimmjipda_noisy_batch"
    motion: Motion = Motion()
    upkeep: ExistenceManagement = ExistenceManagement()
    clutter: ClutterSettings = ClutterSettings()
    messages: NoisyMessages = NoisyMessages()
    message_velocities: bool = True  # speed and course of messages are used; false: positions alone, as in the paper

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=3)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """As of `VimmjipdaSequential`."""
        tracker = MessageAssociation(CompiledBank(self.motion), self.upkeep, self.clutter, given.sensors, self.messages)
        used = given.messages if self.message_velocities else positions_alone(given.messages)
        take = MessagesInTurn(tracker.take_newest, in_order(used, memory, self.upkeep.late_s))
        return update_region(tracker, memory, given, take_messages=take)
