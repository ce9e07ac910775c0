"""Radar video to plots in polar coordinates: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.plots.video.absolute import AbsoluteExtraction
from coastwatch.plots.video.blobs import BlobExtraction
from coastwatch.plots.video.cfar import CfarExtraction
from coastwatch.plots.video.spokes import ExtractionInput, ExtractionMemory, over_background

PlotExtractor = Annotated[CfarExtraction | AbsoluteExtraction | BlobExtraction, Field(discriminator="method")]

__all__ = [
    "AbsoluteExtraction",
    "BlobExtraction",
    "CfarExtraction",
    "ExtractionInput",
    "ExtractionMemory",
    "PlotExtractor",
    "over_background",
]
