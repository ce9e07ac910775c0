"""How radar tracks take AIS messages: the methods, one union.

To add one, write a module with a struct of `MessageSettings` that has `take`, and add it to the union.
"""

from typing import Annotated, Literal

from pydantic import Field

from coastwatch.stage import Settings
from coastwatch.tracks.radar.messages.guiding import Guiding as Guiding
from coastwatch.tracks.radar.messages.noisy_batch import NoisyBatch as NoisyBatch
from coastwatch.tracks.radar.messages.precise_batch import PreciseBatch as PreciseBatch
from coastwatch.tracks.radar.messages.sequential import Sequential as Sequential
from coastwatch.tracks.radar.messages.settings import in_order as in_order, messages_of as messages_of
from coastwatch.tracks.radar.messages.trust import leave as leave, trusted as trusted
from coastwatch.tracks.radar.messages.weighing import begin_unnamed as begin_unnamed


class NoMessages(Settings):
    """Radar tracks are made of plots alone."""

    method: Literal["none"] = "none"


WithMessages = Guiding | Sequential | PreciseBatch | NoisyBatch
MessageUpdate = Annotated[NoMessages | WithMessages, Field(discriminator="method")]
