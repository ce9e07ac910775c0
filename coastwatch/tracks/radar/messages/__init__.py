"""How radar tracks take AIS messages: the methods, one union.

To add one, write a module with a struct of `MessageSettings` that has `take`, and add it to the union.
"""

from typing import Annotated, Literal

from pydantic import Field

from coastwatch.stage import Settings
from coastwatch.tracks.radar.messages.guiding import Guiding
from coastwatch.tracks.radar.messages.noisy_batch import NoisyBatch
from coastwatch.tracks.radar.messages.precise_batch import PreciseBatch
from coastwatch.tracks.radar.messages.sequential import Sequential
from coastwatch.tracks.radar.messages.settings import in_order, messages_of
from coastwatch.tracks.radar.messages.trust import leave, trusted
from coastwatch.tracks.radar.messages.weighing import begin_unnamed


class NoMessages(Settings):
    """Radar tracks are made of plots alone."""

    method: Literal["none"] = "none"


WithMessages = Guiding | Sequential | PreciseBatch | NoisyBatch
MessageUpdate = Annotated[NoMessages | WithMessages, Field(discriminator="method")]

__all__ = [
    "Guiding",
    "MessageUpdate",
    "NoMessages",
    "NoisyBatch",
    "PreciseBatch",
    "Sequential",
    "WithMessages",
    "begin_unnamed",
    "in_order",
    "leave",
    "messages_of",
    "trusted",
]
