"""Which tracks are compared with which: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.spots.kmeans import KMeansSpots
from coastwatch.spots.octants import OctantSpots

SpotGrouper = Annotated[KMeansSpots, Field()]
OctantGrouper = Annotated[OctantSpots, Field()]

__all__ = ["KMeansSpots", "OctantGrouper", "OctantSpots", "SpotGrouper"]
