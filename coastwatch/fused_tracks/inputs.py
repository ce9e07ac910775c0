"""What the methods of the stage take in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import Associations, Ints, Measurements, Tracks, VesselBearings

NO_BEARINGS = VesselBearings.empty()


class FusionInput(NamedTuple):
    """The tracks of a cycle, and which of them are of one vessel."""

    tracks: Tracks  # (N)
    measurements: Measurements  # that went into them since the last cycle
    associations: Associations  # of the rows of `tracks`
    time_s: float
    kinds: Ints  # SourceKind of each source
    bearings: VesselBearings = NO_BEARINGS  # (B) by the associations of the last cycle
