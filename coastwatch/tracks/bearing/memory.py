"""What the tracker of bearings keeps from cycle to cycle: a window of slots with the mean bearing in each."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from coastwatch.batches import CLASSES, Floats, Ints
from coastwatch.kernels.tables.row_numbers import require_rows


@dataclass(frozen=True, eq=False)
class BearingMemory:
    """All tracks, sorted by track_id. Windows are oldest first, NaN before the first slot."""

    track_id: Ints  # (N,)
    sensor: Ints  # (N,)
    contact: Ints  # (N,) -1: the sensor gives none and the track is our own; -2 - vessel_id: the vessel predicts it
    updated_s: Floats  # (N,)
    started_s: Floats  # (N,)
    begin_s: Floats  # (N,) first report of the newest slot
    hits: Ints  # (N,) reports
    looks: Ints  # (N,) looks of the sensor since the track began; own tracks only
    misses: Ints  # (N,) looks without a report, in a row; own tracks only
    origin: Ints  # (N,)
    time_s: Floats  # (N, W) mean of the slot
    bearing_rad: Floats  # (N, W) mean of the slot
    weight: Floats  # (N, W) reports in the slot, each by `relative_weight`; 0 where there is none
    precision: Floats  # (N, W) mean of `relative_weight` in the slot: 1 for reports without a variance of their own
    site_deg: Floats  # (N, W, 2)
    signatures: Ints  # (N, C) reports of each VesselClass
    looked_s: Floats  # (N,) time of the newest look that was counted; own tracks only
    doubt_s: Floats  # (N,) of a bearing far from the others of its contact, not used until the next one agrees with it
    doubt_rad: Floats  # (N,) NaN: none
    counter: Ints  # (K,) tracks that each sensor has had
    noise: Floats  # (K,) variance of the bearings of each sensor, as learned, over the stated one
    turn_s: Floats  # (K,) of a sensor that gives each bearing its own time: between two bearings of a track; 0: not known, or another
    dropped: int  # reports that are not finite or from the future
    far_off: int  # bearings that were not used, as they were far from the others of their contact
    left_out: int  # reports beyond the counts of `looks.py`

    def check_rows(self) -> None:
        """Check the numbers of sensors, as after reading a checkpoint. Raises: ValueError that names the field."""
        require_rows("BearingMemory.sensor", self.sensor, len(self.counter))

    def unnumbered(self) -> tuple[Ints, Floats]:
        """The sensors that have tracks without contact numbers, and where each was last. (S,), (S, 2)"""
        rows = np.flatnonzero(self.contact < 0)
        newest_first = rows[np.argsort(-self.updated_s[rows], kind="stable")]
        sensor, first = np.unique(self.sensor[newest_first], return_index=True)
        return sensor, self.site_deg[newest_first[first], -1]

    @staticmethod
    def empty(window: int) -> BearingMemory:
        n, x, slots = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, window))
        sites, signatures = np.zeros((0, window, 2)), np.zeros((0, CLASSES), np.int64)
        return BearingMemory(
            n, n, n, x, x, x, n, n, n, n, slots, slots, slots, slots, sites, signatures, x, x, x, n, x, x, 0, 0, 0
        )


COUNTS = ("dropped", "far_off", "left_out")
ROWS = tuple(f.name for f in fields(BearingMemory) if f.name not in ("counter", "noise", "turn_s", *COUNTS))
