"""Which plots belong to which track: the methods of association, one union.

To add one, write a module with a `PlotAssociation` that has `track_batch` and `end_cycle`, and add it to the union.
"""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.radar.association.jipda import Jipda as Jipda, JipdaLiteral as JipdaLiteral
from coastwatch.tracks.radar.association.jpda import Jpda as Jpda
from coastwatch.tracks.radar.association.known_origin import KnownOrigin as KnownOrigin
from coastwatch.tracks.radar.association.nearest_neighbour import NearestNeighbour as NearestNeighbour
from coastwatch.tracks.radar.multi_hypothesis import MultiHypothesis as MultiHypothesis

AnyAssociation = NearestNeighbour | KnownOrigin | Jpda | Jipda | JipdaLiteral | MultiHypothesis
Association = Annotated[AnyAssociation, Field(discriminator="method")]
