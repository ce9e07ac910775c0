"""The feeds: sources of reports. A scenario's `input.method` chooses one of the union `Feed`."""

from typing import Annotated

from pydantic import Field

from coastwatch.sensors.live_feeds import NO_INPUT as NO_INPUT, LiveFeeds as LiveFeeds
from coastwatch.sensors.recorded.datasets.autoferry import Autoferry as Autoferry
from coastwatch.sensors.recorded.datasets.solent import Solent as Solent
from coastwatch.sensors.recorded.nmea.feed import Nmea as Nmea
from coastwatch.sensors.recorded.tables.ais import AisTable as AisTable
from coastwatch.sensors.recorded.tables.feed import Tables as Tables
from coastwatch.sensors.recorded.video.feed import VideoFiles as VideoFiles
from coastwatch.sensors.simulated.crossing import Crossing as Crossing
from coastwatch.sensors.simulated.simulation import Simulated as Simulated
from coastwatch.sensors.simulated.start_states import StartStates as StartStates
from coastwatch.sensors.simulated.video import SimulatedVideo as SimulatedVideo

Feed = Annotated[
    Simulated
    | Nmea
    | AisTable
    | Tables
    | Autoferry
    | Solent
    | Crossing
    | StartStates
    | SimulatedVideo
    | VideoFiles
    | LiveFeeds,
    Field(discriminator="method"),
]
SIMULATIONS = (Simulated, Crossing, StartStates, SimulatedVideo)
"""Feeds without a time of their own: they may begin now."""


def has_video(feed: Feed) -> bool:
    """Whether there may be radar video in the reports of a feed."""
    return isinstance(feed, SimulatedVideo | VideoFiles) or (isinstance(feed, Tables) and feed.has_video())
