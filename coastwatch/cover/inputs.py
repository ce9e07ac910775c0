"""What the methods of the stage take in a cycle, and what a method for the cover of radars yields."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.batches import (
    AisDetection,
    Associations,
    Bools,
    Measurements,
    Plots,
    RadarCover,
    Reports,
    Sensors,
    Tracks,
)


class CoverInput(NamedTuple):
    """What radars saw in a cycle, and which vessels were there."""

    plots: Plots
    tracks: Tracks  # (N) of all sources, at one time
    associations: Associations  # of them
    measurements: Measurements  # in the tracks
    alarmed: Bools  # (N,) AIS tracks that are no reference vessels
    jumped: Bools  # (R,) radars whose corrections jumped before this cycle
    sensors: Sensors
    silent: Bools | None = None  # (R,) radars that are not heard; none: all are


class CoverOutput(NamedTuple):
    """Where radars see vessels."""

    radar_cover: RadarCover  # one row a radar; empty where none is learnt
    ais_detection: AisDetection  # for AIS tracks the probability that some radar detects them in a turn


class SilenceInput(NamedTuple):
    """What came in a cycle."""

    reports: Reports
    ais_tracks: Tracks  # at the end of the cycle
    time_s: float
    sensors: Sensors
