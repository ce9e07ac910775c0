"""What every tracker of plots says about itself, unless it differs."""

from __future__ import annotations

from coastwatch.batches import Floats, Measurements, Messages, Sensors, Tracks
from coastwatch.stage import Method


class RadarMethod(Method):
    """A tracker that takes plots alone. A subclass adds `method`, `init` and `step(memory, RegionInput)`, and replaces what differs."""

    @property
    def takes_video(self) -> bool:
        """Whether it takes video as well as plots."""
        return False

    @property
    def holds_messages(self) -> bool:
        """Whether AIS messages are in the tracks that it reports."""
        return False

    def messages_of(
        self, reports: Measurements, ais: Tracks, sensors: Sensors, region: int, interval_s: Floats | None = None
    ) -> Messages:
        """The AIS messages of a cycle that a region is given. Args: as of `coastwatch.tracks.radar.messages.messages_of`."""
        return Messages.empty()
