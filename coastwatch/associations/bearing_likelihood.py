"""Bearing association by likelihood: a vessel of the picture against a vessel that nobody else has seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.associations.bearing_history import Path
from coastwatch.associations.bearing_sensors import Calibration, Known, arcs
from coastwatch.associations.bearing_signatures import ShipTypes, signature_gain
from coastwatch.batches import (
    CLASSES,
    AisStatics,
    Array,
    BearingAssociations,
    BearingTracks,
    Bools,
    Floats,
    Ints,
    Octants,
    Picture,
    Sensors,
)
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.bearings.signatures import check_confusion, even_confusion
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Groups, Method, Shared, Spread, room_of

Positive = Annotated[float, Field(gt=0.0)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]

SOON = 1.2  # ranges of a sensor: nearer vessels are remembered, for they may soon be heard
RANGE_SHARES = np.array([1.0, 0.5, 0.25, 0.1])
RANGE_WEIGHTS = RANGE_SHARES**2 / (RANGE_SHARES**2).sum()  # by the area that each stands for


@dataclass(frozen=True, eq=False)
class LikelihoodMemory:
    path: Path  # of vessels in reach of a sensor of bearings: Earth-centred position, standard deviation per axis
    calibration: Calibration  # of no sensor before the first cycle
    types: ShipTypes


class BearingLikelihood(Method):
    """One-to-one pairs that explain the bearings of a sensor best; what no vessel explains well is of an unknown vessel.

    The statistic of a pair is its log odds: the likelihood of the window of bearings given the path of the vessel (white noise of the
    sensor's specification, a position error correlated in time, what is not known of the sensor's bias) over that given an
    unknown vessel anywhere in reach, times the prior odds. The bias of each sensor is the running median residual of its pairs.
    That a vessel outside the nominal coverage is heard is at first as likely as not; each sensor's pairs then tell. A vessel that was
    outside at any bearing of the window counts as outside.
    Where a sensor tells the class of a vessel by its sound, the log odds of a pair gain what that says of the ship type in its AIS.
    Position errors three times those that the picture admits (30 m for 10 m) cost 2 to 3 points of F1, six times over 10, nearly all
    of it partners missed, and there a longer window makes it worse.
    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, ch. 8-9 (likelihood ratio association); the null
    hypothesis and the numbers are ours: scaling/decisions/bearing_association.py.
    """

    method: Literal["bearing_likelihood"] = "bearing_likelihood"
    threshold: float = 0.0  # log odds that a pair must have
    window_s: Positive = 300.0  # bearings and paths older than this are not looked at
    spacing_s: Positive = 1.0  # instants of the paths are no closer than this
    heard: Share = 0.95  # that a vessel inside the coverage of a sensor has a track of it
    unknown: Share = 0.05  # at least this share of a sensor's tracks are of vessels that are not in the picture
    unknown_speed_kn: Positive = 7.0  # standard deviation per axis, of such a vessel
    unknown_kick_m_s2: Positive = 0.1  # its changes of course and speed: standard deviation per axis grows so over a second
    position_floor_m: Annotated[float, Field(ge=0.0)] = 3.0  # position errors that no covariance tells (hull, antenna)
    position_unknown_m: Positive = 15.0  # standard deviation per axis where a vessel has no covariance
    position_memory_s: Positive = 20.0  # correlation time of position errors
    settle_s: Annotated[float, Field(ge=0.0)] = (
        20.0  # a vessel known for less, and worse than the next setting, is not compared
    )
    settled_m: Positive = 15.0  # standard deviation per axis: the first guesses of a track err by more than they admit
    bias_sigma_deg: Annotated[float, Field(ge=0.0)] = 0.5  # of an uncalibrated sensor; 0: sensors have none
    bias_floor_deg: Annotated[float, Field(ge=0.0)] = 0.03  # what remains unknown of it at best
    bias_gain: Annotated[float, Field(ge=0.0, le=1.0)] = (
        0.2  # share of the median residual taken over in a cycle; 0: no calibration
    )
    bias_pairs: Annotated[int, Field(ge=1)] = 5  # fewer calibrate nothing
    signature_accuracy: Share = 0.7  # taken for the share of right classes by sound, the others said equally often
    signature_confusion: tuple[tuple[Share, ...], ...] = ()  # instead: a row for each true class, how often each is said
    signature_habit: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.8  # share of looks that only repeat the sensor's usual answer
    type_doubt: Share = 0.05  # that a ship is not of the class that its AIS says
    give_up: Annotated[float, Field(lt=0.0)] = -25.0  # log odds at which a pair is not looked at any further

    @model_validator(mode="after")
    def _confusion_is_a_matrix(self) -> Self:
        check_confusion("signature_confusion", self.signature_confusion, CLASSES)
        return self

    def init(self) -> LikelihoodMemory:
        return LikelihoodMemory(Path.empty(), Calibration.of(0, 0.0), ShipTypes.empty())

    def step(
        self,
        memory: LikelihoodMemory,
        bearing_tracks: BearingTracks,
        picture: Picture,
        octants: Octants,
        time_s: float,
        sensors: Sensors,
        spread: Spread,
        statics: AisStatics,
    ) -> tuple[LikelihoodMemory, BearingAssociations]:
        """Which bearing track is which vessel at this cycle.

        Args: bearing_tracks: (N); picture: (V); octants: pairs of their rows; time_s: of the cycle, to which both are predicted;
        statics: that arrived since the last cycle, for their ship types.
        Returns: memory and BearingAssociations, sorted by bearing_row.
        """
        learnt = memory.calibration
        if len(learnt.bias_rad) != len(sensors.sonars):
            learnt = Calibration.of(len(sensors.sonars), float(np.radians(self.bias_sigma_deg)))
        types = memory.types.heard(statics)
        known = Known.of(bearing_tracks, picture, octants, sensors)
        path = self._path(memory.path, picture, known, time_s, sensors, room_of(spread))
        row, gain, residual = self._scored(path, bearing_tracks, picture, octants, sensors, learnt, known, types, spread)
        bearing_row, vessel_row = octants.bearing_row[row], octants.vessel_row[row]
        sonar = octants.octant[row] // 8
        pair = known.at(sonar, vessel_row)
        chosen = _one_to_one(bearing_row, pair, gain - self.threshold, len(bearing_tracks), len(known.sonar))
        bearing_row, vessel_row, sonar = bearing_row[chosen], vessel_row[chosen], sonar[chosen]
        limits = np.radians([self.bias_floor_deg, self.bias_sigma_deg]).tolist()
        learnt = learnt.with_bias(sonar, residual[chosen], self.bias_gain, self.bias_pairs, *limits)
        learnt = learnt.with_heard(known, pair[chosen])
        return LikelihoodMemory(path, learnt, types), BearingAssociations(
            bearing_row, vessel_row, gain[chosen], learnt.bias_rad
        )

    def _path(
        self, path: Path, picture: Picture, known: Known, time_s: float, sensors: Sensors, room: Callable[..., Array]
    ) -> Path:
        """The paths of the vessels that are, or soon may be, compared with bearings, one instant longer."""

        soon, *_ = kernels.geometry.sensor_coverage.near_sites(
            picture.position_deg, sensors.sonars.site_deg, SOON * sensors.sonars.range_m
        )
        rows = np.flatnonzero(_mask(soon, len(picture)) | _mask(known.vessel_row, len(picture)))
        variance = 0.5 * (picture.covariance[rows, 0, 0] + picture.covariance[rows, 1, 1])
        variance = np.where(np.isfinite(variance), variance, self.position_unknown_m**2) + self.position_floor_m**2
        values = np.column_stack([kernels.geometry.ellipsoid.ecef_of_rows(picture.position_deg, rows), np.sqrt(variance)])
        values[(time_s - picture.since_s[rows] < self.settle_s) & (variance > self.settled_m**2)] = np.nan
        return path.extended(picture.vessel_id[rows], values, time_s, self.window_s, self.spacing_s, room)

    def _scored(
        self,
        path: Path,
        tracks: BearingTracks,
        picture: Picture,
        octants: Octants,
        sensors: Sensors,
        learnt: Calibration,
        known: Known,
        types: ShipTypes,
        spread: Spread,
    ) -> tuple[Ints, Floats, Floats]:
        """Pairs above the threshold: index into the octants, log odds, mean difference of bearings; sorted by index."""
        sonar = tracks.source - sensors.sonar_source(0)
        arc_from, arc_width = arcs(sensors)
        there = np.flatnonzero(_mask(known.vessel_row, len(picture)))
        slot = np.full(len(picture), -1, np.int64)
        slot[there] = path.slots(picture.vessel_id[there])
        arrays = {
            "first_pair": known.first_pair,
            "vessel": slot[octants.vessel_row],
            "time": tracks.window_time_s,
            "bearing": tracks.window_bearing_rad,
            "site": tracks.window_site_deg,
            "instant": path.time_s,
            "path": path.values,
            "density": self._density(sonar, known, sensors),
            "outside": learnt.heard_outside(self.heard)[sonar],
            "reach": sensors.sonars.range_m[sonar],
            "arc_from": arc_from[sonar],
            "arc_width": arc_width[sonar],
            "bias": learnt.bias_rad[sonar],
            "bias_variance": learnt.bias_sigma_rad[sonar] ** 2,
            "variance": sensors.sonars.bearing_sigma_rad[sonar] ** 2,
            **self._sounds(tracks, picture, octants, types),
        }
        parts = spread(score_octants, self, arrays, known.octants)
        row = np.concatenate([np.zeros(0, np.int64), *(p[0] for p in parts)])
        order = np.argsort(row, kind="stable")
        gain, residual = (np.concatenate([np.zeros(0), *(p[k] for p in parts)])[order] for k in (1, 2))
        return row[order], gain, residual

    def _sounds(self, tracks: BearingTracks, picture: Picture, octants: Octants, types: ShipTypes) -> dict[str, Array]:
        """What log odds gain by the sound of each track, for each class of vessel, (N, C + 1), and the class of the vessel of each
        pair, (A,). Empty where nothing was heard of any class."""
        if not tracks.signatures.any():
            return {"signature": np.zeros((0, CLASSES + 1)), "vessel_class": np.zeros(0, np.int64)}
        confusion = even_confusion(self.signature_accuracy, CLASSES)
        if self.signature_confusion:
            confusion = np.array(self.signature_confusion)
        classes = types.of(picture.mmsi)
        gain = signature_gain(tracks.signatures, classes, confusion, self.signature_habit, self.type_doubt)
        return {"signature": gain, "vessel_class": classes[octants.vessel_row]}

    def _density(self, sonar: Ints, known: Known, sensors: Sensors) -> Floats:
        """Log density of unknown vessels by bearing, for each track: the sensor says how many vessels there are, the picture how
        many of them are known. Args: sonar: (N,). Returns: (N,)."""
        heard = np.bincount(sonar, minlength=len(sensors.sonars))
        expected = self.heard * known.inside_count(len(sensors.sonars))
        unseen = np.maximum(heard - expected, np.maximum(self.unknown * heard, 0.5))
        return np.asarray(np.log(unseen / arcs(sensors)[1])[sonar])


def score_octants(settings: BearingLikelihood, arrays: Shared, octants: Groups) -> tuple[Array, ...]:
    """Pairs of the bearing tracks of these octants that are above the threshold: index of the pair, log odds, mean difference of
    bearings. A pair's answer is its own alone."""

    track, first = octants.row, arrays["first_pair"]
    windows = kernels.bearings.windows.Windows(**{name: arrays[name] for name in kernels.bearings.windows.Windows._fields})
    strangers = kernels.bearings.null_hypothesis.Strangers(
        RANGE_SHARES, RANGE_WEIGHTS, settings.unknown_speed_kn * KNOT_M_S, settings.unknown_kick_m_s2**2
    )
    null = kernels.bearings.null_hypothesis.unknown_vessels(
        track, windows.time, windows.bearing, windows.variance, windows.reach, strangers
    )
    table = kernels.association.history.addresses(arrays["path"], kernels.bearings.windows.PLACES)[::-1].copy()
    paths = kernels.bearings.windows.Paths(arrays["instant"], table, np.array([len(a) for a in arrays["path"]], np.int64))
    start, slot = kernels.bearings.candidates.pairs_of(track, first, arrays["vessel"])
    gain, residual = np.empty(len(slot)), np.empty(len(slot))
    rule = kernels.bearings.windows.Rule(
        settings.heard, float(np.log(settings.heard / (1.0 - settings.heard))), settings.position_memory_s, settings.give_up
    )
    in_blocks(
        kernels.bearings.likelihood.known_vessels,
        len(track),
        track,
        start,
        slot,
        windows,
        null,
        paths,
        rule,
        gain,
        residual,
        least=64,
    )
    if len(arrays["signature"]):
        vessel_class = kernels.bearings.candidates.pairs_of(track, first, arrays["vessel_class"])[1]
        gain += arrays["signature"][np.repeat(track, np.diff(start)), vessel_class]
    which, pair = kernels.bearings.candidates.above(track, first, start, gain, settings.threshold)
    return pair, gain[which], residual[which]


def _one_to_one(bearing_row: Ints, pair: Ints, gain: Floats, tracks: int, pairs: int) -> Bools:
    """Which pairs are in the assignment with the greatest sum of gains, each left and right at most once.

    Args: bearing_row: (A,) 0 to tracks - 1; pair: (A,) of `Known`, 0 to pairs - 1; gain: (A,) positive.
    """

    order, out = kernels.tables.groups.by_both(bearing_row, tracks, pair, pairs), np.empty(len(gain), np.bool_)
    out[order] = kernels.association.assignment.assign_numbered(bearing_row[order], pair[order], gain[order], tracks, pairs)
    return out


def _mask(rows: Ints, count: int) -> Bools:
    out = np.zeros(count, np.bool_)
    out[rows] = True
    return out
