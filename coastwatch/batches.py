"""Every kind of data that flows: shapes, units, axis letters. The first file to read.

Axis letters, fixed once:
    M reports or plots      N tracks          V vessels (truth, fused, picture)     A associated pairs
    K spots                 W window          L members (track in vessel)           H halo entries
    T instants              J models of an IMM (kernels only)

Positions are latitude, longitude in degrees (WGS 84); velocities are metres a second east, north; times are seconds since
the Unix epoch, UTC. A covariance of a track is of east, north, east rate, north rate in the local tangent plane at the track.
An absent value is NaN, or -1 for a number that names something. `origin` is the number of the true vessel behind a row where
input is simulated, -1 elsewhere: scores read it, methods do not (one that does says "known origin" in its name of setting).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum, IntFlag
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def column(dtype: Any, *shape: str | int) -> Any:
    """A field that holds an array of this dtype and shape; a letter in the shape is one size throughout the struct."""
    return field(metadata={"dtype": np.dtype(dtype), "shape": shape})


@dataclass(frozen=True, eq=False)
class Struct:
    """Arrays that belong together, checked when made.

    Raises: TypeError or ValueError that names the field, what it got and what it needed.
    """

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for f in fields(self):
            if "shape" not in f.metadata:
                continue
            self._check(f.name, getattr(self, f.name), f.metadata["dtype"], f.metadata["shape"], sizes)

    def _check(self, name: str, got: Any, dtype: np.dtype[Any], shape: tuple[str | int, ...], sizes: dict[str, int]) -> None:
        where = f"{type(self).__name__}.{name}"
        if not isinstance(got, np.ndarray):
            raise TypeError(f"{where}: got {type(got).__name__}, needed an array")
        if got.dtype.kind != dtype.kind or (dtype.kind != "U" and got.dtype != dtype):
            raise TypeError(f"{where}: got dtype {got.dtype}, needed {dtype}")
        need = tuple(sizes.get(s, "any") if isinstance(s, str) else s for s in shape)
        if got.ndim != len(shape) or any(n not in ("any", g) for n, g in zip(need, got.shape, strict=True)):
            raise ValueError(f"{where}: got shape {got.shape}, needed {shape} with {sizes}")
        sizes.update({s: g for s, g in zip(shape, got.shape, strict=True) if isinstance(s, str)})


@dataclass(frozen=True, eq=False)
class Batch(Struct):
    """A Struct whose every column has the same first axis: rows can be counted, taken and joined."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, rows: Array) -> Self:
        """The rows at these indices or under this mask, in that order."""
        return type(self)(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def join(cls, parts: list[Self]) -> Self:
        """The rows of all parts, one after the other; no part gives an empty batch."""
        if not parts:
            return cls.empty()
        return cls(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)})

    @classmethod
    def empty(cls, **sizes: int) -> Self:
        """No rows. Letters other than the first take their size from the arguments, 0 where not given."""
        made = {}
        for f in fields(cls):
            shape = f.metadata["shape"]
            rest = [s if isinstance(s, int) else sizes.get(s, 0) for s in shape[1:]]
            made[f.name] = np.zeros((0, *rest), f.metadata["dtype"])
        return cls(**made)


# ---- what sensors say -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RadarReports(Batch):
    """What radars said, in their own coordinates, in order of arrival."""

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
    """What passive sonars, cameras and direction finders said, in order of arrival."""

    sensor: Ints = column(np.int64, "M")  # index into the scenario's sonars
    time_s: Floats = column(np.float64, "M")
    received_s: Floats = column(np.float64, "M")
    bearing_deg: Floats = column(np.float64, "M")  # true, 0..360
    contact: Ints = column(np.int64, "M")  # the sensor's own track number; -1 where it gives none
    site_deg: Floats = column(np.float64, "M", 2)
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
    """Where simulated (or surveyed) vessels really were at one instant."""

    vessel: Ints = column(np.int64, "V")
    time_s: Floats = column(np.float64, "V")
    position_deg: Floats = column(np.float64, "V", 2)
    velocity_m_s: Floats = column(np.float64, "V", 2)


@dataclass(frozen=True, eq=False)
class Trajectories(Struct):
    """True motion of vessels, sampled at common instants, with what the physical bound needs to know of the motion model."""

    vessel: Ints = column(np.int64, "V")
    time_s: Floats = column(np.float64, "T")  # increasing
    position_deg: Floats = column(np.float64, "V", "T", 2)
    velocity_m_s: Floats = column(np.float64, "V", "T", 2)
    present: Bools = column(np.bool_, "V", "T")
    kick_s: Floats = column(np.float64, "V", "B")  # when the velocity was perturbed; NaN pads; no column: not simulated
    kick_m_s: Floats = column(np.float64, "V")  # standard deviation of each perturbation, per axis
    turn_rate_rad_s: Floats = column(np.float64, "V")  # known and constant, 0 for straight motion
    acceleration_m_s2: Floats = column(np.float64, "V", 2)  # known and constant while accelerating
    # What a perturbation leaves of the deviation from the mean velocity; empty: all of it, a random walk.
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
    """Records of one kind that could not be taken, counted, with the first place where one stood."""

    kind: str  # short, fixed words: "checksum", "latitude out of range", "not an MMSI", ...
    count: int
    where: str  # "file:line" or "file, row 12, column sog"
    example: str  # what stood there, cut to 80 characters


@dataclass(frozen=True, eq=False)
class Recording:
    """All the input of one run: reports in order of arrival, truth where there is any, and what was refused."""

    reports: Reports
    start_s: float
    stop_s: float
    truth: Trajectories | None = None
    faults: tuple[Fault, ...] = ()
    silenced: tuple[int, ...] = ()  # origins whose AIS was switched off on purpose
    noise: Noise | None = None  # of simulated sensors


# ---- who says it ------------------------------------------------------------------------------------------------------


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


@dataclass(frozen=True, eq=False)
class Stations(Batch):
    """AIS receivers: where AIS would be heard."""

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


@dataclass(frozen=True, eq=False)
class Sensors:
    """All sensors of a scenario. Sources of tracks are numbered: regions first, then AIS, then one for each sonar."""

    radars: Radars
    stations: Stations
    sonars: Sonars
    region_names: tuple[str, ...]
    region_origin_deg: Floats  # (regions, 2)

    @property
    def ais_source(self) -> int:
        return len(self.region_names)

    def sonar_source(self, sonar: int) -> int:
        return len(self.region_names) + 1 + sonar

    @property
    def source_names(self) -> tuple[str, ...]:
        return (*self.region_names, "ais", *(str(n) for n in self.sonars.name))

    @property
    def source_kinds(self) -> Ints:
        """SourceKind of each source."""
        kinds = [0] * len(self.region_names) + [1] + [2] * len(self.sonars)
        return np.array(kinds, np.int64)


# ---- what we make of it -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plots(Batch):
    """Radar reports in the plane of a region (metres east and north of its origin), in order of arrival."""

    sensor: Ints = column(np.int64, "M")
    region: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")
    position_m: Floats = column(np.float64, "M", 2)
    covariance: Floats = column(np.float64, "M", 2, 2)
    site_m: Floats = column(np.float64, "M", 2)
    origin: Ints = column(np.int64, "M")


@dataclass(frozen=True, eq=False)
class Tracks(Batch):
    """Confirmed tracks of any source that have a position, all predicted to one time."""

    track_id: Ints = column(np.int64, "N")  # never reused
    source: Ints = column(np.int64, "N")  # index into the scenario's sources
    time_s: Floats = column(np.float64, "N")
    position_deg: Floats = column(np.float64, "N", 2)
    velocity_m_s: Floats = column(np.float64, "N", 2)
    covariance: Floats = column(np.float64, "N", 4, 4)  # NaN where the source gives none
    report_covariance: Floats = column(np.float64, "N", 2, 2)  # of one report of the sensor at this place, by its specification
    updated_s: Floats = column(np.float64, "N")  # of the newest report in the track
    started_s: Floats = column(np.float64, "N")
    mmsi: Ints = column(np.int64, "N")  # -1 where there is none
    origin: Ints = column(np.int64, "N")

    def known_covariance(self, velocity_sigma_m_s: float) -> Floats:
        """The covariances, and where a source gives none that of one report and of a velocity known so well. (N, 4, 4)"""
        out = self.covariance.copy()
        unknown = ~np.isfinite(out).all(axis=(1, 2))
        if unknown.any():
            made = np.zeros((int(unknown.sum()), 4, 4))
            made[:, :2, :2] = self.report_covariance[unknown]
            made[:, 2, 2] = made[:, 3, 3] = velocity_sigma_m_s**2
            out[unknown] = made
        return out


@dataclass(frozen=True, eq=False)
class AisAlarms(Batch):
    """What is odd about AIS tracks; one row a track of the Tracks of the same step."""

    track_id: Ints = column(np.int64, "N")
    mmsi: Ints = column(np.int64, "N")
    impossible_speed: Bools = column(np.bool_, "N")  # a report lately needed a speed that no ship has
    twice: Bools = column(np.bool_, "N")  # its MMSI is heard from two places


@dataclass(frozen=True, eq=False)
class BearingTracks(Batch):
    """Tracks that have only a bearing, with the newest W bearings behind them, oldest first, NaN before the first."""

    track_id: Ints = column(np.int64, "N")
    source: Ints = column(np.int64, "N")
    time_s: Floats = column(np.float64, "N")
    bearing_rad: Floats = column(np.float64, "N")  # clockwise from true north, -pi..pi
    rate_rad_s: Floats = column(np.float64, "N")
    covariance: Floats = column(np.float64, "N", 2, 2)  # of bearing and rate
    site_deg: Floats = column(np.float64, "N", 2)
    updated_s: Floats = column(np.float64, "N")
    started_s: Floats = column(np.float64, "N")
    window_time_s: Floats = column(np.float64, "N", "W")
    window_bearing_rad: Floats = column(np.float64, "N", "W")
    window_site_deg: Floats = column(np.float64, "N", "W", 2)
    origin: Ints = column(np.int64, "N")


@dataclass(frozen=True, eq=False)
class Spots(Struct):
    """Groups of neighbouring tracks. Each track is a member of one spot and may stand in the halo of others."""

    centre_m: Floats = column(np.float64, "K", 3)  # Earth-centred
    spot: Ints = column(np.int64, "N")  # of each track row
    halo_spot: Ints = column(np.int64, "H")  # sorted
    halo_row: Ints = column(np.int64, "H")


@dataclass(frozen=True, eq=False)
class Octants(Struct):
    """For each sensor of bearings, which bearing tracks may be compared with which vessels: pairs of rows, sorted."""

    bearing_row: Ints = column(np.int64, "A")
    vessel_row: Ints = column(np.int64, "A")
    octant: Ints = column(np.int64, "A")  # sensor * 8 + sector


@dataclass(frozen=True, eq=False)
class Associations(Struct):
    """Which tracks are the same vessel."""

    first: Ints = column(np.int64, "A")  # row of a track
    second: Ints = column(np.int64, "A")  # row of its partner, of another source
    statistic: Floats = column(np.float64, "A")  # the method's own; its docstring says of what
    vessel: Ints = column(np.int64, "N")  # of each track row: 0..V-1, every vessel has at least one track


@dataclass(frozen=True, eq=False)
class FusedTracks(Batch):
    """One row for each `Associations.vessel`: the estimate from all of its tracks."""

    time_s: Floats = column(np.float64, "V")
    position_deg: Floats = column(np.float64, "V", 2)
    velocity_m_s: Floats = column(np.float64, "V", 2)
    covariance: Floats = column(np.float64, "V", 4, 4)


@dataclass(frozen=True, eq=False)
class BearingAssociations(Struct):
    """Which bearing track is which vessel."""

    bearing_row: Ints = column(np.int64, "A")
    vessel_row: Ints = column(np.int64, "A")
    statistic: Floats = column(np.float64, "A")
    sensor_bias_rad: Floats = column(np.float64, "K")  # the bearing offset of each bearing source, as calibrated so far


@dataclass(frozen=True, eq=False)
class Picture(Batch):
    """Each vessel once."""

    vessel_id: Ints = column(np.int64, "V")  # never an MMSI, never reused
    time_s: Floats = column(np.float64, "V")
    position_deg: Floats = column(np.float64, "V", 2)
    velocity_m_s: Floats = column(np.float64, "V", 2)
    covariance: Floats = column(np.float64, "V", 4, 4)
    since_s: Floats = column(np.float64, "V")  # when the vessel was first seen
    updated_s: Floats = column(np.float64, "V")  # newest report of any source
    mmsi: Ints = column(np.int64, "V")  # -1 where there is none
    flags: Ints = column(np.int64, "V")  # sum of Flag
    origin: Ints = column(np.int64, "V")


@dataclass(frozen=True, eq=False)
class Members(Batch):
    """Which tracks of which sources are in which vessel of the picture, sorted by vessel_id, then source."""

    vessel_id: Ints = column(np.int64, "L")
    track_id: Ints = column(np.int64, "L")
    source: Ints = column(np.int64, "L")


class Flag(IntFlag):
    """What an operator should look at."""

    DARK = 1  # radar sees it inside AIS coverage, no AIS
    AIS_WITHOUT_RADAR = 2  # AIS says it is there, a radar that should see it does not
    AIS_CONTRADICTED = 4  # AIS and radar of one vessel have come apart
    MMSI_TWICE = 8  # its MMSI is heard from two places
    IMPOSSIBLE_SPEED = 16  # consecutive AIS reports need a speed no ship has
    COASTING = 32  # no track supports it now; predicted


class SourceKind(IntEnum):
    RADAR = 0  # tracks of a region's radars
    AIS = 1
    BEARING = 2
