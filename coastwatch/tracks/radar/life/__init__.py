"""How radar tracks begin to count and end: settings of `[tracks.upkeep]`, one union."""

from typing import Annotated

from pydantic import Field

from coastwatch.tracks.radar.life.existence import Detection as Detection, ExistenceManagement as ExistenceManagement
from coastwatch.tracks.radar.life.hits import TrackManagement as TrackManagement

Upkeep = Annotated[TrackManagement | ExistenceManagement, Field(discriminator="method")]
