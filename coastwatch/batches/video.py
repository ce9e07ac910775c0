"""Radar video: the level of each cell of each spoke, before anything is detected in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coastwatch.batches.struct import Batch, column, optional_column
from coastwatch.kernels.arrays import Array, Floats, Ints


@dataclass(frozen=True, eq=False)
class RadarVideo(Batch):
    """Spokes of one radar at one range scale, in order of arrival. A spoke that was lost is no row."""

    sensor: int  # index into the scenario's radars
    first_m: float  # range of the near edge of the first cell
    cell_m: float  # length of a cell
    time_s: Floats = column(np.float64, "S")  # of the beam
    received_s: Floats = column(np.float64, "S")
    azimuth_rad: Floats = column(np.float64, "S")  # of the middle of the spoke, 0 to 2 pi; as of `RadarReports`
    site_deg: Floats = column(np.float64, "S", 2)  # where the antenna was
    level: Array = column(np.uint8, "S", "C")  # see `Radars.db_per_level`
    # Range of each true vessel where the spoke points near it, NaN elsewhere; no vessel where the video is not simulated.
    vessel_m: Floats = optional_column("S", "V")
    bits: int = 8  # of a cell as the radar sends it: levels of 1, 2 and 4 bits are as they are
    # First cell and end of what did not come of each spoke: its level is 0, and nothing is looked for there.
    missing: Ints = optional_column("S", 2, dtype=np.int64, new=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.cell_m > 0.0 and self.first_m >= 0.0):
            raise ValueError(
                f"RadarVideo.cell_m, first_m: got {self.cell_m}, {self.first_m}, needed more than 0, and 0 or more"
            )

    @property
    def scale(self) -> tuple[float, float, int, int]:
        """Near edge and length of a cell, m, bits and number of cells: spokes of one radar and scale can be joined."""
        return self.first_m, self.cell_m, self.bits, self.level.shape[1]

    @classmethod
    def join(cls, parts: Sequence[RadarVideo]) -> RadarVideo:
        """The spokes of all parts, one after the other: of one, that one. Args: parts: one or more, of one radar and scale."""
        if not parts:
            raise ValueError("RadarVideo.join: got no part, needed one or more: no radar is known, and no scale")
        return parts[0] if len(parts) == 1 else super().join(parts)


@dataclass(frozen=True)
class Videos:
    """The video of several radars and range scales. Parts of one radar are in order of arrival."""

    parts: tuple[RadarVideo, ...] = ()

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def between(self, after_s: float, until_s: float) -> Videos:
        """The spokes with after_s < received_s <= until_s."""
        ends = [np.searchsorted(part.received_s, [after_s, until_s], side="right").tolist() for part in self.parts]
        return Videos(tuple(part.take(slice(*rows)) for part, rows in zip(self.parts, ends, strict=True) if rows[0] < rows[1]))

    @staticmethod
    def merged(several: Sequence[Videos]) -> Videos:
        """The parts of all in order of their first spokes."""
        parts = [part for videos in several for part in videos.parts if len(part)]
        return Videos(tuple(sorted(parts, key=lambda part: float(part.received_s[0]))))


@dataclass(frozen=True, eq=False)
class Extractions(Batch):
    """What extraction made of the video of a cycle: one row a radar that sent some."""

    radar: Ints = column(np.int64, "E")
    plots: Ints = column(np.int64, "E")
    # Over the background, the median of its range; NaN: not in decibels, or not known
    threshold_db: Floats = column(np.float64, "E")


@dataclass(frozen=True, eq=False)
class RadarExcess(Batch):
    """Spokes of one radar, as by how much each cell is over its local background: what trackers take that need no plots."""

    sensor: int  # index into the radars of the region
    first_m: float  # range of the near edge of the first cell
    cell_m: float  # length of a cell
    time_s: Floats = column(np.float64, "S")  # of the beam
    azimuth_rad: Floats = column(np.float64, "S")  # true, 0 to 2 pi
    site_deg: Floats = column(np.float64, "S", 2)  # where the antenna was
    half_db: Array = column(np.int8, "S", "C")  # half decibels over the background, -20 to 60; 0 where none is known
