"""Reports of sensors, in their own coordinates, and the truth where it is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coastwatch.batches.struct import Array, Batch, Bools, Floats, Ints, Struct, column


@dataclass(frozen=True, eq=False)
class RadarReports(Batch):
    """Plots of radars in polar coordinates, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's radars
    time_s: Floats = column(np.float64, "M")  # of the beam, as the radar stamps it
    received_s: Floats = column(np.float64, "M")
    range_m: Floats = column(np.float64, "M")
    azimuth_deg: Floats = column(np.float64, "M")  # true, 0..360
    site_deg: Floats = column(np.float64, "M", 2)  # where the antenna was
    origin: Ints = column(np.int64, "M")


@dataclass(frozen=True, eq=False)
class AisReports(Batch):
    """AIS position reports, in order of arrival."""

    time_s: Floats = column(np.float64, "M")  # of the fix, as well as it is known
    received_s: Floats = column(np.float64, "M")
    mmsi: Ints = column(np.int64, "M")
    position_deg: Floats = column(np.float64, "M", 2)
    sog_kn: Floats = column(np.float64, "M")  # NaN: not available
    cog_deg: Floats = column(np.float64, "M")  # NaN: not available
    class_b: Bools = column(np.bool_, "M")
    origin: Ints = column(np.int64, "M")


@dataclass(frozen=True, eq=False)
class AisStatics(Batch):
    """Names, types and sizes that vessels sent, in order of arrival. Empty text and NaN are not available."""

    received_s: Floats = column(np.float64, "M")
    mmsi: Ints = column(np.int64, "M")
    name: Array = column("U20", "M")
    call_sign: Array = column("U7", "M")
    ship_type: Ints = column(np.int64, "M")  # ITU-R M.1371 code; -1 not available
    length_m: Floats = column(np.float64, "M")
    beam_m: Floats = column(np.float64, "M")


@dataclass(frozen=True, eq=False)
class BearingReports(Batch):
    """Bearings from passive sonars, cameras and direction finders, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's sonars
    time_s: Floats = column(np.float64, "M")
    received_s: Floats = column(np.float64, "M")
    bearing_deg: Floats = column(np.float64, "M")  # true, 0..360
    contact: Ints = column(np.int64, "M")  # the sensor's own track number; -1 where it gives none
    site_deg: Floats = column(np.float64, "M", 2)
    signature: Ints = column(np.int64, "M")  # VesselClass by its sound; -1 if unknown
    origin: Ints = column(np.int64, "M")


@dataclass(frozen=True, eq=False)
class Reports:
    """All that arrived in one cycle."""

    radar: RadarReports
    ais: AisReports
    statics: AisStatics
    bearing: BearingReports

    def between(self, after_s: float, until_s: float) -> Reports:
        """The reports with after_s < received_s <= until_s; each part must be sorted by received_s."""
        return Reports(*(self._cut(part, after_s, until_s) for part in (self.radar, self.ais, self.statics, self.bearing)))

    @staticmethod
    def _cut(part: Any, after_s: float, until_s: float) -> Any:
        lo, hi = np.searchsorted(part.received_s, [after_s, until_s], side="right")
        return part.take(slice(lo, hi))

    def __len__(self) -> int:
        return len(self.radar) + len(self.ais) + len(self.statics) + len(self.bearing)


@dataclass(frozen=True, eq=False)
class Truth(Batch):
    """True states of simulated or surveyed vessels at one instant."""

    vessel: Ints = column(np.int64, "V")
    time_s: Floats = column(np.float64, "V")
    position_deg: Floats = column(np.float64, "V", 2)
    velocity_m_s: Floats = column(np.float64, "V", 2)


@dataclass(frozen=True, eq=False)
class Trajectories(Struct):
    """True motion of vessels, sampled at common instants, and the parameters of its model, for the physical bound."""

    vessel: Ints = column(np.int64, "V")
    time_s: Floats = column(np.float64, "T")  # increasing
    position_deg: Floats = column(np.float64, "V", "T", 2)
    velocity_m_s: Floats = column(np.float64, "V", "T", 2)
    present: Bools = column(np.bool_, "V", "T")
    kick_s: Floats = column(np.float64, "V", "B")  # when the velocity was perturbed; NaN pads; no column: not simulated
    kick_m_s: Floats = column(np.float64, "V")  # standard deviation of each perturbation, per axis
    turn_rate_rad_s: Floats = column(np.float64, "V")  # known and constant, 0 for straight motion
    acceleration_m_s2: Floats = column(np.float64, "V", 2)  # known and constant while accelerating
    # Share of the deviation from the mean velocity that a perturbation leaves, 0 to 1; empty: 1, a random walk.
    kick_keep: Floats = field(default_factory=lambda: np.zeros(0), metadata={"dtype": np.dtype(np.float64), "shape": ("D",)})

    def at(self, time_s: float) -> Truth:
        """The vessels present at an instant, interpolated linearly between samples."""
        hi = int(np.clip(np.searchsorted(self.time_s, time_s), 1, max(len(self.time_s) - 1, 1)))
        lo = hi - 1
        hi = min(hi, len(self.time_s) - 1)
        step = self.time_s[hi] - self.time_s[lo]
        w = float(np.clip((time_s - self.time_s[lo]) / step, 0.0, 1.0)) if step > 0.0 else 0.0
        here = self.present[:, lo if w < 0.5 else hi]
        blend = [(1.0 - w) * a[here, lo] + w * a[here, hi] for a in (self.position_deg, self.velocity_m_s)]
        return Truth(self.vessel[here], np.full(here.sum(), float(time_s)), *blend)


@dataclass(frozen=True, eq=False)
class Noise(Struct):
    """True errors of simulated sensors, which methods never see and the physical bound may know."""

    range_sigma_m: Floats = column(np.float64, "R")
    azimuth_sigma_rad: Floats = column(np.float64, "R")
    range_bias_m: Floats = column(np.float64, "R")
    azimuth_bias_rad: Floats = column(np.float64, "R")
    time_bias_s: Floats = column(np.float64, "R")
    ais_position_sigma_m: float = 0.0  # per axis
    ais_velocity_sigma_m_s: float = 0.0  # per axis


@dataclass(frozen=True)
class Fault:
    """Records refused for one reason: how many, and where the first one stood."""

    kind: str  # short, fixed words: "checksum", "latitude out of range", "not an MMSI", ...
    count: int
    where: str  # "file:line" or "file, row 12, column sog"
    example: str  # the record, cut to 80 characters


@dataclass(frozen=True, eq=False)
class Recording:
    """All the input of one run: reports in order of arrival, truth where there is any, and refused records."""

    reports: Reports
    start_s: float
    stop_s: float
    truth: Trajectories | None = None
    faults: tuple[Fault, ...] = ()
    silenced: tuple[int, ...] = ()  # origins whose AIS was switched off on purpose
    noise: Noise | None = None  # of simulated sensors
