"""Reports of sensors, in their own coordinates, and the truth where it is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np

from coastwatch.batches.struct import Batch, Struct, column, column_or_none, optional_column
from coastwatch.batches.video import Videos
from coastwatch.kernels.arrays import Array, Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class RadarReports(Batch):
    """Plots of radars in polar coordinates, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's radars
    time_s: Floats = column(np.float64, "M")  # of the beam, as the radar stamps it
    received_s: Floats = column(np.float64, "M")
    range_m: Floats = column(np.float64, "M")
    azimuth_deg: Floats = column(np.float64, "M")  # 0..360; true, but before `plots.azimuths` as the radar counts it
    site_deg: Floats = column(np.float64, "M", 2)  # where the antenna was
    origin: Ints = optional_column("M", dtype=np.int64)
    range_sigma_m: Floats = optional_column("M")  # standard deviation of this plot; NaN: that of the radar
    azimuth_sigma_deg: Floats = optional_column("M")  # the same
    # Second moments of the ship about its middle, m2: along the beam, along and across, across (clockwise positive), less those of
    # beam and pulse; one that is smaller than these may be below 0. NaN: not measured.
    extent: Floats = optional_column("M", 3)
    weight: Floats = optional_column("M")  # of the echo: sum of its amplitudes over the background; NaN: not measured


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
    origin: Ints = optional_column("M", dtype=np.int64)
    nav_status: Ints = optional_column("M", dtype=np.int64)  # NavStatus; -1: not sent
    accuracy: Ints = optional_column("M", dtype=np.int64)  # PositionAccuracy; -1: not stated
    covariance: Floats = optional_column("M", 2, 2)  # of this position, m2 east and north; NaN: by its accuracy
    feed: Ints = optional_column("M", dtype=np.int64)  # which feed it came by; -1: the only one
    heading_deg: Floats = optional_column("M")  # true, of the bow; NaN: not available
    time_error_s: Floats = optional_column("M")  # by which the second in the message contradicts the time; NaN: it does not


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
    # From the antenna, here and below; 0 to bow and to port: it is not said where it is
    to_bow_m: Floats = optional_column("M")
    to_stern_m: Floats = optional_column("M")
    to_port_m: Floats = optional_column("M")
    to_starboard_m: Floats = optional_column("M")


@dataclass(frozen=True, eq=False)
class BearingReports(Batch):
    """Bearings from passive sonars, cameras and direction finders, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's sonars
    time_s: Floats = column(np.float64, "M")
    received_s: Floats = column(np.float64, "M")
    bearing_deg: Floats = column(np.float64, "M")  # true, 0..360
    contact: Ints = column(np.int64, "M")  # the sensor's own track number; -1 where it gives none
    site_deg: Floats = column(np.float64, "M", 2)
    signature: Ints = optional_column("M", dtype=np.int64)  # VesselClass by its sound; -1 if unknown
    origin: Ints = optional_column("M", dtype=np.int64)
    bearing_sigma_deg: Floats = optional_column("M")  # standard deviation of this bearing; NaN: that of the sensor


@dataclass(frozen=True, eq=False)
class TrackReports(Batch):
    """States of tracks that another system made, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's track sources
    number: Ints = column(np.int64, "M")  # of the track, as the source gives it; it may be used again
    time_s: Floats = column(np.float64, "M")
    received_s: Floats = column(np.float64, "M")
    position_deg: Floats = column(np.float64, "M", 2)
    velocity_m_s: Floats = column(np.float64, "M", 2)  # NaN: not given
    covariance: Floats = column(np.float64, "M", 4, 4)  # NaN: not given; the velocity block alone may be NaN
    origin: Ints = optional_column("M", dtype=np.int64)
    echo_length_m: Floats = optional_column("M")  # as of `Tracks`; NaN: not given, here and below
    echo_width_m: Floats = optional_column("M")
    echo_axis_deg: Floats = optional_column("M")
    alternative_m: Floats = optional_column("M")


@dataclass(frozen=True, eq=False)
class HeadingReports(Batch):
    """Headings of the ships or platforms that radars stand on, in order of arrival. One for several radars is a row for each."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's radars
    time_s: Floats = column(np.float64, "M")
    received_s: Floats = column(np.float64, "M")
    heading_deg: Floats = column(np.float64, "M")  # true, of the bow, 0..360


@dataclass(frozen=True, eq=False)
class Reports:
    """All that arrived in one cycle."""

    radar: RadarReports = field(default_factory=RadarReports.empty)
    ais: AisReports = field(default_factory=AisReports.empty)
    statics: AisStatics = field(default_factory=AisStatics.empty)
    bearing: BearingReports = field(default_factory=BearingReports.empty)
    tracks: TrackReports = field(default_factory=TrackReports.empty)
    headings: HeadingReports = field(default_factory=HeadingReports.empty)
    video: Videos = Videos()

    def between(self, after_s: float, until_s: float) -> Reports:
        """The reports with after_s < received_s <= until_s; each part must be sorted by received_s."""
        cut: dict[str, Any] = {"video": self.video.between(after_s, until_s)}
        for name in (f.name for f in fields(self) if f.name != "video"):
            part = getattr(self, name)
            first, end = np.searchsorted(part.received_s, [after_s, until_s], side="right").tolist()
            cut[name] = part.take(slice(first, end))
        return Reports(**cut)

    def __len__(self) -> int:
        return sum(len(getattr(self, f.name)) for f in fields(self))

    @classmethod
    def merged(cls, parts: Sequence[Reports]) -> Reports:
        """The reports of all parts, each kind in order of arrival; equal times in order of the parts.

        A plot that several parts have is there once: two networks, or captures that overlap, carry the same messages.
        """
        out: dict[str, Any] = {"video": Videos.merged([part.video for part in parts])}
        for name in (f.name for f in fields(cls) if f.name not in out):
            every = [getattr(part, name) for part in parts]
            some = [part for part in every if len(part)]
            out[name] = (some or every or [getattr(cls(), name)])[0]
            if len(some) > 1:
                together = type(every[0]).join(some)
                out[name] = together.take(np.argsort(together.received_s, kind="stable"))
                if name == "radar":
                    out[name] = _each_once(out[name])
        return cls(**out)


def _each_once(plots: RadarReports) -> RadarReports:
    """The plots without those that are the same as an earlier row."""
    keys = plots.azimuth_deg, plots.range_m, plots.time_s, plots.sensor
    order = np.lexsort(keys)  # stable: the first of equal rows comes first
    again = np.ones(max(len(order) - 1, 0), np.bool_)
    for key in keys:
        again &= key[order[1:]] == key[order[:-1]]
    keep = np.ones(len(order), np.bool_)
    keep[order[1:][again]] = False
    return plots.take(keep)


EARLIER_S = 3600.0
"""How long before the start of a run the reports of a stream are used."""


class ReportStream(Protocol):
    """Reports of a source that is too large for memory. It is read once, forwards."""

    def between(self, after_s: float, until_s: float) -> Reports:
        """The reports with after_s < received_s <= until_s. Older ones are dropped; those after wait for the next call."""
        ...

    def faults(self) -> tuple[Fault, ...]:
        """The records that were refused or set aside so far."""
        ...

    def contents(self) -> tuple[FileContent, ...]:
        """What was taken from each file so far."""
        ...

    def rest(self, after_s: float) -> int:
        """How many reports come after an instant. It reads all files to their ends."""
        ...


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
    kick_keep: Floats = column_or_none("D")

    @classmethod
    def without_model(
        cls, vessel: Ints, time_s: Floats, position_deg: Floats, velocity_m_s: Floats, present: Bools
    ) -> Trajectories:
        """True motion of which no model is known. Args: as of the fields."""
        v, nan = len(vessel), np.nan
        return cls(
            vessel,
            time_s,
            position_deg,
            velocity_m_s,
            present,
            kick_s=np.zeros((v, 0)),
            kick_m_s=np.full(v, nan),
            turn_rate_rad_s=np.full(v, nan),
            acceleration_m_s2=np.full((v, 2), nan),
        )

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
    site_error_m: Floats = column(np.float64, "R", 2)  # how far the stated site is east and north of the true one
    ais_position_sigma_m: float = 0.0  # per axis
    ais_velocity_sigma_m_s: float = 0.0  # per axis


@dataclass(frozen=True)
class Fault:
    """Records refused for one reason: how many, and where the first one stood."""

    kind: str  # short, fixed words: "checksum", "latitude out of range", "not an MMSI", ...
    count: int
    where: str  # "file:line" or "file, row 12, column sog"
    example: str  # the record, cut to 80 characters
    used: bool = False  # the records are used all the same: this is a note about them

    @property
    def first(self) -> str:
        """Where the first one stood, and the record if there is one."""
        return f"{self.where}: {self.example}" if self.example else self.where


@dataclass(frozen=True)
class FileContent:
    """What was taken from one file of the input."""

    name: str
    kind: str  # what its records are: "AIS reports", "radar plots", ...
    records: int  # taken
    first_s: float  # time of the records taken; NaN if there is none
    last_s: float
    columns: tuple[tuple[str, str], ...] = ()  # of a table: our name and the file's, of each column that was read
    ignored: tuple[str, ...] = ()  # columns that were not read
    notes: tuple[str, ...] = ()  # what was assumed, in sentences
    box_deg: tuple[float, float, float, float] | None = (
        None  # south, west, north, east of the positions taken; None: it has none
    )
    doubts: tuple[str, ...] = ()  # what looks wrong about its values, in sentences
    read: int = 0  # lines or rows with content so far, as they were counted when they were read; one that holds two records counts twice
    beside: tuple[
        tuple[str, int], ...
    ] = ()  # records that are neither in `records` nor in a fault: what they are, and how many


@dataclass(frozen=True, eq=False)
class Recording:
    """All the input of one run: reports in order of arrival, truth where there is any, and refused records."""

    reports: Reports | ReportStream
    truth: Trajectories | None = None
    faults: tuple[Fault, ...] = ()  # of what is read at once; those of a stream are counted as it is read
    silenced: tuple[int, ...] = ()  # origins whose AIS was switched off on purpose
    noise: Noise | None = None  # of simulated sensors
    contents: tuple[FileContent, ...] = ()  # of the files that are read at once
    feeds: tuple[str, ...] = ()  # names of the feeds of AIS, by number
    beside: Reports = field(default_factory=Reports)  # of a simulated stream: all its reports but video, for scores

    def for_scores(self) -> Reports:
        """All reports but video, as often as asked; of a stream those that are known."""
        return self.reports if isinstance(self.reports, Reports) else self.beside

    def whole(self) -> Reports:
        """All reports; of a stream those that are left, which empties it."""
        return self.reports if isinstance(self.reports, Reports) else self.reports.between(-math.inf, math.inf)

    def of_first_cycle(self, start_s: float, until_s: float) -> Reports:
        """The reports up to the end of the first cycle; of a stream only the last hour before the start of the run.

        A file may begin a day before the run, and its reports would not fit in memory.
        """
        return self.reports.between(-math.inf if isinstance(self.reports, Reports) else start_s - EARLIER_S, until_s)

    def rest(self, after_s: float) -> int:
        """How many reports come after an instant. A stream is read to its end."""
        if not isinstance(self.reports, Reports):
            return self.reports.rest(after_s)
        return len(self.reports.between(after_s, math.inf))

    def all_faults(self) -> tuple[Fault, ...]:
        """The records that were refused or set aside so far."""
        return self.faults + (() if isinstance(self.reports, Reports) else self.reports.faults())

    def all_contents(self) -> tuple[FileContent, ...]:
        """What was taken from each file so far."""
        return self.contents + (() if isinstance(self.reports, Reports) else self.reports.contents())
