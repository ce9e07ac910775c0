"""Which tracks are compared with which: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.spots.inputs import OctantInput
from coastwatch.spots.kmeans import KMeansMemory, KMeansSpots
from coastwatch.spots.octants import OctantSpots

SpotGrouper = Annotated[KMeansSpots, Field()]
OctantGrouper = Annotated[OctantSpots, Field()]

__all__ = ["KMeansMemory", "KMeansSpots", "OctantGrouper", "OctantInput", "OctantSpots", "SpotGrouper"]
