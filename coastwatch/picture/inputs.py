"""What the picture takes and yields in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import (
    AisAlarms,
    AisDetection,
    Associations,
    Bools,
    FusedTracks,
    HeldVessels,
    Members,
    Picture,
    SensorHearing,
    Sensors,
    Tracks,
)

NO_VESSELS = HeldVessels.empty()


class PictureInput(NamedTuple):
    """The vessels of a cycle, without identity."""

    tracks: Tracks  # (N)
    associations: Associations  # of its rows
    fused: FusedTracks  # (V) one row for each vessel number
    alarms: AisAlarms  # of AIS tracks
    time_s: float
    sensors: Sensors
    bearing_only_vessels: HeldVessels = NO_VESSELS  # vessels of the last picture that only bearings hold
    detection: AisDetection | None = (
        None  # of AIS tracks by radars that are heard; none: a radar should see all within its range
    )
    hearing: SensorHearing | None = None  # which sensors are heard; none: all
    jumped: Bools | None = None  # (R,) radars whose registration jumped before this cycle; none: no one


class PictureOutput(NamedTuple):
    """Each vessel once."""

    picture: Picture  # sorted by vessel_id
    members: Members  # the tracks in it
