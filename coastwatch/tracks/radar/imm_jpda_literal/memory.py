"""The memory of the literal IMM-JPDA: confirmed, preliminary and tentative tracks, and false plots by place; as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coastwatch.batches import Batch, Floats, Ints
from coastwatch.batches.struct import Struct, column, part
from coastwatch.tracks.radar.clutter import ClutterMap

NEWEST = 5  # plots whose origin is kept, for the scores


@dataclass(frozen=True, eq=False)
class Confirmed(Batch):
    """Tracks in the IMM-JPDA filter, the older first."""

    number: Ints = column(np.int64, "N")  # within the region
    time_s: Floats = column(np.float64, "N")  # of the state
    state: Floats = column(np.float64, "N", 2, 5)  # of CV and CTRV: east, north, course, speed, turn rate
    covariance: Floats = column(np.float64, "N", 2, 5, 5)
    mode_probability: Floats = column(np.float64, "N", 2)
    looks: Ints = column(np.int64, "N")  # since it was confirmed
    hit_bits: Ints = column(np.int64, "N")  # one for each of the newest looks that had a plot, the newest the lowest
    looked_s: Floats = column(np.float64, "N", "R")  # up to which the looks of each radar are counted
    hit_s: Floats = column(np.float64, "N", "R")  # newest plot of each radar, -inf: none
    started_s: Floats = column(np.float64, "N")
    plots: Ints = column(np.int64, "N")  # so far
    origins: Ints = column(np.int64, "N", NEWEST)  # true vessels of the newest plots, newest first

    @property
    def columns(self) -> tuple[Floats, Floats, Floats, Floats]:
        """As the kernels take them; they write into these."""
        return self.time_s, self.state, self.covariance, self.mode_probability


@dataclass(frozen=True, eq=False)
class Preliminary(Batch):
    """Tracks of two plots or more that are not confirmed. Each is of one radar."""

    sensor: Ints = column(np.int64, "P")
    time_s: Floats = column(np.float64, "P")
    state: Floats = column(np.float64, "P", 4)  # east, north and their rates; course and speed with `literal_start`
    covariance: Floats = column(np.float64, "P", 4, 4)
    looked_s: Floats = column(np.float64, "P")  # up to which looks are counted
    looks: Ints = column(np.int64, "P")  # since its second plot
    hits: Ints = column(np.int64, "P")  # looks with a plot
    hit_s: Floats = column(np.float64, "P")  # newest plot
    started_s: Floats = column(np.float64, "P")
    origin: Ints = column(np.int64, "P")  # true vessel of the newest plot


@dataclass(frozen=True, eq=False)
class Tentative(Batch):
    """Single plots that wait for a second one in the next look."""

    sensor: Ints = column(np.int64, "Z")
    time_s: Floats = column(np.float64, "Z")
    position_m: Floats = column(np.float64, "Z", 2)
    covariance: Floats = column(np.float64, "Z", 2, 2)
    variance_m2: Floats = column(np.float64, "Z", 2)  # along the beam and across it
    origin: Ints = column(np.int64, "Z")


@dataclass(frozen=True, eq=False)
class ImmJpdaMemory(Struct):
    """One region between two cycles."""

    site_m: Floats = column(np.float64, "R", 2, new=np.nan)  # where each radar was last, NaN where it has sent nothing
    newest_plot_s: Floats = column(np.float64, "R", new=-np.inf)  # of each radar, -inf where it has sent nothing
    confirmed: Confirmed = part(Confirmed)
    preliminary: Preliminary = part(Preliminary)
    tentative: Tentative = part(Tentative)
    next_number: int = 1  # of the next track
    clutter: ClutterMap = field(default_factory=ClutterMap.empty)

    def check_rows(self) -> None:
        """Check the number of radars, as after reading a checkpoint. Raises: ValueError."""
        if self.confirmed.looked_s.shape[1] != len(self.newest_plot_s):
            raise ValueError(
                f"Confirmed.looked_s: got {self.confirmed.looked_s.shape[1]} radars, needed {len(self.newest_plot_s)}"
            )
