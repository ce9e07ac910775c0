"""Radar video as plots, and plots as points of a region's plane: the methods of both stages."""

from typing import Annotated

from pydantic import Field

from coastwatch.plots.azimuths import HeadingMemory as HeadingMemory, true_azimuths as true_azimuths, true_video as true_video
from coastwatch.plots.polar import PolarConversion as PolarConversion, PolarMemory as PolarMemory
from coastwatch.plots.video import (
    CfarExtraction as CfarExtraction,
    ExtractionInput as ExtractionInput,
    ExtractionMemory as ExtractionMemory,
    PlotExtractor as PlotExtractor,
    over_background as over_background,
)

PlotConverter = Annotated[PolarConversion, Field()]
