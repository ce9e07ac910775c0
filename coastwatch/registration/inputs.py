"""What the methods of the stage take in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import (
    AisAlarms,
    BearingAssociations,
    BearingTracks,
    HullOffsets,
    Measurements,
    Members,
    Picture,
    Plots,
    RadarCorrections,
    Sensors,
    Tracks,
)


class RegistrationInput(NamedTuple):
    """All that a cycle shows of where radars see vessels."""

    plots: Plots  # in any order, with `corrections` applied
    ais_tracks: Tracks
    alarms: AisAlarms  # of these tracks, row by row
    measurements: Measurements
    picture: Picture
    members: Members
    bearing_tracks: BearingTracks
    bearing_associations: BearingAssociations
    time_s: float  # end of the cycle
    sensors: Sensors
    corrections: RadarCorrections
    hulls: HullOffsets = HullOffsets.empty()  # of large ships whose size is known
