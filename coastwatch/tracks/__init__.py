"""Plots, AIS reports and bearings into tracks: the methods of the stage, one union for each kind of source.

To add a method: write a module with a `Method` that has `init` and the `step` of its siblings, and add it to a union below. To add a part
of the radar tracker: write its module and add it to the union of its folder. `tests/tracks` then tests it without further code.
"""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.ais.ais_filter import AisFilter
from coastwatch.tracks.ais.antenna import Antennas, HullMiddle
from coastwatch.tracks.ais.dead_reckoning import AisDeadReckoning
from coastwatch.tracks.ais.out_of_sequence import AisMemory
from coastwatch.tracks.alignment import ConstantVelocity
from coastwatch.tracks.bearing import BearingMemory, BearingWindow
from coastwatch.tracks.inputs import AisInput, AisOutput, BearingInput, ReceivedInput
from coastwatch.tracks.radar.imm_jpda_literal.memory import ImmJpdaMemory
from coastwatch.tracks.radar.imm_jpda_literal.tracker import ImmJpdaLiteral
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import ForestMemory
from coastwatch.tracks.radar.multi_hypothesis_literal.tracker import MultiHypothesisLiteral
from coastwatch.tracks.radar.region import RegionInput, RegionOutput
from coastwatch.tracks.radar.repulsive_particles.memory import ParticlesMemory
from coastwatch.tracks.radar.repulsive_particles.tracker import RepulsiveParticles
from coastwatch.tracks.radar.table import RadarMemory
from coastwatch.tracks.radar.tracker import TableTracker
from coastwatch.tracks.received import ReceivedMemory, ReceivedTracks

RadarTracker = Annotated[
    TableTracker | ImmJpdaLiteral | RepulsiveParticles | MultiHypothesisLiteral, Field(discriminator="method")
]
AisPositions = Annotated[HullMiddle, Field()]
AisTracker = Annotated[AisFilter | AisDeadReckoning, Field(discriminator="method")]
BearingTracker = Annotated[BearingWindow, Field()]
TrackAligner = Annotated[ConstantVelocity, Field()]
TrackReceiver = Annotated[ReceivedTracks, Field()]

__all__ = [
    "AisDeadReckoning",
    "AisFilter",
    "AisInput",
    "AisMemory",
    "AisOutput",
    "AisPositions",
    "AisTracker",
    "Antennas",
    "BearingInput",
    "BearingMemory",
    "BearingTracker",
    "BearingWindow",
    "ConstantVelocity",
    "ForestMemory",
    "HullMiddle",
    "ImmJpdaLiteral",
    "ImmJpdaMemory",
    "MultiHypothesisLiteral",
    "ParticlesMemory",
    "RadarMemory",
    "RadarTracker",
    "ReceivedInput",
    "ReceivedMemory",
    "ReceivedTracks",
    "RegionInput",
    "RegionOutput",
    "RepulsiveParticles",
    "TableTracker",
    "TrackAligner",
    "TrackReceiver",
]
