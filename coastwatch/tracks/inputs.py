"""What trackers of AIS, bearings and finished tracks take in a cycle, and what an AIS tracker yields."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import (
    AisAlarms,
    AisReports,
    BearingReports,
    ExpectedVessels,
    Measurements,
    Sensors,
    TrackReports,
    Tracks,
)


class AisInput(NamedTuple):
    """The AIS reports of a cycle."""

    reports: AisReports  # since the last cycle, in any order
    time_s: float
    sensors: Sensors


class AisOutput(NamedTuple):
    """Tracks of all vessels that report."""

    tracks: Tracks  # at the time of the cycle, sorted by MMSI
    alarms: AisAlarms  # in the same order
    measurements: Measurements  # the reports that went into these tracks


NOT_EXPECTED = ExpectedVessels.empty()


class BearingInput(NamedTuple):
    """The bearings of a cycle."""

    reports: BearingReports  # since the last cycle, in any order
    time_s: float
    sensors: Sensors
    expected: ExpectedVessels = NOT_EXPECTED  # that sensors without contact numbers may hear


class ReceivedInput(NamedTuple):
    """The states of finished tracks that came in a cycle."""

    reports: TrackReports  # since the last cycle, in any order
    time_s: float
    sensors: Sensors
    ais_tracks: Tracks  # at `time_s`
