"""Radar video to plots in polar coordinates: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.plots.video.absolute import AbsoluteExtraction as AbsoluteExtraction
from coastwatch.plots.video.blobs import BlobExtraction as BlobExtraction
from coastwatch.plots.video.cfar import CfarExtraction as CfarExtraction
from coastwatch.plots.video.spokes import (
    ExtractionInput as ExtractionInput,
    ExtractionMemory as ExtractionMemory,
    over_background as over_background,
)

PlotExtractor = Annotated[CfarExtraction | AbsoluteExtraction | BlobExtraction, Field(discriminator="method")]
