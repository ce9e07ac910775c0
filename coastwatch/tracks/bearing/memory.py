"""What the tracker of bearings keeps from cycle to cycle: a window of slots with the mean bearing in each."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from coastwatch.batches import CLASSES, Batch, Floats, Ints, Struct, column
from coastwatch.kernels.tables.row_numbers import require_rows


@dataclass(frozen=True, eq=False)
class BearingMemory(Struct):
    """All tracks, sorted by track_id. Windows are oldest first, NaN before the first slot."""

    track_id: Ints = column(np.int64, "N")
    sensor: Ints = column(np.int64, "N")
    contact: Ints = column(np.int64, "N")  # -1: of our own track, the sensor gives none; -2 - vessel_id: the vessel predicts it
    updated_s: Floats = column(np.float64, "N", new=-np.inf)
    started_s: Floats = column(np.float64, "N")
    begin_s: Floats = column(np.float64, "N", new=np.nan)  # first report of the newest slot
    hits: Ints = column(np.int64, "N")  # reports
    looks: Ints = column(np.int64, "N")  # looks of the sensor since the track began; own tracks only
    misses: Ints = column(np.int64, "N")  # looks without a report, in a row; own tracks only
    origin: Ints = column(np.int64, "N")
    time_s: Floats = column(np.float64, "N", "W", new=np.nan)  # mean of the slot
    bearing_rad: Floats = column(np.float64, "N", "W", new=np.nan)  # mean of the slot
    weight: Floats = column(np.float64, "N", "W")  # reports in the slot, each by `relative_weight`; 0 where there is none
    # Mean of `relative_weight` in the slot: 1 for reports without a variance of their own
    precision: Floats = column(np.float64, "N", "W", new=np.nan)
    site_deg: Floats = column(np.float64, "N", "W", 2, new=np.nan)
    signatures: Ints = column(np.int64, "N", CLASSES)  # reports of each VesselClass
    looked_s: Floats = column(np.float64, "N", new=-np.inf)  # time of the newest look that was counted; own tracks only
    # Of a bearing far from the others of its contact, not used until the next one agrees with it
    doubt_s: Floats = column(np.float64, "N", new=np.nan)
    doubt_rad: Floats = column(np.float64, "N", new=np.nan)  # NaN: none
    counter: Ints = column(np.int64, "K")  # tracks that each sensor has had
    noise: Floats = column(np.float64, "K", new=1)  # variance of the bearings of each sensor, as learned, over the stated one
    # Of a sensor that gives each bearing its own time: between two bearings of a track; 0: not known, or another
    turn_s: Floats = column(np.float64, "K")
    dropped: int = 0  # reports that are not finite or from the future
    far_off: int = 0  # bearings that were not used, as they were far from the others of their contact
    left_out: int = 0  # reports beyond the counts of `looks.py`

    def check_rows(self) -> None:
        """Check the numbers of sensors, as after reading a checkpoint. Raises: ValueError that names the field."""
        require_rows("BearingMemory.sensor", self.sensor, len(self.counter))

    def unnumbered(self) -> tuple[Ints, Floats]:
        """The sensors that have tracks without contact numbers, and where each was last. (S,), (S, 2)"""
        rows = np.flatnonzero(self.contact < 0)
        newest_first = rows[np.argsort(-self.updated_s[rows], kind="stable")]
        sensor, first = np.unique(self.sensor[newest_first], return_index=True)
        return sensor, self.site_deg[newest_first[first], -1]


@dataclass(frozen=True, eq=False)
class Measured(Batch):
    """Means over the bearings of one cycle, of each track."""

    measured_weight: Floats = column(np.float64, "N")  # 0: the track had none
    measured_s: Floats = column(np.float64, "N")
    measured_rad: Floats = column(np.float64, "N")
    measured_site_deg: Floats = column(np.float64, "N", 2)
    certainty: Floats = column(np.float64, "N", new=np.nan)


COUNTS = ("dropped", "far_off", "left_out")
ROWS = tuple(f.name for f in fields(BearingMemory) if f.name not in ("counter", "noise", "turn_s", *COUNTS))
