"""What the rules of alarms take in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.alarms.zone_alarms import Numbered
from coastwatch.batches import Members, Picture, RadarCover, SensorHearing, Sensors


class AlarmInput(NamedTuple):
    """The picture of a cycle, and what it is watched for."""

    picture: Picture
    members: Members
    time_s: float
    sensors: Sensors
    zones: tuple[Numbered, ...] = ()  # with their numbers, each above 0 and once
    cover: RadarCover | None = None  # of each radar; none, or empty: it sees within its range
    hearing: SensorHearing | None = None  # which sensors are heard; none: all
