"""Which vessels each radar should see: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.cover.disc import DiscCover
from coastwatch.cover.learnt import LearntCover

RadarCoverage = Annotated[LearntCover | DiscCover, Field(discriminator="method")]

__all__ = ["DiscCover", "LearntCover", "RadarCoverage"]
