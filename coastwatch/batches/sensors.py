"""Sensors by their specification."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from coastwatch.batches.struct import Batch, column, optional_column
from coastwatch.kernels.arrays import Array, Floats, Ints

Rings = tuple[tuple[tuple[float, float], ...], ...]
"""Rings of corners, latitude and longitude in degrees. A lake is a ring inside another one."""

ID_STRIDE = 2**40
"""A track id is the number of its source times this, plus a number of its own that is never reused."""


class AzimuthReference(IntEnum):
    """From where a radar counts its azimuths, clockwise."""

    TRUE = 0  # true north
    MAGNETIC = 1  # magnetic north
    HEADING = 2  # the bow of its ship


@dataclass(frozen=True, eq=False)
class Radars(Batch):
    """Radars by their specification."""

    name: Array = column("U32", "R")
    region: Ints = column(np.int64, "R")
    site_deg: Floats = column(np.float64, "R", 2)  # at the start, where the platform moves
    range_m: Floats = column(np.float64, "R")
    period_s: Floats = column(np.float64, "R")  # of one turn
    range_sigma_m: Floats = column(np.float64, "R")
    azimuth_sigma_rad: Floats = column(np.float64, "R")
    beam_rad: Floats = optional_column("R")  # width at half power, for video
    pulse_m: Floats = optional_column("R")  # length in range
    blind_m: Floats = optional_column("R")  # nothing nearer is looked for in video
    db_per_level: Floats = optional_column("R")  # of video; 0: its levels are linear in amplitude
    azimuth_reference: Ints = optional_column("R", dtype=np.int64)  # AzimuthReference; -1: true
    variation_rad: Floats = optional_column("R")  # magnetic north, clockwise from true north; NaN: not stated


@dataclass(frozen=True, eq=False)
class Stations(Batch):
    """AIS receivers."""

    name: Array = column("U32", "R")
    site_deg: Floats = column(np.float64, "R", 2)
    range_m: Floats = column(np.float64, "R")


@dataclass(frozen=True, eq=False)
class Sonars(Batch):
    """Sensors of bearings by their specification."""

    name: Array = column("U32", "R")
    site_deg: Floats = column(np.float64, "R", 2)
    range_m: Floats = column(np.float64, "R")
    bearing_sigma_rad: Floats = column(np.float64, "R")
    interval_s: Floats = column(np.float64, "R")
    arc_from_deg: Floats = column(np.float64, "R")  # clockwise to arc_to_deg; 0 to 360 is all round
    arc_to_deg: Floats = column(np.float64, "R")

    @property
    def arc_width_rad(self) -> Floats:
        """The width of the arc of each: 2 pi of one that hears all round. (R,)"""
        width_deg = (self.arc_to_deg - self.arc_from_deg) % 360.0
        return np.radians(np.where(width_deg == 0.0, 360.0, width_deg))


@dataclass(frozen=True, eq=False)
class TrackSources(Batch):
    """Systems that send finished tracks."""

    name: Array = column("U32", "R")
    site_deg: Floats = column(np.float64, "R", 2)  # of the radar; NaN: not known
    heading_deg: Floats = column(np.float64, "R")  # of a radar that does not move
    position_sigma_m: Floats = column(np.float64, "R")  # of tracks without covariance, until it is estimated, per axis
    velocity_sigma_m_s: Floats = column(np.float64, "R")
    patience_s: Floats = column(np.float64, "R")  # a track that is not sent for this time is dropped


@dataclass(frozen=True, eq=False)
class Sensors:
    """All sensors of a scenario. Sources of tracks are numbered: regions, then track sources, then AIS, then one for each sonar."""

    radars: Radars
    stations: Stations
    sonars: Sonars
    region_names: tuple[str, ...]
    region_origin_deg: Floats  # (regions, 2)
    track_sources: TrackSources = field(default_factory=TrackSources.empty)
    land_deg: Rings = ()  # around the radars, where nothing is looked for in their video

    @property
    def ais_source(self) -> int:
        """Number of the AIS source."""
        return len(self.region_names) + len(self.track_sources)

    def track_source(self, number: int) -> int:
        """Number of the source of a track source."""
        return len(self.region_names) + number

    def sonar_source(self, sonar: int) -> int:
        """Number of the source of a sonar."""
        return self.ais_source + 1 + sonar

    @property
    def source_names(self) -> tuple[str, ...]:
        """Name of each source."""
        return (*self.region_names, *map(str, self.track_sources.name), "ais", *map(str, self.sonars.name))

    @property
    def source_kinds(self) -> Ints:
        """SourceKind of each source."""
        kinds = [0] * self.ais_source + [1] + [2] * len(self.sonars)
        return np.array(kinds, np.int64)


class SourceKind(IntEnum):
    """What the tracks of a source are made of."""

    RADAR = 0  # tracks of a region's radars, or of a track source
    AIS = 1
    BEARING = 2
