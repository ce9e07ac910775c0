"""Which tracks are compared with which: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.spots.inputs import OctantInput as OctantInput
from coastwatch.spots.kmeans import KMeansMemory as KMeansMemory, KMeansSpots as KMeansSpots
from coastwatch.spots.octants import OctantSpots as OctantSpots

SpotGrouper = Annotated[KMeansSpots, Field()]
OctantGrouper = Annotated[OctantSpots, Field()]
