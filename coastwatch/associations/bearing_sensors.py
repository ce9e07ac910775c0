"""What is learnt of sensors of bearings while they are used: their bias, and whether they hear beyond their nominal coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.associations.pairing import without_empty
from coastwatch.batches import BearingTracks, Bools, Floats, Ints, Octants, Picture, Sensors
from coastwatch.geodesy import wrap_rad
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Groups

LEAST_SONARS, LEAST_PAIRS = 8, 1024  # under which a thread costs more than it gains
FORGET = 0.95  # of the counts of vessels outside the coverage, each cycle: what is learnt is of the last minute


@dataclass(frozen=True, eq=False)
class Calibration:
    """Of K sensors of bearings."""

    bias_rad: Floats  # (K,)
    bias_sigma_rad: Floats  # (K,) what is not known of it
    outside_heard: Floats  # (K,) vessels just outside the coverage that were found, forgotten by and by
    outside_known: Floats  # (K,) those that would have been, were they heard like the others

    @staticmethod
    def of(count: int, bias_sigma_rad: float) -> Calibration:
        """Before anything is learnt."""
        return Calibration(np.zeros(count), np.full(count, bias_sigma_rad), np.zeros(count), np.zeros(count))

    def heard_outside(self, heard: float) -> Floats:
        """The chance that a vessel just outside the coverage is heard, at first as likely as not. Returns: (K,), at most `heard`."""
        return np.minimum((self.outside_heard + 0.5) / (self.outside_known + 1.0), heard)

    def with_bias(
        self, sonar: Ints, residual: Floats, gain: float, least: int, floor_rad: float, widest_rad: float
    ) -> Calibration:
        """The bias of each sensor, moved towards the median residual of its pairs, and what is not known of it.

        Args: sonar, residual: (A,) of the pairs; gain: the share taken over; least: pairs that are needed; floor_rad, widest_rad: of
        what is not known.
        """
        if gain == 0.0:
            return self

        bias, bias_sigma = self.bias_rad.copy(), self.bias_sigma_rad.copy()
        off = wrap_rad(residual - bias[sonar])
        count, middle = kernels.bearings.candidates.medians(sonar, off, len(bias))
        _, scatter = kernels.bearings.candidates.medians(sonar, np.abs(off - middle[sonar]), len(bias))
        s = np.flatnonzero(count >= least)
        bias[s] = wrap_rad(bias[s] + gain * middle[s])
        doubt = floor_rad**2 + middle[s] ** 2 + 1.57 * (1.4826 * scatter[s]) ** 2 / count[s]
        bias_sigma[s] += gain * (np.minimum(np.sqrt(doubt), widest_rad) - bias_sigma[s])
        return Calibration(bias, bias_sigma, self.outside_heard, self.outside_known)

    def with_heard(self, known: Known, pairs: Ints) -> Calibration:
        """The counts of vessels outside the coverage after one more cycle. Args: pairs: (A,) those of `known` that were found."""
        count, found = len(self.bias_rad), np.zeros(len(known.sonar), np.bool_)
        found[pairs] = True
        kind = (2 * known.inside + found) * count + known.sonar
        outside_lost, outside_found, inside_lost, inside_found = np.bincount(kind, minlength=4 * count).reshape(4, count)
        expected = (outside_lost + outside_found) * np.minimum((inside_found + 0.5) / (inside_lost + inside_found + 1.0), 1.0)
        heard = FORGET * self.outside_heard + outside_found
        return Calibration(self.bias_rad, self.bias_sigma_rad, heard, np.maximum(FORGET * self.outside_known + expected, heard))


@dataclass(frozen=True, eq=False)
class Known:
    """Which vessels of the picture each sensor may hear: each pair of sensor and vessel once, in the octants that have tracks."""

    sonar: Ints  # (P,) sorted
    vessel_row: Ints  # (P,) sorted within a sensor
    begin: Ints  # (K + 1,) where the pairs of each sensor begin
    inside: Bools  # (P,) the vessel is inside the nominal coverage
    first_pair: Ints  # (N + 1,) where the pairs of each bearing track begin in the octants
    octants: Groups  # the bearing tracks of every octant that has pairs

    @staticmethod
    def of(tracks: BearingTracks, picture: Picture, octants: Octants, sensors: Sensors) -> Known:

        sonars, first = len(sensors.sonars), kernels.bearings.candidates.first_pairs(octants.bearing_row, len(tracks))
        track, start = kernels.bearings.candidates.by_octant(first, octants.octant, sonars)
        row, begin = kernels.bearings.candidates.heard_by(track, start, first, octants.vessel_row, len(picture))
        site = np.full((sonars, 2), np.nan)
        newest_last = np.argsort(
            tracks.updated_s, kind="stable"
        )  # where one sensor's tracks differ, the newest knows where it is
        site[tracks.source[newest_last] - sensors.sonar_source(0)] = tracks.site_deg[newest_last]
        within = np.empty(len(row), np.bool_)
        heard = begin, row, picture.position_deg, site, sensors.sonars.range_m, *arcs(sensors)
        in_blocks(kernels.bearings.candidates.inside, sonars, *heard, within, least=LEAST_SONARS)
        return Known(np.repeat(np.arange(sonars), np.diff(begin)), row, begin, within, first, without_empty(track, start))

    def inside_count(self, sonars: int) -> Ints:
        """How many vessels each sensor should hear. Returns: (K,)."""
        return np.bincount(self.sonar[self.inside], minlength=sonars).astype(np.int64)

    def at(self, sonar: Ints, vessel_row: Ints) -> Ints:
        """Which of the pairs each of these is. Args: (A,), (A,), of the octants. Returns: (A,)."""

        out = np.empty(len(sonar), np.int64)
        in_blocks(
            kernels.bearings.candidates.standing,
            len(sonar),
            self.begin,
            self.vessel_row,
            sonar,
            vessel_row,
            out,
            least=LEAST_PAIRS,
        )
        return out


def arcs(sensors: Sensors) -> tuple[Floats, Floats]:
    """Where the arc of each sensor begins, and its width: 2 pi for one that hears all round. Returns: (K,) and (K,)."""
    width = (sensors.sonars.arc_to_deg - sensors.sonars.arc_from_deg) % 360.0
    return np.radians(sensors.sonars.arc_from_deg), np.radians(np.where(width == 0.0, 360.0, width))
