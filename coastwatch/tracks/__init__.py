"""Plots, AIS reports and bearings into tracks: the methods of the stage, one union for each kind of source.

To add a method: write a module with a `Method` that has `init` and the `step` of its siblings, and add it to a union below. To add a part
of the radar tracker: write its module and add it to the union of its folder. `tests/tracks` then tests it without further code.
"""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.ais.ais_filter import AisFilter as AisFilter
from coastwatch.tracks.ais.antenna import Antennas as Antennas, HullMiddle as HullMiddle
from coastwatch.tracks.ais.dead_reckoning import AisDeadReckoning as AisDeadReckoning
from coastwatch.tracks.ais.out_of_sequence import AisMemory as AisMemory
from coastwatch.tracks.alignment import ConstantVelocity as ConstantVelocity
from coastwatch.tracks.bearing import BearingMemory as BearingMemory, BearingWindow as BearingWindow
from coastwatch.tracks.inputs import (
    AisInput as AisInput,
    AisOutput as AisOutput,
    BearingInput as BearingInput,
    ReceivedInput as ReceivedInput,
)
from coastwatch.tracks.radar.imm_jpda_literal.memory import ImmJpdaMemory as ImmJpdaMemory
from coastwatch.tracks.radar.imm_jpda_literal.tracker import ImmJpdaLiteral as ImmJpdaLiteral
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import ForestMemory as ForestMemory
from coastwatch.tracks.radar.multi_hypothesis_literal.tracker import MultiHypothesisLiteral as MultiHypothesisLiteral
from coastwatch.tracks.radar.region import RegionInput as RegionInput, RegionOutput as RegionOutput
from coastwatch.tracks.radar.repulsive_particles.memory import ParticlesMemory as ParticlesMemory
from coastwatch.tracks.radar.repulsive_particles.tracker import RepulsiveParticles as RepulsiveParticles
from coastwatch.tracks.radar.table import RadarMemory as RadarMemory
from coastwatch.tracks.radar.tracker import TableTracker as TableTracker
from coastwatch.tracks.received import ReceivedMemory as ReceivedMemory, ReceivedTracks as ReceivedTracks

RadarTracker = Annotated[
    TableTracker | ImmJpdaLiteral | RepulsiveParticles | MultiHypothesisLiteral, Field(discriminator="method")
]
AisPositions = Annotated[HullMiddle, Field()]
AisTracker = Annotated[AisFilter | AisDeadReckoning, Field(discriminator="method")]
BearingTracker = Annotated[BearingWindow, Field()]
TrackAligner = Annotated[ConstantVelocity, Field()]
TrackReceiver = Annotated[ReceivedTracks, Field()]
