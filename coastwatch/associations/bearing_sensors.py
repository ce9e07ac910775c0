"""What is learnt of sensors of bearings while they are used: their bias, and whether they hear beyond their nominal coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import BearingTracks, Bools, Floats, Ints, Octants, Picture, Sensors
from coastwatch.geodesy import to_plane, wrap_rad

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
        count, middle = _medians(sonar, off, len(bias))
        _, scatter = _medians(sonar, np.abs(off - middle[sonar]), len(bias))
        s = np.flatnonzero(count >= least)
        bias[s] = wrap_rad(bias[s] + gain * middle[s])
        doubt = floor_rad**2 + middle[s] ** 2 + 1.57 * (1.4826 * scatter[s]) ** 2 / count[s]
        bias_sigma[s] += gain * (np.minimum(np.sqrt(doubt), widest_rad) - bias_sigma[s])
        return Calibration(bias, bias_sigma, self.outside_heard, self.outside_known)

    def with_heard(self, known: Known, sonar: Ints, vessel_row: Ints) -> Calibration:
        """The counts of vessels outside the coverage after one more cycle. Args: sonar, vessel_row: (A,) of the pairs found."""
        count = len(self.bias_rad)
        found = np.isin(known.vessel_row + known.sonar * known.vessels, vessel_row + sonar * known.vessels)
        inside, outside, inside_found, outside_found = (
            np.bincount(known.sonar[which], minlength=count)
            for which in (known.inside, ~known.inside, known.inside & found, ~known.inside & found)
        )
        expected = outside * np.minimum((inside_found + 0.5) / (inside + 1.0), 1.0)
        heard = FORGET * self.outside_heard + outside_found
        return Calibration(self.bias_rad, self.bias_sigma_rad, heard, np.maximum(FORGET * self.outside_known + expected, heard))


@dataclass(frozen=True, eq=False)
class Known:
    """Which vessels of the picture each sensor may hear: each pair of sensor and vessel once, in the octants that have tracks."""

    sonar: Ints  # (P,)
    vessel_row: Ints  # (P,)
    inside: Bools  # (P,) the vessel is inside the nominal coverage
    vessels: int  # in the picture

    @staticmethod
    def of(tracks: BearingTracks, picture: Picture, octants: Octants, sensors: Sensors) -> Known:
        pair = _heard_by(octants, len(tracks), len(picture))
        site = np.full((len(sensors.sonars), 2), np.nan)
        newest_last = np.argsort(
            tracks.updated_s, kind="stable"
        )  # where one sensor's tracks differ, the newest knows where it is
        site[tracks.source[newest_last] - sensors.sonar_source(0)] = tracks.site_deg[newest_last]
        arc_from, arc_width = arcs(sensors)
        where = to_plane(picture.position_deg[pair[1]], site[pair[0]])
        direction = np.arctan2(where[:, 0], where[:, 1])
        inside = np.hypot(where[:, 0], where[:, 1]) <= sensors.sonars.range_m[pair[0]]
        inside &= (direction - arc_from[pair[0]]) % (2.0 * np.pi) <= arc_width[pair[0]]
        return Known(pair[0], pair[1], inside, len(picture))

    def inside_count(self, sonars: int) -> Ints:
        """How many vessels each sensor should hear. Returns: (K,)."""
        return np.bincount(self.sonar[self.inside], minlength=sonars).astype(np.int64)


def _medians(group: Ints, value: Floats, groups: int) -> tuple[Ints, Floats]:
    """How many values each group has, and their median, NaN for none. Args: (A,), (A,). Returns: (groups,), (groups,)."""
    values = value[np.lexsort((value, group))]
    count = np.bincount(group, minlength=groups)
    start = np.cumsum(count) - count
    some = np.flatnonzero(count)
    median = np.full(groups, np.nan)
    low, high = start[some] + (count[some] - 1) // 2, start[some] + count[some] // 2
    median[some] = 0.5 * (values[low] + values[high])
    return count, median


def _heard_by(octants: Octants, tracks: int, vessels: int) -> tuple[Ints, Ints]:
    """Each pair of a sensor and a vessel in its octants once: (P,) sensors and (P,) rows of vessels, sorted."""
    start = np.searchsorted(octants.bearing_row, np.arange(tracks + 1))
    some = np.flatnonzero(np.diff(start))  # tracks that have pairs, all of them in one octant
    one = some[
        np.unique(octants.octant[start[some]], return_index=True)[1]
    ]  # a track of every octant: all have the same vessels
    size = start[one + 1] - start[one]
    rows = np.arange(size.sum()) + np.repeat(start[one] - (np.cumsum(size) - size), size)
    pair = np.unique(octants.octant[rows] // 8 * vessels + octants.vessel_row[rows])
    return pair // max(vessels, 1), pair % max(vessels, 1)


def arcs(sensors: Sensors) -> tuple[Floats, Floats]:
    """Where the arc of each sensor begins, and its width: 2 pi for one that hears all round. Returns: (K,) and (K,)."""
    width = (sensors.sonars.arc_to_deg - sensors.sonars.arc_from_deg) % 360.0
    return np.radians(sensors.sonars.arc_from_deg), np.radians(np.where(width == 0.0, 360.0, width))
