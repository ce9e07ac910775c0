"""What a region asks of its association in a cycle, and the answers of those that decide at once."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from coastwatch.batches import Floats, Ints, Messages
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.stage import Settings
from coastwatch.tracks.radar.messages import WithMessages, leave
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory

LOOKS = 3  # of a radar, for which plots contradict messages until a track leaves them: filters lag behind a turn


class PlotAssociation(Settings):
    """Which plots belong to which track. A subclass adds `method`, `track_batch` and `end_cycle`, and replaces what differs.

    `track_batch(parts, memory, batch)` returns the memory, and the slot of the track that took each plot of a batch, -1 for none.
    `end_cycle(parts, memory, time_s)` returns the memory after the last batch, without tracks that are one vessel with another.
    """

    upkeep: ClassVar[str]  # the method of `upkeep` that its tracks need
    by_radar: ClassVar[bool] = True  # each batch is of one radar
    banks: ClassVar[tuple[str, ...]] = ()  # the methods of `bank` that it works with; none: all that have this upkeep
    messages: ClassVar[tuple[str, ...]] = ()  # the methods of `messages` that it works with; none: all

    def take_messages(
        self, parts: Parts, rules: WithMessages, memory: RadarMemory, messages: Messages, until_s: float
    ) -> RadarMemory:
        """The memory after these messages. Args: messages: (M,) sorted by time; until_s: time of the plots that follow."""
        return rules.take(parts, memory, messages, until_s)

    def leave_messages(
        self, parts: Parts, rules: WithMessages, memory: RadarMemory, since_s: float, time_s: float
    ) -> RadarMemory:
        """The memory after tracks have left messages that contradict their plots. Args: since_s: as of `leave`."""
        leave(rules, parts, memory, since_s, time_s, LOOKS)
        return memory

    def end_slice(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """The memory after the looks that are over. Args: time_s: of the newest plot, or now."""
        return parts.upkeep.end_slice(memory, parts.radars(memory), parts.ours, parts.sensors.radars, time_s)

    def predict(self, parts: Parts, memory: RadarMemory, slots: Ints, time_s: float) -> tuple[Estimates, Floats]:
        """The tracks in these slots (N), predicted to a time, and how far from there another likely place is, m; none: each is sure."""
        table = memory.table
        return parts.bank.predict(table.filters, table.estimates, slots, time_s), np.zeros(0)
