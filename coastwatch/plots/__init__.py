"""Radar video as plots, and plots as points of a region's plane: the methods of both stages."""

from typing import Annotated

from pydantic import Field

from coastwatch.plots.azimuths import HeadingMemory, true_azimuths, true_video
from coastwatch.plots.polar import PolarConversion, PolarMemory
from coastwatch.plots.video import CfarExtraction, ExtractionInput, ExtractionMemory, PlotExtractor, over_background

PlotConverter = Annotated[PolarConversion, Field()]

__all__ = [
    "CfarExtraction",
    "ExtractionInput",
    "ExtractionMemory",
    "HeadingMemory",
    "PlotConverter",
    "PlotExtractor",
    "PolarConversion",
    "PolarMemory",
    "over_background",
    "true_azimuths",
    "true_video",
]
