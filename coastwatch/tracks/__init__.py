"""Plots, AIS reports and bearings into tracks: the methods of the stage, one union for each kind of source."""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.ais import AisFilter
from coastwatch.tracks.ais_dead_reckoning import AisDeadReckoning
from coastwatch.tracks.alignment import ConstantVelocity
from coastwatch.tracks.bearing import BearingWindow
from coastwatch.tracks.imm import FilterpyImm, Imm, SidedImm

RadarTracker = Annotated[SidedImm | Imm | FilterpyImm, Field(discriminator="method")]
AisTracker = Annotated[AisFilter | AisDeadReckoning, Field(discriminator="method")]
BearingTracker = Annotated[BearingWindow, Field()]
TrackAligner = Annotated[ConstantVelocity, Field()]

__all__ = [
    "AisDeadReckoning",
    "AisFilter",
    "AisTracker",
    "BearingTracker",
    "BearingWindow",
    "ConstantVelocity",
    "FilterpyImm",
    "Imm",
    "RadarTracker",
    "SidedImm",
    "TrackAligner",
]
