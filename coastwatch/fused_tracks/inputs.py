"""What the methods of the stage take in a cycle."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from coastwatch.batches import AisAlarms, Associations, Ints, Measurements, Tracks, VesselBearings
from coastwatch.stage import Method

NO_BEARINGS, NO_ALARMS = VesselBearings.empty(), AisAlarms.empty()


class FusionInput(NamedTuple):
    """The tracks of a cycle, and which of them are of one vessel."""

    tracks: Tracks  # (N)
    measurements: Measurements  # that went into them since the last cycle
    associations: Associations  # of the rows of `tracks`
    time_s: float
    kinds: Ints  # SourceKind of each source
    bearings: VesselBearings = NO_BEARINGS  # (B) by the associations of the last cycle
    alarms: AisAlarms = NO_ALARMS  # of AIS tracks


class FusionMethod(Method):
    """Settings of a method that makes one estimate of the tracks of a vessel."""

    of_measurements: ClassVar[bool] = False
    """True: it takes the plots and reports behind the tracks. AIS messages in a radar track and in an AIS track then count once.

    Else such a vessel is given to it as that radar track alone.
    """
