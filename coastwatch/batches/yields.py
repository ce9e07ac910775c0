"""Outputs of the stages, in the order of the flow."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from coastwatch import kernels
from coastwatch.batches.ais_codes import CLASSES
from coastwatch.batches.struct import Batch, Struct, column, column_or_none, optional_column
from coastwatch.kernels.arrays import Array, Bools, Floats, Ints, Rows


@dataclass(frozen=True, eq=False)
class Plots(Batch):
    """Radar reports in the plane of a region (metres east and north of its origin), in order of arrival."""

    sensor: Ints = column(np.int64, "M")
    region: Ints = column(np.int64, "M")
    time_s: Floats = column(np.float64, "M")
    position_m: Floats = column(np.float64, "M", 2)
    covariance: Floats = column(np.float64, "M", 2, 2)
    site_m: Floats = column(np.float64, "M", 2)  # the antenna
    range_m: Floats = column(np.float64, "M")  # as measured, less the corrections
    azimuth_rad: Floats = column(np.float64, "M")
    origin: Ints = column(np.int64, "M")
    extent: Floats = optional_column("M", 3)  # second moments of the ship, m2: east, east and north, north; NaN: not measured
    weight: Floats = optional_column("M")  # of the echo: sum of its amplitudes; NaN: not measured


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
    held_mmsi: Ints = optional_column("N", dtype=np.int64)  # of a radar track: whose AIS messages are in it; -1: nobody's
    existence: Floats = optional_column("N")  # probability that there is a vessel; NaN: not estimated
    echo_length_m: Floats = optional_column("N")  # of the ship, by radar video; NaN: not known, here and below
    echo_width_m: Floats = optional_column("N")
    # Of its length, clockwise from north; under 1 kn 0 to 180, as bow and stern look alike
    echo_axis_deg: Floats = optional_column("N")
    alternative_m: Floats = optional_column("N")  # how far away it may be instead, by another history; NaN: it is sure

    def known_covariance(self, velocity_sigma_m_s: float) -> Floats:
        """The covariances; where a source gives none, that of one report and of this standard deviation of velocity. (N, 4, 4)"""
        out = self.covariance.copy()
        unknown = ~np.isfinite(out).all(axis=(1, 2))
        if unknown.any():
            made = np.zeros((int(unknown.sum()), 4, 4))
            made[:, :2, :2] = self.report_covariance[unknown]
            made[:, 2, 2] = made[:, 3, 3] = velocity_sigma_m_s**2
            out[unknown] = made
        return out


@dataclass(frozen=True, eq=False)
class HullOffsets(Batch):
    """How far AIS positions of large ships may lie from the middle of their echo, sorted by MMSI."""

    mmsi: Ints = column(np.int64, "K")
    sigma_m: Floats = column(np.float64, "K")  # standard deviation
    moves: Bools = column(np.bool_, "K")  # from the antenna to the middle of the hull, or back: no fixed distance now


@dataclass(frozen=True, eq=False)
class Measurements(Batch):
    """Plots and AIS reports that went into the Tracks of the same step, sorted by track_id, then time."""

    track_id: Ints = column(np.int64, "M")
    sensor: Ints = column(np.int64, "M")  # radar; -1: AIS
    time_s: Floats = column(np.float64, "M")  # of the measurement; those that came late are older than the cycle before
    position_deg: Floats = column(np.float64, "M", 2)
    velocity_m_s: Floats = column(np.float64, "M", 2)  # NaN where none was measured
    covariance: Floats = column(np.float64, "M", 4, 4)  # in the tangent plane at the position; NaN where nothing was measured
    site_deg: Floats = column(np.float64, "M", 2)  # of the radar's antenna; NaN for AIS


@dataclass(frozen=True, eq=False)
class Messages(Batch):
    """AIS reports as measurements for the radar tracker of a region, in its plane."""

    time_s: Floats = column(np.float64, "M")
    position_m: Floats = column(np.float64, "M", 2)
    covariance: Floats = column(np.float64, "M", 2, 2)
    mmsi: Ints = column(np.int64, "M")
    origin: Ints = column(np.int64, "M")
    velocity_m_s: Floats = optional_column("M", 2)  # NaN where none was sent, or none is believed
    velocity_covariance: Floats = optional_column("M", 2, 2)  # its errors are independent of those of the position
    interval_s: Floats = optional_column("M")  # expected until the next one of the vessel


@dataclass(frozen=True, eq=False)
class AisAlarms(Batch):
    """What AIS reports say of a vessel beside its motion, and suspicions; one row for each AIS track of the same step."""

    track_id: Ints = column(np.int64, "N")
    mmsi: Ints = column(np.int64, "N")
    impossible_speed: Bools = column(np.bool_, "N")  # a recent report stated or needed a speed that no ship has
    twice: Bools = column(np.bool_, "N")  # its MMSI is received from two places
    nav_status: Ints = optional_column("N", dtype=np.int64)  # NavStatus of the newest report; -1: not sent
    interval_s: Floats = optional_column("N")  # expected until the next report: the longer of the nominal and the learnt one


@dataclass(frozen=True, eq=False)
class AisFeeds(Batch):
    """One row for each feed of AIS, by its number."""

    time_jitter_s: Floats = column(np.float64, "F")  # standard deviation of the times of its reports; 0: too small to be told
    delays: Ints = column(np.int64, "F")  # pairs of reports behind it


@dataclass(frozen=True, eq=False)
class TrackSourceStates(Batch):
    """One row for each track source, by its number: what it sent, and how exact its tracks are taken to be."""

    states: Ints = column(np.int64, "R")  # received since the start of the run
    # Of them, since their stamp is no time, in the future, or before that of a newer state
    dropped: Ints = column(np.int64, "R")
    tracks: Ints = column(np.int64, "R")  # that are alive
    position_sigma_m: Floats = column(np.float64, "R")  # per axis, of tracks without covariance: as set, or estimated
    velocity_sigma_m_s: Floats = column(np.float64, "R")
    partners: Ints = column(np.int64, "R")  # differences to AIS partners behind them


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
    window_variance: Floats = column(np.float64, "N", "W")  # of each bearing, rad2; NaN: that of the sensor
    signatures: Ints = column(np.int64, "N", CLASSES)  # number of reports so far of each VesselClass
    origin: Ints = column(np.int64, "N")
    measured_s: Floats = optional_column("N")  # mean time of the bearings of this cycle; NaN: there was none
    measured_rad: Floats = optional_column("N")  # their mean
    measured_variance: Floats = optional_column("N")  # of the mean, rad2
    measured_site_deg: Floats = optional_column("N", 2)  # mean place of the sensor
    # Least probability that a bearing of this cycle is of the track; NaN: not estimated
    certainty: Floats = optional_column("N")


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
    # More pairs, not listed: a track has so many vessels in its octant that the nearest in bearing are listed
    left_out: int = 0


@dataclass(frozen=True)
class Unproven:
    """Choices of the plots of a cluster of tracks that were not proven best within the limit of nodes."""

    count: int = 0
    excess: float = 0.0  # by which their costs exceed their lower bounds, in all: they are too dear by so much at most

    @classmethod
    def of(cls, excess: Floats) -> Unproven:
        """Of some clusters. Args: excess: (C,) by which the cost of each exceeds its lower bound; 0: it is proven."""
        return cls(int(np.count_nonzero(excess)), float(excess.sum()))

    def __add__(self, other: Unproven) -> Unproven:
        return Unproven(self.count + other.count, self.excess + other.excess)


@dataclass(frozen=True, eq=False)
class Associations(Struct):
    """Which tracks are the same vessel."""

    first: Ints = column(np.int64, "A")  # row of a track
    second: Ints = column(np.int64, "A")  # row of its partner, of another source
    statistic: Floats = column(np.float64, "A")  # of the pair; the docstring of the method says which
    vessel: Ints = column(np.int64, "N")  # of each track row: 0..V-1, every vessel has at least one track
    tested: int = 0  # pairs inside the gate
    left_out: int = 0  # more of them that were not tested, at most: where tracks crowd each is compared with the nearest alone
    statistic_is_distance: bool = False  # the smaller the statistic, the likelier is the pair; else the greater

    @cached_property
    def by_vessel(self) -> tuple[Rows, Rows]:
        """Tracks by vessel: start (V + 1,), row (N,). The tracks of vessel v are row[start[v]:start[v + 1]]."""
        start, row = kernels.tables.counting_sort.counting_sort(self.vessel, int(self.vessel.max(initial=-1)) + 1)
        return start, row


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
    probability: Floats = column_or_none("P")  # (A,) that a pair is right; of no pair where the method does not know it
    sensor_bias_sigma_rad: Floats = column_or_none("D")  # (K,) of the offsets; of no source where the method does not know it


@dataclass(frozen=True, eq=False)
class Picture(Batch):
    """One row for each vessel, sorted by vessel_id."""

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
    nav_status: Ints = optional_column("V", dtype=np.int64)  # NavStatus; -1: none was sent
    existence: Floats = optional_column("V")  # probability that it exists, by its likeliest track; NaN: not estimated
    echo_length_m: Floats = optional_column("V")  # by its track with the longest echo, as of `Tracks`, here and below
    echo_width_m: Floats = optional_column("V")
    echo_axis_deg: Floats = optional_column("V")
    alternative_m: Floats = optional_column("V")  # how far away it may be instead, where none of its tracks is sure; else NaN


@dataclass(frozen=True, eq=False)
class Members(Batch):
    """Which tracks of which sources are in which vessel of the picture, sorted by vessel_id, then source."""

    vessel_id: Ints = column(np.int64, "L")
    track_id: Ints = column(np.int64, "L")
    source: Ints = column(np.int64, "L")


def member_rows(members: Members, vessel_id: Ints, bearings: BearingTracks, pairs: BearingAssociations) -> Ints:
    """(L, 3) vessel, source, track: the members, then the bearing tracks that were given to a vessel.

    Args: vessel_id: (V,) of the rows of vessels in `pairs`; bearings: of its rows of bearing tracks.
    """
    of_bearings = vessel_id[pairs.vessel_row], bearings.source[pairs.bearing_row], bearings.track_id[pairs.bearing_row]
    of_tracks = members.vessel_id, members.source, members.track_id
    return np.concatenate([np.stack(columns, 1) for columns in (of_tracks, of_bearings)])


@dataclass(frozen=True, eq=False)
class BearingMembers(Batch):
    """Which bearing track was of which vessel at the end of a cycle: one row for each of the vessel's other tracks."""

    bearing_track_id: Ints = column(np.int64, "B")
    vessel_id: Ints = column(np.int64, "B")
    track_id: Ints = column(np.int64, "B")  # of the vessel, in order of `Members`; -1: it had none
    probability: Floats = column(np.float64, "B")  # that the bearing track is of the vessel; NaN: not known
    bias_rad: Floats = column(np.float64, "B")  # of the bearings
    bias_sigma_rad: Floats = column(np.float64, "B")


@dataclass(frozen=True, eq=False)
class VesselBearings(Batch):
    """The bearings of a cycle, by the vessels that their tracks were of at the end of the cycle before."""

    vessel: Ints = column(np.int64, "B")  # number in Associations; those without a track follow as V, V + 1, ... by vessel_id
    vessel_id: Ints = column(np.int64, "B")
    track_id: Ints = column(np.int64, "B")  # that the vessel had in the cycle before; -1: it had none
    probability: Floats = column(np.float64, "B")  # that the bearing track is of the vessel; NaN: not known
    updated_s: Floats = column(np.float64, "B")  # newest bearing
    time_s: Floats = column(np.float64, "B")  # of the bearings of this cycle; NaN: there was none
    bearing_rad: Floats = column(np.float64, "B")  # less the bias of the sensor
    variance: Floats = column(np.float64, "B")  # rad2
    bias_variance: Floats = column(np.float64, "B")  # rad2
    site_deg: Floats = column(np.float64, "B", 2)


@dataclass(frozen=True, eq=False)
class HeldVessels(Batch):
    """Vessels of the last picture that have no track with a position now, estimated from their bearings."""

    vessel_id: Ints = column(np.int64, "H")
    time_s: Floats = column(np.float64, "H")
    position_deg: Floats = column(np.float64, "H", 2)
    velocity_m_s: Floats = column(np.float64, "H", 2)
    covariance: Floats = column(np.float64, "H", 4, 4)
    updated_s: Floats = column(np.float64, "H")  # newest bearing


@dataclass(frozen=True, eq=False)
class ExpectedVessels(Struct):
    """Vessels of the last picture that sensors of bearings may hear, sorted by vessel_id, and the biases of these sensors."""

    vessel_id: Ints = column(np.int64, "V")
    time_s: Floats = column(np.float64, "V")
    position_deg: Floats = column(np.float64, "V", 2)
    velocity_m_s: Floats = column(np.float64, "V", 2)
    variance_m2: Floats = column(np.float64, "V")  # of the position, per axis; NaN: not known
    bias_rad: Floats = column(np.float64, "K")  # of each sensor of bearings
    bias_sigma_rad: Floats = column(np.float64, "K")  # 0 where the method does not know it


class RegistrationState(IntEnum):
    """How well the registration of a radar is known: unknown, acquiring, probable, found, settled, or doubtful."""

    UNKNOWN = 0  # no AIS vessel in cover, or no plots
    ACQUIRING = 1  # plots are compared with AIS vessels; the odds of the best bias are under 1,000
    SETTLED = 2  # found, and the azimuth bias is known to a quarter of the azimuth noise
    PROBABLE = 3  # odds of 1,000 or more, not enough to apply it
    FOUND = 4  # a bias is applied
    DOUBTFUL = 5  # another one has as much evidence as the one that is applied


@dataclass(frozen=True, eq=False)
class RadarCorrections(Batch):
    """One row for each radar of the scenario: registration errors to subtract from its reports in the next cycle, and its noise."""

    azimuth_bias_rad: Floats = column(np.float64, "R")  # how far its azimuths are clockwise of the truth
    range_bias_m: Floats = column(np.float64, "R")  # how far its ranges are too long
    time_lag_s: Floats = column(np.float64, "R")  # how late its time stamps are
    estimated_lag_s: Floats = column(np.float64, "R", new=np.nan)  # NaN if unknown; it becomes time_lag_s once it is known well
    azimuth_sigma_rad: Floats = column(np.float64, "R", new=np.nan)  # of the estimates; NaN if unknown
    range_sigma_m: Floats = column(np.float64, "R", new=np.nan)
    lag_sigma_s: Floats = column(np.float64, "R", new=np.nan)
    references: Ints = column(np.int64, "R")  # vessels behind the estimate
    residuals: Floats = column(np.float64, "R")  # plots behind it; old ones count less
    state: Ints = column(np.int64, "R")  # RegistrationState
    jumped: Bools = column(np.bool_, "R")  # by so much that tracks of its former plots are misplaced
    compared: Floats = optional_column("R")  # AIS vessels in this cycle; NaN where the radar sent no plot
    candidate_azimuth_rad: Floats = optional_column("R")  # the bias with the most evidence; NaN before the first decision
    candidate_range_m: Floats = optional_column("R")
    odds: Floats = optional_column("R")  # of the candidate against chance
    found_odds: Floats = optional_column("R")  # the same when the bias that is applied was found
    voices: Floats = optional_column("R")  # vessels under way, and squares with vessels at rest, that speak for the candidate
    rival_share: Floats = optional_column("R")  # of all evidence, that the best other bias has
    site_error_m: Floats = optional_column(
        "R", 2, new=0
    )  # how far the stated site is east and north of the true one; 0: not known
    site_sigma_m: Floats = optional_column("R", 2)  # NaN where the site is not estimated
    range_scale: Floats = optional_column("R", new=0)  # by which share of themselves its ranges are too long; 0: not known
    range_scale_sigma: Floats = optional_column("R")  # NaN where it is not estimated
    noise_factor: Floats = optional_column(
        "R", 2, new=1
    )  # times the stated noise that its ranges and azimuths have; 1: as stated


COVER_AZIMUTHS, COVER_RANGES = 72, 16
"""Cells of the cover of a radar: sectors of 5 deg, and rings of a sixteenth of its range."""


@dataclass(frozen=True, eq=False)
class RadarCover(Batch):
    """What each radar detects, by polar cell: sector k is from 5 k deg, clockwise from north, and ring 0 is the innermost."""

    range_m: Floats = column(np.float64, "R")  # outer edge of the last ring
    site_deg: Floats = column(np.float64, "R", 2)  # of the antenna; NaN before its first plot
    turns: Floats = column(np.float64, "R")  # of the antenna; old ones count less, here and below
    # Probability that an AIS vessel is detected in a turn
    ais_detection: Floats = column(np.float64, "R", COVER_AZIMUTHS, COVER_RANGES)
    ais_looks: Floats = column(np.float64, "R", COVER_AZIMUTHS, COVER_RANGES)  # turns behind it, summed over vessels
    # That a confirmed track of plots gets one in a turn
    track_detection: Floats = column(np.float64, "R", COVER_AZIMUTHS, COVER_RANGES)
    track_looks: Floats = column(np.float64, "R", COVER_AZIMUTHS, COVER_RANGES)
    false_plots_per_m2: Floats = column(np.float64, "R", COVER_AZIMUTHS, COVER_RANGES)  # in a turn, of no confirmed track

    def ais_at(self, east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]:
        """`ais_detection` and `ais_looks` at positions within the range of each radar. Args: (K, R) from its antenna. Returns: (K, R)."""
        sector, ring = cover_cell(np.arctan2(east_m, north_m), np.hypot(east_m, north_m), self.range_m)
        radar = np.arange(len(self))
        return self.ais_detection[radar, sector, ring], self.ais_looks[radar, sector, ring]


def cover_cell(azimuth_rad: Floats, distance_m: Floats, range_m: Floats) -> tuple[Ints, Ints]:
    """Sector and ring of the cell of each position; what is beyond the range is in the outermost ring. Args: broadcast together."""
    sector = np.floor(azimuth_rad * (COVER_AZIMUTHS / (2.0 * np.pi))).astype(np.int64) % COVER_AZIMUTHS
    ring = np.clip(distance_m * (COVER_RANGES / range_m), 0.0, COVER_RANGES - 1).astype(np.int64)
    return sector, ring


@dataclass(frozen=True, eq=False)
class StandingEchoes(Batch):
    """What a clutter map hides from the tracker: quays, piles, moored boats. Two radars may see the same one."""

    radar: Ints = column(np.int64, "N")
    position_deg: Floats = column(np.float64, "N", 2)
    extent_m: Floats = column(np.float64, "N")  # how far its cells reach from corner to corner
    plots_per_turn: Floats = column(np.float64, "N")
    turns: Floats = column(np.float64, "N")  # of the antenna, in which it was learnt


@dataclass(frozen=True, eq=False)
class DecidedPath(Batch):
    """States of radar tracks in the past, at plots whose choice has become final, smoothed by the plots after them."""

    track_id: Ints = column(np.int64, "N")
    time_s: Floats = column(np.float64, "N")  # of the plot or message
    position_deg: Floats = column(np.float64, "N", 2)
    velocity_m_s: Floats = column(np.float64, "N", 2)  # east, north
    covariance: Floats = column(np.float64, "N", 4, 4)  # east, north, and their rates, in the tangent plane at the position
    radar: Ints = column(np.int64, "N")  # number of the radar; -1: an AIS message


@dataclass(frozen=True, eq=False)
class AisDetection(Batch):
    """How probably radars detect vessels with AIS; vessels out of range of all radars are left out."""

    track_id: Ints = column(np.int64, "N")  # of AIS
    probability: Floats = column(np.float64, "N")  # of the radar with the best chance, in one turn, by what other vessels show


@dataclass(frozen=True, eq=False)
class VesselAlarms(Batch):
    """The alarms that hold in a cycle, sorted by vessel, kind and subject; each of them once."""

    vessel_id: Ints = column(np.int64, "A")  # 0: of a sensor
    kind: Ints = column(np.int64, "A")  # AlarmKind
    subject: Ints = column(np.int64, "A")  # number of the zone, id of the other vessel, or number of the sensor; 0: none
    name: Array = column("U64", "A")  # of the zone or sensor
    position_deg: Floats = column(np.float64, "A", 2)  # of the vessel, last known, or of the sensor
    velocity_m_s: Floats = column(np.float64, "A", 2)
    mmsi: Ints = column(np.int64, "A")
    distance_m: Floats = column(np.float64, "A")  # at the closest approach, or from the anchorage; NaN: none of them
    range_m: Floats = column(np.float64, "A")  # to the other vessel now
    interval_s: Floats = column(np.float64, "A")  # to the closest approach, inside a zone, at rest, or without a report
    to_right: Floats = column(np.float64, "A")  # of a line as it was drawn: 1, to its left: -1


def joint_keys(*sets: tuple[Ints, Ints]) -> list[Ints]:
    """One whole number for each pair of a key and a subject, in the same order as the pairs, and equal for equal pairs of all sets.

    Args: sets: keys (K,) and subjects (K,) of 0 or more, most of them 0.
    """
    subjects = np.unique(np.concatenate([subject[subject != 0] for _, subject in sets]))
    steps = len(subjects) + 1
    return [key * steps + np.where(subject != 0, np.searchsorted(subjects, subject) + 1, 0) for key, subject in sets]
