"""The memory of repulsive particles: filters, and the spokes that the beam has passed lately; as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, RadarExcess
from coastwatch.batches.struct import Struct, column, part

TURN_RAD = 2.0 * np.pi
JITTER_S = 0.5  # a clock that goes back farther was set back


@dataclass(frozen=True, eq=False)
class Particles(Batch):
    """Filters, the older first."""

    number: Ints = column(np.int64, "F")  # never given again
    sensor: Ints = column(np.int64, "F")  # radar whose video it takes
    particle: Floats = column(np.float64, "F", "P", 4)  # east, north, course, speed, at time_s
    time_s: Floats = column(np.float64, "F")
    looked_s: Floats = column(np.float64, "F")  # when the beam passed last
    looks: Ints = column(np.int64, "F")
    good: Ints = column(np.int64, "F")  # looks in a row in which it was narrow and bright
    acquired: Bools = column(np.bool_, "F")
    # Smoothed level of its particles over the background, dB; NaN before the first look
    bright: Floats = column(np.float64, "F")
    sigma_m: Floats = column(np.float64, "F")  # largest deviation of the position
    started_s: Floats = column(np.float64, "F")
    origin: Ints = column(np.int64, "F")  # true vessel of the plot that it began at
    acquired_number: Ints = column(np.int64, "F")  # of the track; -1 before it is acquired


@dataclass(frozen=True, eq=False)
class Window(Struct):
    """The newest spokes of a radar. Angles grow from turn to turn, and times never fall."""

    first_m: float
    cell_m: float
    angle: Floats = column(np.float64, "S")
    time_s: Floats = column(np.float64, "S")
    half_db: Array = column(np.int8, "S", "C")

    def __len__(self) -> int:
        return len(self.angle)

    def with_spokes(self, video: RadarExcess) -> Window:
        """This window with the spokes of a cycle behind; only those after a change of scale, or after the clock was set back."""
        same = (video.first_m, video.cell_m, video.half_db.shape[1]) == (self.first_m, self.cell_m, self.half_db.shape[1])
        last = float(self.angle[-1]) if same and len(self) else float(video.azimuth_rad[0])
        steps = np.diff(video.azimuth_rad, prepend=last % TURN_RAD)
        forward = (steps + 0.5 * TURN_RAD) % TURN_RAD - 0.5 * TURN_RAD  # a beam may step back by jitter
        angle = np.maximum.accumulate(last + np.cumsum(forward))
        time_s, half_db = video.time_s, video.half_db
        if same:
            angle, time_s = np.concatenate([self.angle, angle]), np.concatenate([self.time_s, time_s])
            half_db = np.concatenate([self.half_db, half_db])
        back = np.flatnonzero(np.diff(time_s) < -JITTER_S)
        first = int(back[-1]) + 1 if len(back) else 0
        return Window(video.first_m, video.cell_m, angle[first:], np.maximum.accumulate(time_s[first:]), half_db[first:])

    def newest(self, kept_rad: float) -> Window:
        """The spokes of this angle behind the beam."""
        first = int(np.searchsorted(self.angle, self.angle[-1] - kept_rad)) if len(self) else 0
        return Window(
            self.first_m, self.cell_m, self.angle[first:].copy(), self.time_s[first:].copy(), self.half_db[first:].copy()
        )


@dataclass(frozen=True, eq=False)
class ParticlesMemory(Struct):
    """One region between two cycles."""

    filters: Particles = part(Particles)
    site_m: Floats = column(np.float64, "R", 2, new=np.nan)  # where each radar was last, NaN where it has sent nothing
    next_filter: int = 1
    next_number: int = 1  # of the next track
    windows: dict[int, Window] = field(default_factory=dict)  # by number of the radar
