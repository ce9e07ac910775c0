"""Which vessels each radar should see, and which sensors are heard: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.cover.disc import DiscCover as DiscCover
from coastwatch.cover.inputs import CoverInput as CoverInput, CoverOutput as CoverOutput, SilenceInput as SilenceInput
from coastwatch.cover.learnt import CoverMemory, LearntCover as LearntCover
from coastwatch.cover.silence import SilenceMemory as SilenceMemory, UsualPauses as UsualPauses
from coastwatch.stage import NoMemory

RadarCoverage = Annotated[LearntCover | DiscCover, Field(discriminator="method")]
RadarCoverageMemory = CoverMemory | NoMemory
