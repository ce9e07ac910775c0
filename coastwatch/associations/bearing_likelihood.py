"""Bearing association by likelihood ratio: a vessel of the picture against an unknown vessel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.associations.bearing_bias_search import BiasSearch
from coastwatch.associations.bearing_sensors import (
    AudiblePairs,
    OutsideDetections,
    SensorBias,
    ShipTypes,
    class_log_odds,
    groups_by_octant,
)
from coastwatch.associations.inputs import BearingAssociationInput
from coastwatch.batches import (
    CLASSES,
    Array,
    BearingAssociations,
    BearingTracks,
    Floats,
    Ints,
    Octants,
    Picture,
    Sensors,
)
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.association.history import History
from coastwatch.kernels.bearings.signatures import check_confusion, even_confusion
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Arrays, Count, Groups, Method, NotNegative, Positive, Probability, Share

SOON = 1.2  # ranges of a sensor: positions of nearer vessels are kept, for they may soon be heard
RANGE_SHARES = np.array([1.0, 0.5, 0.25, 0.1])
RANGE_PROBABILITIES = RANGE_SHARES**2 / (RANGE_SHARES**2).sum()  # by the area that each stands for
LEAST_TRACKS = 64  # for a thread
LARGEST_LOG_ODDS = 300.0  # whose exponential can still be added up
FEWEST_INSTANTS = 8  # that a history has room for


@dataclass(frozen=True, eq=False)
class PositionHistory:
    """Positions of vessels at the newest W instants. As in `History`, `extended` writes into it."""

    history: History  # values (S, W, 4): ECEF position and its standard deviation per axis, m; NaN: absent
    time_s: Floats  # (W,) the instant of each column, NaN for none

    def check_rows(self) -> None:
        """Check the number of instants, as after reading a checkpoint. Raises: ValueError."""
        if self.time_s.shape != (self.history.window,):
            raise ValueError(f"PositionHistory.time_s: got shape {self.time_s.shape}, needed ({self.history.window},)")

    @staticmethod
    def empty() -> PositionHistory:
        return PositionHistory(History.empty(FEWEST_INSTANTS, np.float64, (4,)), np.full(FEWEST_INSTANTS, np.nan))

    def columns(self) -> Ints:
        """The columns that have an instant, oldest first."""
        column = self.history.columns(np.arange(self.history.window)[::-1])
        return column[np.isfinite(self.time_s[column])]

    def extended(self, ids: Ints, values: Floats, time_s: float, window_s: float, spacing_s: float) -> PositionHistory:
        """The history after one more instant. It holds the instants of the window and one before them.

        Of instants closer than `spacing_s` only the last one is kept, so that short cycles need no more memory than long ones.
        Args: ids: (M,) sorted; values: (M, 4). time_s: not before the last instant.
        """
        newest_s = self.time_s[self.columns()[-2:]]
        close = len(newest_s) == 2 and newest_s[1] - newest_s[0] < spacing_s
        before = self._without_newest() if close or (len(newest_s) and newest_s[-1] >= time_s) else self
        before = before._with_room(time_s, window_s)
        there = np.flatnonzero(np.isfinite(values).all(axis=1))
        former = before.history.ids
        history, slot = before.history.advanced(ids[there], None, before.history.window - 1)
        history.values[slot[~np.isin(ids[there], former)]] = np.nan
        history.values[slot, history.column] = values[there]
        instants = before.time_s.copy()
        instants[history.column] = time_s
        return PositionHistory(history, instants)

    def _without_newest(self) -> PositionHistory:
        """The history before its newest instant, whose column is written next."""
        h, instants = self.history, self.time_s.copy()
        instants[h.column] = np.nan
        history = replace(h, cycle=h.cycle - 1, length=np.maximum(h.length - 1, 0), absent=np.maximum(h.absent - 1, 0))
        return PositionHistory(history, instants)

    def _with_room(self, time_s: float, window_s: float) -> PositionHistory:
        """The same with more columns, if all are full and the second oldest is in the window, so that the oldest is needed."""
        column, h = self.columns(), self.history
        instants = self.time_s[column]
        if len(column) < h.window or instants[1] <= time_s - window_s:
            return self
        wanted = int(np.ceil(window_s * len(instants) / (time_s - instants[0]))) + 2
        window = max(wanted, h.window + FEWEST_INSTANTS)
        values, time = np.full((len(h.values), window, 4), np.nan), np.full(window, np.nan)
        to = np.arange(len(column))
        values[:, to], time[to] = h.values[:, column], instants
        return PositionHistory(replace(h, values=values, cycle=len(column) - 1), time)


@dataclass(frozen=True, eq=False)
class LikelihoodMemory:
    positions: PositionHistory  # of vessels in reach of a sensor of bearings
    bias: SensorBias  # of no sensor before the first cycle
    outside: OutsideDetections
    types: ShipTypes
    search: BiasSearch  # of no sensor before the first cycle


class BearingLikelihood(Method):
    """The one-to-one pairs with the greatest sum of log odds; a track without such a pair is of an unknown vessel.

    - The statistic of a pair is its log odds: likelihood ratio of the window of bearings, times prior odds. The hypotheses are
      this vessel, and an unknown vessel anywhere in range.
    - Errors: white noise, as the bearing or else the sensor states it, a position error that is correlated in time, and the
      uncertainty of the sensor's bias.
    - The bias of each sensor is the running median residual of its pairs. A large one, up to 20 degrees, is found by the turn that
      puts most of its tracks on vessels (`bearing_bias_search.py`).
    - A vessel outside the nominal coverage is at first detected with probability 1/2; then the sensor's pairs tell. A vessel
      counts as outside if it was outside at any bearing of the window.
    - If a sensor reports classes of vessels, their likelihood given the ship type in the vessel's AIS is added.
    - Weakness: if position errors are three times the stated ones (30 m for 10 m), F1 loses 2 to 3 points; six times, over 10.
      Nearly all of these are missed partners, and a longer window makes it worse.

    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, ch. 8-9 (likelihood ratio association); the null
    hypothesis and the numbers are ours: scaling/decisions/bearing_association.py.
    """

    method: Literal["bearing_likelihood"] = "bearing_likelihood"
    threshold: float = 0.0  # the log odds of a pair must exceed it: positive speaks for one vessel
    window_s: Positive = 300.0  # older bearings and positions are not used
    spacing_s: Positive = 1.0  # least time between two stored positions of a vessel
    detection_probability: Probability = 0.95  # probability that a sensor has a track of a vessel inside its coverage
    unknown: Probability = 0.05  # least share of a sensor's tracks that are of vessels not in the picture
    unknown_speed_kn: Positive = 7.0  # standard deviation per axis, of such a vessel
    unknown_manoeuvre_m_s2: Positive = 0.1  # its manoeuvres: change of velocity in a second, standard deviation per axis
    position_floor_m: NotNegative = 3.0  # position error beside the covariance (hull, antenna), per axis
    position_unknown_m: Positive = 15.0  # standard deviation per axis where a vessel has no covariance
    position_memory_s: Positive = 20.0  # correlation time of position errors
    settle_s: NotNegative = 20.0  # a vessel known for less, and worse than the next setting, is not compared
    settled_m: Positive = 15.0  # standard deviation per axis: new tracks err by more than their covariance
    bias_sigma_deg: NotNegative = 0.5  # of an uncalibrated sensor; 0: sensors have none
    bias_floor_deg: NotNegative = 0.03  # least standard deviation of an estimated bias
    bias_gain: Share = 0.2  # share of the median residual taken over in a cycle; 0: no calibration
    bias_pairs: Count = 5  # with fewer pairs the bias is not updated
    signature_accuracy: Probability = 0.7  # assumed share of right classes; wrong ones are equally likely
    signature_confusion: tuple[
        tuple[Probability, ...], ...
    ] = ()  # instead: for each true class, the share of each reported class
    signature_habit: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.8  # share of looks that only repeat the sensor's usual answer
    type_doubt: Probability = 0.05  # probability that a ship is not of the class in its AIS
    rejection_log_odds: Annotated[float, Field(lt=0.0)] = -25.0  # log odds below which a pair is not computed further

    @model_validator(mode="after")
    def _confusion_is_a_matrix(self) -> Self:
        check_confusion("signature_confusion", self.signature_confusion, CLASSES)
        return self

    def init(self) -> LikelihoodMemory:
        return LikelihoodMemory(
            PositionHistory.empty(),
            SensorBias.empty(),
            OutsideDetections.empty(),
            ShipTypes.empty(),
            BiasSearch.empty(),
        )

    def step(self, memory: LikelihoodMemory, given: BearingAssociationInput) -> tuple[LikelihoodMemory, BearingAssociations]:
        """Which bearing track is which vessel at this cycle, sorted by bearing_row."""
        bearing_tracks, picture, octants, sensors = given.bearing_tracks, given.picture, given.octants, given.sensors
        sonars = len(sensors.sonars)
        if not sonars:
            return memory, BearingAssociations.empty()
        if len(memory.bias.mean_rad) != sonars:
            memory = replace(
                memory,
                bias=SensorBias(np.zeros(sonars), np.full(sonars, np.radians(self.bias_sigma_deg))),
                outside=OutsideDetections.empty(K=sonars),
                search=BiasSearch.empty(K=sonars),
            )
        audible = AudiblePairs.of(bearing_tracks, picture, octants, sensors)
        positions = self._positions(memory.positions, picture, audible, given.time_s, sensors)
        memory = replace(memory, positions=positions, types=memory.types.updated(given.statics))
        row, log_odds, difference = self._scored(memory, given, audible)
        bearing_row, sensor = octants.bearing_row[row], octants.octant[row] // kernels.bearings.candidates.SECTORS
        pair = audible.index(sensor, octants.vessel_row[row])
        chosen = kernels.association.assignment.assign(bearing_row, pair, log_odds - self.threshold)
        limits = float(np.radians(self.bias_floor_deg)), float(np.radians(self.bias_sigma_deg))
        bias = memory.bias.updated(sensor[chosen], difference[chosen], self.bias_gain, self.bias_pairs, limits)
        search = memory.search
        if self.bias_gain > 0.0:
            search, bias = search.updated(bias, bearing_tracks, picture, audible, sensors, given.time_s, limits[1])
        memory = replace(memory, bias=bias, search=search, outside=memory.outside.updated(audible, pair[chosen]))
        certainty = bearing_tracks.certainty[bearing_row[chosen]]
        probability = pair_probability(bearing_row, pair, log_odds)[chosen] * np.where(np.isnan(certainty), 1.0, certainty)
        return memory, BearingAssociations(
            bearing_row[chosen],
            octants.vessel_row[row[chosen]],
            log_odds[chosen],
            bias.mean_rad,
            probability,
            bias.sigma_rad,
        )

    def _positions(
        self, positions: PositionHistory, picture: Picture, audible: AudiblePairs, time_s: float, sensors: Sensors
    ) -> PositionHistory:
        """The positions of the vessels that are, or soon may be, compared with bearings, one instant longer."""
        near = kernels.geometry.sensor_coverage.coverage_of(sensors.sonars.site_deg, SOON * sensors.sonars.range_m, 0.0)
        needed = kernels.geometry.sensor_coverage.in_any_range(near, picture.position_deg)
        needed[audible.vessel_row] = True
        rows = np.flatnonzero(needed)
        rows = rows[np.argsort(picture.vessel_id[rows], kind="stable")]
        variance = 0.5 * (picture.covariance[rows, 0, 0] + picture.covariance[rows, 1, 1])
        variance = np.where(np.isfinite(variance), variance, self.position_unknown_m**2) + self.position_floor_m**2
        values = np.column_stack([kernels.geometry.ellipsoid.ecef_of_rows(picture.position_deg, rows), np.sqrt(variance)])
        values[(time_s - picture.since_s[rows] < self.settle_s) & (variance > self.settled_m**2)] = np.nan
        return positions.extended(picture.vessel_id[rows], values, time_s, self.window_s, self.spacing_s)

    def _scored(
        self,
        memory: LikelihoodMemory,
        given: BearingAssociationInput,
        audible: AudiblePairs,
    ) -> tuple[Ints, Floats, Floats]:
        """Pairs above the threshold: index into the octants, log odds, mean difference of bearings; sorted by index."""
        tracks, picture, octants, sensors = given.bearing_tracks, given.picture, given.octants, given.sensors
        sensor = tracks.source - sensors.sonar_source(0)
        column, history = memory.positions.columns(), memory.positions.history
        slot, variance = np.full(len(picture), -1, np.int64), sensors.sonars.bearing_sigma_rad[sensor] ** 2
        vessel_row = np.unique(audible.vessel_row)
        slot[vessel_row] = history.slots_of(picture.vessel_id[vessel_row])
        arrays = {
            "first_pair": np.searchsorted(octants.bearing_row, np.arange(len(tracks) + 1)),
            "slot": slot[octants.vessel_row],
            "time": tracks.window_time_s,
            "bearing": tracks.window_bearing_rad,
            "site": tracks.window_site_deg,
            "position_time": memory.positions.time_s[column],
            "position_column": column,
            "position_value": history.values,
            "log_density": self._unknown_density(sensor, audible, sensors),
            "outside": memory.outside.probability(self.detection_probability)[sensor],
            "range": sensors.sonars.range_m[sensor],
            "arc_from": np.radians(sensors.sonars.arc_from_deg)[sensor],
            "arc_width": sensors.sonars.arc_width_rad[sensor],
            "bias": memory.bias.mean_rad[sensor],
            "bias_variance": memory.bias.sigma_rad[sensor] ** 2,
            "variance": np.where(np.isnan(tracks.window_variance), variance[:, None], tracks.window_variance),
            **self._class_evidence(tracks, picture, octants, memory.types),
        }
        parts = given.map_(score_octants, self, arrays, groups_by_octant(octants))
        row = np.concatenate([np.zeros(0, np.int64), *(p[0] for p in parts)])
        order = np.argsort(row, kind="stable")
        log_odds, difference = (np.concatenate([np.zeros(0), *(p[k] for p in parts)])[order] for k in (1, 2))
        return row[order], log_odds, difference

    def _class_evidence(self, tracks: BearingTracks, picture: Picture, octants: Octants, types: ShipTypes) -> dict[str, Array]:
        """Log odds of each track by class of vessel, (N, C + 1), and the class of the vessel of each pair, (A,).

        Both are empty where no sensor reported a class.
        """
        if not tracks.signatures.any():
            return {"class_log_odds": np.zeros((0, CLASSES + 1)), "vessel_class": np.zeros(0, np.int64)}
        confusion = even_confusion(self.signature_accuracy, CLASSES)
        if self.signature_confusion:
            confusion = np.array(self.signature_confusion)
        classes = types.of(picture.mmsi)
        added = class_log_odds(tracks.signatures, classes, confusion, self.signature_habit, self.type_doubt)
        return {"class_log_odds": added, "vessel_class": classes[octants.vessel_row]}

    def _unknown_density(self, sensor: Ints, audible: AudiblePairs, sensors: Sensors) -> Floats:
        """Log density of unknown vessels by bearing, for each track: the vessels that the sensor detects, less those of the
        picture. Args: sensor: (N,). Returns: (N,)."""
        count = len(sensors.sonars)
        tracks = np.bincount(sensor, minlength=count)
        in_picture = self.detection_probability * np.bincount(audible.sensor[audible.inside], minlength=count)
        unknown = np.maximum(tracks - in_picture, np.maximum(self.unknown * tracks, 0.5))
        return np.asarray(np.log(unknown / sensors.sonars.arc_width_rad)[sensor])


def pair_probability(bearing_row: Ints, vessel: Ints, log_odds: Floats) -> Floats:
    """That each pair is right, against all others of its bearing track or of its vessel, whichever is less, and against none. (A,)"""
    odds = np.exp(np.minimum(log_odds, LARGEST_LOG_ODDS))
    others = [np.bincount(key, odds)[key] if len(key) else odds for key in (bearing_row, vessel)]
    return np.asarray(odds / (1.0 + np.maximum(*others)))


def score_octants(settings: BearingLikelihood, arrays: Arrays, octants: Groups) -> tuple[Array, ...]:
    """Pairs of the bearing tracks of these octants that are above the threshold: index of the pair, log odds, mean difference of
    bearings. The result of a pair does not depend on other pairs."""
    windows = kernels.bearings.windows.BearingWindows(
        **{name: arrays[name] for name in kernels.bearings.windows.BearingWindows._fields}
    )
    positions = kernels.bearings.windows.PositionWindows(
        arrays["position_time"], arrays["position_column"], arrays["position_value"]
    )
    unknown = kernels.bearings.null_hypothesis.UnknownVessel(
        RANGE_SHARES, RANGE_PROBABILITIES, settings.unknown_speed_kn * KNOT_M_S, settings.unknown_manoeuvre_m_s2**2
    )
    hypotheses = kernels.bearings.likelihood.Hypotheses(
        settings.detection_probability, settings.position_memory_s, settings.rejection_log_odds, unknown
    )
    track, first = octants.row, arrays["first_pair"]
    count = first[track + 1] - first[track]
    pair = kernels.tables.groups.ranges(first[track], count)
    start = np.append(0, np.cumsum(count))
    pairs = kernels.bearings.likelihood.TrackPairs(track, start, arrays["slot"][pair])
    scores = np.empty((len(pair), 2))
    in_blocks(
        kernels.bearings.likelihood.log_odds, len(track), pairs, windows, positions, hypotheses, scores, least=LEAST_TRACKS
    )
    if len(arrays["class_log_odds"]):
        scores[:, 0] += arrays["class_log_odds"][np.repeat(track, count), arrays["vessel_class"][pair]]
    above = np.flatnonzero(scores[:, 0] > settings.threshold)
    return pair[above], scores[above, 0], scores[above, 1]
