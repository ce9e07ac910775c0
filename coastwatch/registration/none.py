"""No online registration: only the settings of `[plots]` correct radars."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import (
    AisAlarms,
    BearingAssociations,
    BearingTracks,
    Measurements,
    Members,
    Picture,
    Plots,
    RadarCorrections,
    Sensors,
    Tracks,
)
from coastwatch.stage import Method, NoMemory


class NoRegistration(Method):
    """Estimates no registration errors."""

    method: Literal["none"] = "none"

    def init(self) -> NoMemory:
        return NoMemory()

    def step(
        self,
        memory: NoMemory,
        plots: Plots,
        ais_tracks: Tracks,
        alarms: AisAlarms,
        measurements: Measurements,
        picture: Picture,
        members: Members,
        bearing_tracks: BearingTracks,
        bearing_associations: BearingAssociations,
        time_s: float,
        sensors: Sensors,
        given: RadarCorrections,
    ) -> tuple[NoMemory, RadarCorrections]:
        """Unchanged memory; every correction is zero."""
        return memory, RadarCorrections.none(len(sensors.radars))
