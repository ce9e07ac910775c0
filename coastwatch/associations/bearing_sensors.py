"""Sensors of bearings: the vessels that they may hear, their bias, their detections outside the coverage, and ship classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import CLASS_OF_TYPE, CLASSES, AisStatics, BearingTracks, Bools, Floats, Ints, Octants, Picture, Sensors
from coastwatch.batches.struct import Batch, Struct, column
from coastwatch.geodesy import to_plane, wrap_rad
from coastwatch.kernels.bearings.signatures import log_likelihood
from coastwatch.kernels.tables.lookup import find
from coastwatch.stage import Groups

MOST_TYPES = 200_000
"""Vessels of which the class is kept, 24 bytes each."""

FORGET = 0.95  # of counts of detections outside the coverage, each cycle: they are of the last minute


@dataclass(frozen=True, eq=False)
class AudiblePairs:
    """Each pair of a sensor and a vessel in an octant that has tracks, once."""

    key: Ints  # (P,) sorted: sensor * vessels + vessel_row
    vessels: int  # V
    inside: Bools  # (P,) the vessel is inside the nominal coverage

    @staticmethod
    def of(tracks: BearingTracks, picture: Picture, octants: Octants, sensors: Sensors) -> AudiblePairs:
        """Pairs of the octants, located from where the newest track of a sensor says that the sensor is."""
        some = np.zeros(len(picture), np.bool_)
        some[octants.vessel_row] = True
        audible = np.zeros((len(sensors.sonars), np.count_nonzero(some)), np.bool_)
        audible[octants.octant // kernels.bearings.candidates.SECTORS, (np.cumsum(some) - 1)[octants.vessel_row]] = True
        sensor, column = np.nonzero(audible)
        vessel_row = np.flatnonzero(some)[column]
        site = np.full((len(sensors.sonars), 2), np.nan)
        newest_last = np.argsort(tracks.updated_s, kind="stable")
        site[tracks.source[newest_last] - sensors.sonar_source(0)] = tracks.site_deg[newest_last]
        east, north = to_plane(picture.position_deg[vessel_row], site[sensor]).T
        arc_from, sonars = np.radians(sensors.sonars.arc_from_deg), sensors.sonars
        inside = np.hypot(east, north) <= sonars.range_m[sensor]
        inside &= (np.arctan2(east, north) - arc_from[sensor]) % (2.0 * np.pi) <= sonars.arc_width_rad[sensor]
        return AudiblePairs(sensor * len(picture) + vessel_row, len(picture), inside)

    @property
    def sensor(self) -> Ints:
        """(P,)"""
        return self.key // max(self.vessels, 1)

    @property
    def vessel_row(self) -> Ints:
        """(P,)"""
        return self.key % max(self.vessels, 1)

    def index(self, sensor: Ints, vessel_row: Ints) -> Ints:
        """Which of the pairs each of these is. Args: (A,), (A,), all among the pairs. Returns: (A,)."""
        return np.searchsorted(self.key, sensor * self.vessels + vessel_row)


def groups_by_octant(octants: Octants) -> Groups:
    """A group an octant that has pairs: the bearing tracks in it."""
    return Groups(*kernels.bearings.candidates.tracks_by_octant(octants.bearing_row, octants.octant))


@dataclass(frozen=True, eq=False)
class SensorBias(Struct):
    """The bearing bias of each of K sensors."""

    mean_rad: Floats = column(np.float64, "K")
    sigma_rad: Floats = column(np.float64, "K")

    def updated(
        self, sensor: Ints, difference_rad: Floats, gain: float, least_pairs: int, limits_rad: tuple[float, float]
    ) -> SensorBias:
        """The bias of each sensor, moved towards the median bearing difference of its pairs.

        Args: sensor, difference_rad: (A,) of the pairs; gain: share of the median taken over; least_pairs: fewer change nothing;
        limits_rad: least and greatest standard deviation.
        """
        if gain == 0.0:
            return self
        median_of = kernels.tables.groups.median_of_groups
        mean, sigma = self.mean_rad.copy(), self.sigma_rad.copy()
        residual = wrap_rad(difference_rad - mean[sensor])
        count, median = median_of(sensor, residual, len(mean))
        _, deviation = median_of(sensor, np.abs(residual - median[sensor]), len(mean))
        s = np.flatnonzero(count >= least_pairs)
        mean[s] = wrap_rad(mean[s] + gain * median[s])
        variance_of_median = 1.57 * (1.4826 * deviation[s]) ** 2 / count[s]
        doubt = np.sqrt(limits_rad[0] ** 2 + median[s] ** 2 + variance_of_median)
        sigma[s] += gain * (np.minimum(doubt, limits_rad[1]) - sigma[s])
        return SensorBias(mean, sigma)


@dataclass(frozen=True, eq=False)
class OutsideDetections(Struct):
    """Whether each of K sensors detects vessels just outside its nominal coverage: exponentially forgotten counts."""

    detected: Floats = column(np.float64, "K")
    expected: Floats = column(np.float64, "K")  # how many would be, if they were detected like those inside

    def probability(self, inside: float) -> Floats:
        """That a vessel just outside the coverage is detected, at first 1/2. Args: inside: the greatest. Returns: (K,)."""
        return np.minimum((self.detected + 0.5) / (self.expected + 1.0), inside)

    def updated(self, pairs: AudiblePairs, associated: Ints) -> OutsideDetections:
        """The counts after one more cycle. Args: associated: (A,) those of `pairs`."""
        sensors, detected = len(self.detected), np.zeros(len(pairs.key), np.bool_)
        detected[associated] = True
        kind = (2 * pairs.inside + detected) * sensors + pairs.sensor
        outside_missed, outside_found, inside_missed, inside_found = np.bincount(kind, minlength=4 * sensors).reshape(
            4, sensors
        )
        detection = np.minimum((inside_found + 0.5) / (inside_missed + inside_found + 1.0), 1.0)
        total = FORGET * self.detected + outside_found
        expected = FORGET * self.expected + (outside_missed + outside_found) * detection
        return OutsideDetections(total, np.maximum(expected, total))


@dataclass(frozen=True, eq=False)
class ShipTypes(Batch):
    """The class of each vessel that sent a ship type that implies one; the last one received stands.

    Of more than MOST_TYPES vessels those that were heard longest ago are forgotten.
    """

    mmsi: Ints = column(np.int64, "S")  # sorted
    vessel_class: Ints = column(np.int64, "S")  # VesselClass
    heard_s: Floats = column(np.float64, "S")  # when the vessel sent a type last

    def updated(self, statics: AisStatics) -> ShipTypes:
        """What is known after these static reports."""
        code = np.clip(statics.ship_type, -1, len(CLASS_OF_TYPE))
        rows = np.flatnonzero((code >= 0) & (code < len(CLASS_OF_TYPE)))
        rows = rows[CLASS_OF_TYPE[code[rows]] >= 0]
        if len(rows) == 0:
            return self
        newest_first = rows[np.lexsort((code[rows], statics.received_s[rows]))[::-1]]
        mmsi, first = np.unique(statics.mmsi[newest_first], return_index=True)
        newest = newest_first[first]
        of_class, heard_s = CLASS_OF_TYPE[code[newest]], statics.received_s[newest]
        row = find(self.mmsi, mmsi)
        old, new = row >= 0, row < 0
        kept = self.mmsi, self.vessel_class.copy(), self.heard_s.copy()
        kept[1][row[old]], kept[2][row[old]] = of_class[old], heard_s[old]
        at = np.searchsorted(self.mmsi, mmsi[new])
        columns = zip(kept, (mmsi, of_class, heard_s), strict=True)
        added = (np.insert(column, at, newest_values[new]) for column, newest_values in columns)
        return ShipTypes(*added).bounded()

    def bounded(self) -> ShipTypes:
        """These, or a tenth fewer than MOST_TYPES where there are more: those that were heard last."""
        if len(self.mmsi) <= MOST_TYPES:
            return self
        newest = np.argsort(-self.heard_s, kind="stable")[: MOST_TYPES - MOST_TYPES // 10]
        return self.take(np.sort(newest))

    def of(self, mmsi: Ints) -> Ints:
        """The class of each of these, -1 where it is not known. Args: (V,), -1 allowed."""
        return np.append(self.vessel_class, -1)[find(self.mmsi, mmsi)]


def class_log_odds(signatures: Ints, vessel_class: Ints, confusion: Floats, habit: float, doubt: float) -> Floats:
    """What the class of a vessel adds to the log odds of a pair with each bearing track; last column: a vessel of unknown class.

    A vessel of unknown class, and one that nobody has seen, is of each class as often as the vessels whose class is known.
    Args: signatures: (N, C) looks that reported each class; vessel_class: (V,) of the vessels of the picture, -1 unknown; confusion:
    (C, C) true, reported; habit: as in kernels/bearings/signatures.py; doubt: probability that a ship is not of the class in its AIS.
    Returns: (N, C + 1), 0 where there was no look.
    """
    often = np.bincount(vessel_class[vessel_class >= 0], minlength=CLASSES) + 1.0
    likelihood = log_likelihood(signatures, confusion, habit)
    relative = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))
    anyone = (relative * (often / often.sum())).sum(axis=1, keepdims=True)
    log_odds = np.zeros((len(signatures), CLASSES + 1))
    log_odds[:, :CLASSES] = np.log((1.0 - doubt) * relative + doubt * anyone) - np.log(anyone)
    log_odds[signatures.sum(axis=1) == 0] = 0.0
    return log_odds
