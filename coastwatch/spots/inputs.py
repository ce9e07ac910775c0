"""What `octants` takes in a cycle. `kmeans` takes the tracks of the cycle alone."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import BearingTracks, Floats, Picture, Sensors


class OctantInput(NamedTuple):
    """The bearing tracks and the vessels of a cycle."""

    bearing_tracks: BearingTracks  # (N)
    picture: Picture  # (V)
    sensors: Sensors
    bias_rad: Floats | None = None  # (K,) of the bearings of each sensor, as far as it is known; none, or no row: not
