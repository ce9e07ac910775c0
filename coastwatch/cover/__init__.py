"""Which vessels each radar should see, and which sensors are heard: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.cover.disc import DiscCover
from coastwatch.cover.inputs import CoverInput, CoverOutput, SilenceInput
from coastwatch.cover.learnt import CoverMemory, LearntCover
from coastwatch.cover.silence import SilenceMemory, UsualPauses
from coastwatch.stage import NoMemory

RadarCoverage = Annotated[LearntCover | DiscCover, Field(discriminator="method")]
RadarCoverageMemory = CoverMemory | NoMemory

__all__ = [
    "CoverInput",
    "CoverOutput",
    "DiscCover",
    "LearntCover",
    "RadarCoverage",
    "RadarCoverageMemory",
    "SilenceInput",
    "SilenceMemory",
    "UsualPauses",
]
