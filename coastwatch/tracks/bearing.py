"""Bearing tracks: a window of the newest bearings of each contact, bearing and rate by least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import (
    CLASSES,
    ID_STRIDE,
    Array,
    BearingReports,
    BearingTracks,
    Bools,
    ExpectedVessels,
    Floats,
    Ints,
    Sensors,
)
from coastwatch.geodesy import wrap_deg, wrap_rad
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.stage import Count, Method, NotNegative, Positive, Probability
from coastwatch.tracks.bearing_looks import CONTACTS, few, near_in_bearing, rounds
from coastwatch.tracks.bearing_vessels import Predicted, chosen_pairs, in_crowd, predicted_bearings
from coastwatch.tracks.inputs import BearingInput

LINE_COLUMNS = ("sensor", "time_s", "bearing_rad", "weight")  # the data of a line fit
GAIN = 100.0  # greater than any squared gate plus the logarithm of its width: every bearing in a gate has a positive gain
SAME_SLOT = 0.75  # of the spacing: a clock that jitters by a quarter still fills one slot a report


@dataclass(frozen=True, eq=False)
class BearingMemory:
    """All tracks, sorted by track_id. Windows are oldest first, NaN before the first slot."""

    track_id: Ints  # (N,)
    sensor: Ints  # (N,)
    contact: Ints  # (N,) -1: the sensor gives none and the track is our own; -2 - vessel_id: the vessel predicts it
    updated_s: Floats  # (N,)
    started_s: Floats  # (N,)
    begin_s: Floats  # (N,) first report of the newest slot
    hits: Ints  # (N,) reports
    looks: Ints  # (N,) looks of the sensor since the track began; own tracks only
    misses: Ints  # (N,) looks without a report, in a row; own tracks only
    origin: Ints  # (N,)
    time_s: Floats  # (N, W) mean of the slot
    bearing_rad: Floats  # (N, W) mean of the slot
    weight: Floats  # (N, W) reports in the slot, each by `relative_weight`; 0 where there is none
    precision: Floats  # (N, W) mean of `relative_weight` in the slot: 1 for reports without a variance of their own
    site_deg: Floats  # (N, W, 2)
    signatures: Ints  # (N, C) reports of each VesselClass
    counter: Ints  # (K,) tracks that each sensor has had
    dropped: int  # reports that are not finite or from the future
    left_out: int  # reports beyond the counts of `bearing_looks`

    def check_rows(self) -> None:
        """Check the numbers of sensors, as after reading a checkpoint. Raises: ValueError that names the field."""
        require_rows("BearingMemory.sensor", self.sensor, len(self.counter))

    def unnumbered(self) -> tuple[Ints, Floats]:
        """The sensors that have tracks without contact numbers, and where each was last. (S,), (S, 2)"""
        rows = np.flatnonzero(self.contact < 0)
        newest_first = rows[np.argsort(-self.updated_s[rows], kind="stable")]
        sensor, first = np.unique(self.sensor[newest_first], return_index=True)
        return sensor, self.site_deg[newest_first[first], -1]

    @staticmethod
    def empty(window: int) -> BearingMemory:
        n, x, slots = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, window))
        sites, signatures = np.zeros((0, window, 2)), np.zeros((0, CLASSES), np.int64)
        return BearingMemory(n, n, n, x, x, x, n, n, n, n, slots, slots, slots, slots, sites, signatures, n, 0, 0)


ROWS = tuple(f.name for f in fields(BearingMemory) if f.name not in ("counter", "dropped", "left_out"))
MEASURED = ("measured_weight", "measured_s", "measured_rad", "measured_site_deg")  # means over the bearings of this cycle
CYCLE = (*MEASURED, "certainty")
OWN, OF_VESSEL = -1, -2  # contact of our own tracks; that of a track of vessel v is OF_VESSEL - v
EMPTY = {
    "time_s": np.nan,
    "bearing_rad": np.nan,
    "weight": 0.0,
    "precision": np.nan,
    "site_deg": np.nan,
    "begin_s": np.nan,
    "certainty": np.nan,
}


class Windows:
    """Copies of the columns of a BearingMemory under their names, to be written during a cycle."""

    def __init__(self, memory: BearingMemory, spacing_s: float, first_id: Ints, sigma_rad: Floats) -> None:
        """Args: spacing_s: of slots; first_id: (K,) the first track id of each sensor; sigma_rad: (K,) of its bearings."""
        self.column: dict[str, Array] = {name: getattr(memory, name).copy() for name in ROWS}
        n = len(memory.track_id)
        self.column |= {name: np.zeros((n, 2) if name == "measured_site_deg" else n) for name in MEASURED}
        self.column["certainty"] = np.full(n, np.nan)
        self.counter = memory.counter.copy() if len(memory.counter) == len(first_id) else np.zeros(len(first_id), np.int64)
        self.spacing_s, self.first_id, self.sigma_rad = spacing_s, first_id, sigma_rad

    def update_contacts(self, reports: BearingReports, drop_after_s: float) -> None:
        """Updates tracks by one report of each of some contacts. A contact silent for longer than `drop_after_s` begins a new track."""
        c = self.column
        wanted = reports.sensor * CONTACTS + reports.contact
        rows = np.flatnonzero(c["contact"] >= 0)
        row = np.append(rows, -1)[row_of(c["sensor"][rows] * CONTACTS + c["contact"][rows], wanted)]
        silent = (row >= 0) & (reports.time_s - np.append(c["updated_s"], np.nan)[row] > drop_after_s)
        silent_rows = np.zeros(len(c["sensor"]), bool)
        silent_rows[row[silent]] = True
        known = (row >= 0) & ~silent
        self.update(row[known], reports.take(known))
        if silent.any():
            self.keep(~silent_rows)
        self.initialise(reports.take(~known))

    def update(self, row: Ints, reports: BearingReports) -> None:
        """Enters one report into the window of each of these rows, unless the row has a newer one."""
        c = self.column
        newer = reports.time_s > c["updated_s"][row]
        row, reports = row[newer], reports.take(newer)
        self._average_of_cycle(row, reports)
        same = reports.time_s - c["begin_s"][row] < SAME_SLOT * self.spacing_s
        self._begin_slot(row[~same], reports.take(~same))
        self._average_into_slot(row[same], reports.take(same))
        c["updated_s"][row], c["origin"][row] = reports.time_s, reports.origin
        c["hits"][row] += 1
        classified = reports.signature >= 0
        c["signatures"][row[classified], reports.signature[classified]] += 1

    def _average_of_cycle(self, row: Ints, reports: BearingReports) -> None:
        """Enters the reports into the means of this cycle, with the weight of the share of a slot since the bearing before.

        The errors of bearings in one slot are alike, so that all of them together count as one.
        """
        c = self.column
        share = np.minimum((reports.time_s - c["updated_s"][row]) / self.spacing_s, 1.0)
        weight = share * relative_weight(reports, self.sigma_rad)
        c["measured_weight"][row] += weight
        first = c["measured_weight"][row] == weight
        part = weight / c["measured_weight"][row]
        bearing = np.where(first, wrap_rad(np.radians(reports.bearing_deg)), c["measured_rad"][row])
        c["measured_rad"][row] = wrap_rad(bearing + wrap_rad(np.radians(reports.bearing_deg) - bearing) * part)
        time_s = np.where(first, reports.time_s, c["measured_s"][row])
        c["measured_s"][row] = time_s + (reports.time_s - time_s) * part
        c["measured_site_deg"][row] = np.where(
            first[:, None], reports.site_deg, _between_deg(c["measured_site_deg"][row], reports.site_deg, part)
        )

    def _begin_slot(self, row: Ints, reports: BearingReports) -> None:
        """Moves the windows on by one slot, which holds the report."""
        bearing, own = wrap_rad(np.radians(reports.bearing_deg)), relative_weight(reports, self.sigma_rad)
        values = {
            "time_s": reports.time_s,
            "bearing_rad": bearing,
            "weight": own,
            "precision": own,
            "site_deg": reports.site_deg,
        }
        for name, value in values.items():
            window = self.column[name]
            window[row, :-1] = window[row, 1:]
            window[row, -1] = value
        self.column["begin_s"][row] = reports.time_s

    def _average_into_slot(self, row: Ints, reports: BearingReports) -> None:
        """Makes the newest slot the mean of what it held and the report."""
        c = self.column
        own = relative_weight(reports, self.sigma_rad)
        weight = c["weight"][row, -1] + own
        bearing = c["bearing_rad"][row, -1]
        c["weight"][row, -1] = weight
        c["precision"][row, -1] += (own - c["precision"][row, -1]) * own / weight
        c["time_s"][row, -1] += (reports.time_s - c["time_s"][row, -1]) * own / weight
        c["bearing_rad"][row, -1] = wrap_rad(bearing + wrap_rad(np.radians(reports.bearing_deg) - bearing) * own / weight)
        c["site_deg"][row, -1] = _between_deg(c["site_deg"][row, -1], reports.site_deg, own / weight)

    def initialise(self, reports: BearingReports) -> None:
        """Begins a track with each report."""
        n = len(reports)
        if n == 0:
            return
        order = np.argsort(reports.sensor, kind="stable")
        sensor = reports.sensor[order]
        number = np.empty(n, np.int64)
        number[order] = np.arange(n) - np.searchsorted(sensor, sensor)
        columns = {
            "track_id": self.first_id[reports.sensor] + self.counter[reports.sensor] + number,
            "sensor": reports.sensor,
            "contact": reports.contact,
            "updated_s": np.full(n, -np.inf),
            "started_s": reports.time_s,
        }
        self.counter += np.bincount(reports.sensor, minlength=len(self.counter))
        before = len(self.column["track_id"])
        for name, old in self.column.items():
            empty = np.full((n, *old.shape[1:]), EMPTY.get(name, 0), old.dtype)
            self.column[name] = np.concatenate([old, columns.get(name, empty)])
        self.update(before + np.arange(n), reports)

    def count_look(self, rows: Ints, hit: Ints) -> None:
        """Counts one look of the sensor at each of these rows, and a miss where it had no bearing."""
        c = self.column
        c["looks"][rows] += 1
        c["misses"][rows] += 1
        c["misses"][hit] = 0

    def keep(self, rows: Bools) -> None:
        """Forgets the other rows."""
        if not rows.all():
            self.column = {name: values[rows] for name, values in self.column.items()}

    def memory(self, dropped: int, left_out: int) -> BearingMemory:
        """The columns, sorted by track_id. Args: reports that were dropped, and left out, up to now."""
        order = np.argsort(self.column["track_id"], kind="stable")
        columns = {name: self.column[name][order] for name in ROWS}
        return BearingMemory(**columns, counter=self.counter, dropped=dropped, left_out=left_out)

    def measured(self) -> dict[str, Array]:
        """Mean of the bearings of this cycle, its weight, 0 where there was none, and its certainty; sorted by track_id."""
        order = np.argsort(self.column["track_id"], kind="stable")
        return {name: self.column[name][order] for name in CYCLE}


def _between_deg(first: Floats, second: Floats, share: Floats) -> Floats:
    """Positions at this share of the way from the first to the second. (M, 2)"""
    off = second - first
    off[:, 1] = wrap_deg(off[:, 1])
    mean = first + off * share[:, None]
    mean[:, 1] = wrap_deg(mean[:, 1])
    # Wrapping rounds: the position of a fixed sensor must keep its bits.
    return np.where(off == 0.0, first, mean)


def relative_weight(reports: BearingReports, sigma_rad: Floats) -> Floats:
    """The variance of the sensor over that of each bearing: 1 for a bearing without a variance of its own. (M,)"""
    own = np.radians(reports.bearing_sigma_deg)
    given = own > 0.0
    out = np.ones(len(reports))
    out[given] = (sigma_rad[reports.sensor[given]] / own[given]) ** 2
    return out


class BearingWindow(Method):
    """One track for each contact that a sensor numbers; tracks of our own where it gives bearings without numbers (contact -1).

    Bearings fall into slots of `window_s / length` seconds that hold their mean, so that a camera needs no more memory than a
    sonar. Bearing and rate are the least squares line through the newest `rate_length` slots, the rate with a wide prior, so
    that one bearing is enough. A report that is not newer than what its contact already has is left out.
    Own tracks: at each look of the sensor, bearings are assigned one to one to the tracks whose prediction is within
    `gate_sigmas`; what is left begins new tracks. A track is yielded once `start_hits` of its first `start_looks` looks had a
    bearing, and ends after `end_misses` looks without. Every track ends when it is silent for longer than `drop_after_s`.
    Where a gate holds `crowd` vessels of the picture on average, these predict the bearings, one track for each, and only what is
    left goes to own tracks.
    A look is the bearings of one time. Of very many bearings in a cycle an even choice is used, of own tracks by whole looks, and the
    others are counted. A cycle with a longer time takes more, within bounds.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, eq. 10 (bearing and angular velocity from successive bearings over a given time).
    """

    method: Literal["bearing_window"] = "bearing_window"
    window_s: Positive = 300.0
    length: Annotated[int, Field(ge=2, le=1000)] = 100  # slots
    rate_length: Annotated[int, Field(ge=2)] = 10  # slots
    rate_sigma_deg_s: Positive = 0.5  # standard deviation of bearing rates before anything is known
    drop_after_s: Positive = 30.0
    gate_sigmas: Positive = 3.5
    start_hits: Count = 3
    start_looks: Count = 5
    end_misses: Count = 10
    ahead_s: Positive = 5.0  # a report stamped more than this after the cycle is dropped
    crowd: NotNegative = 0.25  # vessels of the picture in a gate, on average, from which these predict the bearings
    detection_probability: Probability = 0.95  # that a sensor hears a vessel of the picture in its coverage, in a look

    def init(self) -> BearingMemory:
        return BearingMemory.empty(self.length)

    def step(self, memory: BearingMemory, given: BearingInput) -> tuple[BearingMemory, BearingTracks]:
        """Tracks after the reports of this cycle, predicted to its time. A report that is not finite or from the future is dropped.

        Returns: memory, with the dropped reports counted, and BearingTracks, sorted by track_id, W = `length`.
        Raises: ValueError for a contact number of 2^40 or more, or a sensor that the scenario has not.
        """
        reports, time_s, sensors, expected = given
        unknown = (reports.sensor < 0) | (reports.sensor >= len(sensors.sonars))
        if unknown.any():
            wrong = reports.sensor[unknown][0]
            raise ValueError(f"BearingReports.sensor: got {wrong}, needed 0 to {len(sensors.sonars) - 1}")
        if len(reports) and reports.contact.max() >= CONTACTS:
            raise ValueError(f"BearingReports.contact: got {reports.contact.max()}, needed less than 2^40")
        if not len(sensors.sonars):
            return memory, BearingTracks.empty(W=self.length)
        first = (sensors.sonar_source(0) + np.arange(len(sensors.sonars))) * ID_STRIDE
        windows = Windows(memory, self.window_s / self.length, first, sensors.sonars.bearing_sigma_rad)
        keys = (reports.bearing_deg, reports.contact, reports.sensor, reports.time_s)
        order = np.lexsort(keys)
        usable = np.isfinite(reports.bearing_deg) & np.isfinite(reports.time_s) & (reports.time_s <= time_s + self.ahead_s)
        dropped = memory.dropped + int((~usable).sum())
        reports = reports.take(order[usable[order]])
        used = few(reports)
        left_out, reports = memory.left_out + int((~used).sum()), reports.take(used)
        numbered, own = reports.take(reports.contact >= 0), reports.take(reports.contact < 0)
        for rows in rounds(numbered.sensor * CONTACTS + numbered.contact, np.arange(len(numbered))):
            windows.update_contacts(numbered.take(rows), self.drop_after_s)
        own = replace(own, contact=np.full(len(own), OWN))
        for rows in rounds(own.sensor, own.time_s):  # a look is the reports of one sensor at one time
            self._look(windows, own.take(rows), expected, sensors)
        windows.keep(time_s - windows.column["updated_s"] <= self.drop_after_s)
        after = windows.memory(dropped, left_out)
        return after, self._tracks(after, windows.measured(), time_s, sensors)

    def _look(self, windows: Windows, reports: BearingReports, expected: ExpectedVessels, sensors: Sensors) -> None:
        """One look of each of some sensors that do not number contacts: assign, begin and end tracks."""
        c, sigma_rad = windows.column, sensors.sonars.bearing_sigma_rad
        reports = reports.take(np.argsort(reports.sensor, kind="stable"))
        start = np.searchsorted(reports.sensor, c["sensor"])
        count = np.searchsorted(reports.sensor, c["sensor"], side="right") - start
        looked = np.flatnonzero((c["contact"] < 0) & (count > 0))
        time_s = reports.time_s[start[looked]]
        hit, begun, rest = self._of_vessels(windows, reports, expected, sensors)
        seen = np.flatnonzero(c["contact"][looked] == OWN)
        pair, report = self._of_own_tracks(windows, looked[seen], time_s[seen], rest, sigma_rad)
        windows.update(pair, rest.take(report))
        windows.count_look(looked, np.append(hit, pair))
        ended = (c["misses"] >= self.end_misses) | ((c["looks"] >= self.start_looks) & (c["hits"] < self.start_hits))
        windows.keep((c["contact"] >= 0) | ~ended)
        unused = np.ones(len(rest), np.bool_)
        unused[report] = False
        before = len(windows.column["looks"])
        windows.initialise(BearingReports.join([begun, rest.take(unused)]))
        windows.column["looks"][before:] = 1

    def _of_vessels(
        self, windows: Windows, reports: BearingReports, expected: ExpectedVessels, sensors: Sensors
    ) -> tuple[Ints, BearingReports, BearingReports]:
        """Enter the bearings of expected vessels into their tracks, where a sensor hears a crowd of these.

        A track whose vessel is not expected any more, or whose sensor hears no crowd, goes on as our own.
        Returns: rows that were hit; reports that begin tracks of vessels; reports that are of no expected vessel.
        """
        c = windows.column
        predicted = Predicted.empty()
        if len(expected.vessel_id):
            predicted = in_crowd(predicted_bearings(expected, reports, sensors), self.gate_sigmas, self.crowd, sensors)
        of_vessel = np.flatnonzero((c["contact"] <= OF_VESSEL) & np.isin(c["sensor"], reports.sensor))
        lost = ~np.isin(c["sensor"][of_vessel], predicted.sensor)
        lost |= ~np.isin(OF_VESSEL - c["contact"][of_vessel], expected.vessel_id)
        c["contact"][of_vessel[lost]] = OWN
        if not len(predicted.sensor):
            return of_vessel[:0], reports.take(of_vessel[:0]), reports
        noise = sensors.sonars.bearing_sigma_rad[reports.sensor] ** 2 / relative_weight(
            reports, sensors.sonars.bearing_sigma_rad
        )
        widest = np.zeros(len(sensors.sonars))
        np.maximum.at(widest, reports.sensor, noise)
        half = self.gate_sigmas * np.sqrt(predicted.variance + widest[predicted.sensor])
        near = near_in_bearing(predicted.bearing_rad, half, predicted.sensor, reports)
        vessel, report, certainty = chosen_pairs(
            predicted, reports, near, noise, self.gate_sigmas, self.detection_probability, sensors
        )
        rest = np.ones(len(reports), np.bool_)
        rest[report] = False
        found = replace(reports.take(report), contact=OF_VESSEL - predicted.vessel_id[vessel])
        rows, count = np.flatnonzero(c["contact"] <= OF_VESSEL), len(sensors.sonars)
        row = np.append(rows, -1)[row_of(c["contact"][rows] * count + c["sensor"][rows], found.contact * count + found.sensor)]
        known = row >= 0
        hit = row[known]
        windows.update(hit, found.take(known))
        c["certainty"][hit] = np.fmin(c["certainty"][hit], certainty[known])
        return hit, found.take(~known), reports.take(rest)

    def _of_own_tracks(
        self, windows: Windows, seen: Ints, time_s: Floats, reports: BearingReports, sigma_rad: Floats
    ) -> tuple[Ints, Ints]:
        """The best one-to-one pairs of our own tracks and bearings of a look: rows of tracks (B,) and of reports (B,).

        Args: seen: (T,) rows of tracks whose sensor had the look; time_s: (T,) of it; reports: (M,) sorted by sensor.
        """
        c = windows.column
        bearing, _, covariance = self._line({k: c[k][seen] for k in LINE_COLUMNS}, time_s, sigma_rad)
        weight = relative_weight(reports, sigma_rad)
        widest = np.zeros(len(sigma_rad))
        np.maximum.at(widest, reports.sensor, sigma_rad[reports.sensor] ** 2 / weight)
        half = self.gate_sigmas * np.sqrt(covariance[:, 0, 0] + widest[c["sensor"][seen]])
        pair, report = near_in_bearing(bearing, half, c["sensor"][seen], reports)
        off = wrap_rad(np.radians(reports.bearing_deg[report]) - bearing[pair])
        noise = sigma_rad[c["sensor"][seen[pair]]] ** 2 / weight[report]
        variance = covariance[pair, 0, 0] + noise
        # A wide gate costs gain, and confirmed tracks go first: otherwise a track with a wide gate takes every bearing.
        tier = GAIN * (1.0 + (c["hits"][seen[pair]] >= self.start_hits))
        gain = np.where(off**2 < self.gate_sigmas**2 * variance, tier - off**2 / variance - np.log(variance / noise), 0.0)
        chosen = np.asarray(
            kernels.association.assignment.assign(pair.astype(np.int64), report.astype(np.int64), gain), np.bool_
        )
        return seen[pair[chosen]], report[chosen]

    def _line(self, window: Mapping[str, Array], time_s: Array, sigma_rad: Floats) -> tuple[Floats, Floats, Floats]:
        """Bearing (N,), rate (N,) and covariance (N, 2, 2) at these times by least squares through the newest slots."""
        weight = window["weight"][:, -self.rate_length :]
        last = window["bearing_rad"][:, -1]
        there = weight > 0.0
        t = np.where(there, window["time_s"][:, -self.rate_length :] - window["time_s"][:, -1:], 0.0)
        y = np.where(there, wrap_rad(window["bearing_rad"][:, -self.rate_length :] - last[:, None]), 0.0)
        variance = sigma_rad[window["sensor"]] ** 2
        prior = variance / np.radians(self.rate_sigma_deg_s) ** 2
        s0, s1, s2 = weight.sum(1), (weight * t).sum(1), (weight * t * t).sum(1) + prior
        b0, b1 = (weight * y).sum(1), (weight * t * y).sum(1)
        det = s0 * s2 - s1 * s1
        rate = (s0 * b1 - s1 * b0) / det
        ahead = np.asarray(time_s) - window["time_s"][:, -1]
        bearing = wrap_rad(last + (s2 * b0 - s1 * b1) / det + ahead * rate)
        p00, p01, p11 = variance * s2 / det, -variance * s1 / det, variance * s0 / det
        across = p01 + ahead * p11
        rows = [[p00 + 2.0 * ahead * p01 + ahead**2 * p11, across], [across, p11]]
        return bearing, rate, np.moveaxis(np.array(rows), 2, 0)

    def _tracks(self, memory: BearingMemory, measured: Mapping[str, Array], time_s: float, sensors: Sensors) -> BearingTracks:
        out = np.flatnonzero((memory.contact >= 0) | (memory.hits >= self.start_hits))
        window = {name: getattr(memory, name)[out] for name in LINE_COLUMNS}
        bearing, rate, covariance = self._line(window, np.full(len(out), time_s), sensors.sonars.bearing_sigma_rad)
        old = ~(window["time_s"] >= time_s - self.window_s)
        site, sigma = memory.site_deg[out], sensors.sonars.bearing_sigma_rad[memory.sensor[out]]
        weight, measured_s, measured_rad, measured_site_deg, certainty = (measured[name][out] for name in CYCLE)
        none = weight == 0.0
        variance = sigma**2 / np.where(none, 1.0, weight)
        return BearingTracks(
            track_id=memory.track_id[out],
            source=sensors.sonar_source(0) + memory.sensor[out],
            time_s=np.full(len(out), float(time_s)),
            bearing_rad=bearing,
            rate_rad_s=rate,
            covariance=covariance,
            site_deg=site[:, -1],
            updated_s=memory.updated_s[out],
            started_s=memory.started_s[out],
            window_time_s=np.where(old, np.nan, window["time_s"]),
            window_bearing_rad=np.where(old, np.nan, window["bearing_rad"]),
            window_site_deg=np.where(old[:, :, None], np.nan, site),
            window_variance=np.where(old, np.nan, sigma[:, None] ** 2 / memory.precision[out]),
            signatures=memory.signatures[out],
            origin=memory.origin[out],
            measured_s=np.where(none, np.nan, measured_s),
            measured_rad=np.where(none, np.nan, measured_rad),
            measured_variance=np.where(none, np.nan, variance),
            measured_site_deg=np.where(none[:, None], np.nan, measured_site_deg),
            certainty=certainty,
        )
