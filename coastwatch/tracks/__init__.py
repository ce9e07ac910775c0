"""Plots, AIS reports and bearings into tracks: the methods of the stage, one union for each kind of source.

To add a method: write a module with a `Method` that has `init` and the `step` of its siblings (`imm.py` for radars), and add it to a
union below. `tests/contracts` then tests the method without further code.
"""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.ais import AisFilter
from coastwatch.tracks.ais_dead_reckoning import AisDeadReckoning
from coastwatch.tracks.alignment import ConstantVelocity
from coastwatch.tracks.bearing import BearingWindow
from coastwatch.tracks.imm import FilterpyImm, Imm, SidedImm
from coastwatch.tracks.joint.messages import messages_of
from coastwatch.tracks.joint.particles import BpParticles
from coastwatch.tracks.joint.vimmjipda import (
    SidedVimmjipda,
    Vimmjipda,
    VimmjipdaLiteral,
    VimmjipdaNoisyBatch,
    VimmjipdaPreciseBatch,
    VimmjipdaSequential,
)
from coastwatch.tracks.received import ReceivedTracks
from coastwatch.tracks.region import RegionInput, RegionOutput
from coastwatch.tracks.table import RadarMemory

TrackerWithAis = VimmjipdaSequential | VimmjipdaPreciseBatch | VimmjipdaNoisyBatch | BpParticles
JointTracker = Vimmjipda | SidedVimmjipda | VimmjipdaLiteral | TrackerWithAis
RadarTracker = Annotated[SidedImm | Imm | FilterpyImm | JointTracker, Field(discriminator="method")]
AisTracker = Annotated[AisFilter | AisDeadReckoning, Field(discriminator="method")]
BearingTracker = Annotated[BearingWindow, Field()]
TrackAligner = Annotated[ConstantVelocity, Field()]
TrackReceiver = Annotated[ReceivedTracks, Field()]

__all__ = [
    "AisDeadReckoning",
    "AisFilter",
    "AisTracker",
    "BearingTracker",
    "BearingWindow",
    "ConstantVelocity",
    "FilterpyImm",
    "Imm",
    "RadarMemory",
    "RadarTracker",
    "ReceivedTracks",
    "RegionInput",
    "RegionOutput",
    "SidedImm",
    "TrackAligner",
    "TrackReceiver",
    "TrackerWithAis",
    "messages_of",
]
