"""What the methods of the stage take in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import AisStatics, BearingTracks, Octants, Picture, Sensors, Spots, Tracks
from coastwatch.stage import Map, serial


class AssociationInput(NamedTuple):
    """The tracks of a cycle, and which of them are near each other."""

    tracks: Tracks  # (N)
    spots: Spots  # of the same rows
    map_: Map = serial  # how the spots are mapped over processors


class BearingAssociationInput(NamedTuple):
    """The bearing tracks and the vessels of a cycle, and which of them may be one."""

    bearing_tracks: BearingTracks  # (N)
    picture: Picture  # (V)
    octants: Octants  # pairs of their rows
    time_s: float  # of the cycle, to which both are predicted
    sensors: Sensors
    statics: AisStatics  # that arrived since the last cycle, for their ship types
    map_: Map = serial  # how the octants are mapped over processors
