"""Which plots belong to which track: the methods of association, one union.

To add one, write a module with a struct that has `track_batch` and `end_cycle`, and add it to the union.
"""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.radar.association.jipda import Jipda, JipdaLiteral
from coastwatch.tracks.radar.association.known_origin import KnownOrigin
from coastwatch.tracks.radar.association.nearest_neighbour import NearestNeighbour

Association = Annotated[NearestNeighbour | KnownOrigin | Jipda | JipdaLiteral, Field(discriminator="method")]

__all__ = ["Association", "Jipda", "JipdaLiteral", "KnownOrigin", "NearestNeighbour"]
