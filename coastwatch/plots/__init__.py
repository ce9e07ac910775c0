"""Radar reports as points of a region's plane: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.plots.polar import PolarConversion, PolarMemory

PlotConverter = Annotated[PolarConversion, Field()]

__all__ = ["PlotConverter", "PolarConversion", "PolarMemory"]
