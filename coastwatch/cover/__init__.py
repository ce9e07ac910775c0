"""Which vessels each radar should see, and which sensors are heard: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.cover.disc import DiscCover
from coastwatch.cover.learnt import LearntCover
from coastwatch.cover.silence import UsualPauses

RadarCoverage = Annotated[LearntCover | DiscCover, Field(discriminator="method")]

__all__ = ["DiscCover", "LearntCover", "RadarCoverage", "UsualPauses"]
