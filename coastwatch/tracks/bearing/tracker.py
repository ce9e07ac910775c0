"""Bearing tracks: a window of the newest bearings of each contact, bearing and rate by least squares."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import (
    ID_STRIDE,
    Array,
    BearingReports,
    BearingTracks,
    Bools,
    ExpectedVessels,
    Floats,
    Ints,
    Sensors,
    Sonars,
)
from coastwatch.batches.limits import CONTACTS
from coastwatch.geodesy import wrap_deg, wrap_rad
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.stage import Count, Method, NotNegative, Positive, Probability
from coastwatch.tracks.bearing.line import Slots, line, relative_weight, scatter
from coastwatch.tracks.bearing.looks import few, looks_of, near_in_bearing, rounds
from coastwatch.tracks.bearing.memory import ROWS, BearingMemory, Measured
from coastwatch.tracks.bearing.vessels import Predicted, chosen_pairs, in_crowd, predicted_bearings
from coastwatch.tracks.inputs import BearingInput

GAIN = 100.0  # greater than any squared gate plus the logarithm of its width: every bearing in a gate has a positive gain
PATIENCE = 2.5  # intervals of its sensor that a track waits for a bearing, if that is longer than `drop_after_s`
TURN_GAIN = 0.2  # share of the newest time between two bearings of a track that is taken over
AGAIN = 0.5  # of a turn, before which a track takes no second bearing
FEWEST_TURNED = 3  # tracks of a look that tell the turn
NEAR_SIGMAS = 1.5  # of a bearing that tells the turn
SAME_DIRECTION = 5.0  # standard deviations of bearings, within which two may be of one vessel
NOISE_GAIN = 0.05  # share of the scatter of a cycle that is taken over
NOISE_DOUBTED = 2.0  # variance over the stated one from which the stated one is not believed
MOST_NOISE = 400.0
SAME_SLOT = 0.75  # of the spacing: a clock that jitters by a quarter still fills one slot a report
OWN, OF_VESSEL = -1, -2  # contact of our own tracks; that of a track of vessel v is OF_VESSEL - v


class Windows:
    """Copies of the columns of a BearingMemory under their names, to be written during a cycle."""

    def __init__(self, memory: BearingMemory, settings: BearingWindow, first_id: Ints, stated: Sonars) -> None:
        """Args: first_id: (K,) the first track id of each sensor; stated: the sensors as the scenario has them."""
        self.column: dict[str, Array] = {name: getattr(memory, name).copy() for name in ROWS}
        self.column |= vars(Measured.empty(N=len(memory.track_id)))
        known = memory if len(memory.counter) == len(first_id) else BearingMemory.empty(K=len(first_id))
        self.counter, self.noise, self.turn_s = known.counter.copy(), known.noise.copy(), known.turn_s.copy()
        self.settings, self.spacing_s, self.first_id = settings, settings.window_s / settings.length, first_id
        self.sigma_rad = stated.bearing_sigma_rad
        self.noise_rad = self.sigma_rad * np.sqrt(np.where(self.noise < NOISE_DOUBTED, 1.0, self.noise))
        self.drop_after_s = np.maximum(settings.drop_after_s, PATIENCE * stated.interval_s)
        self.far_off = 0

    def update_contacts(self, reports: BearingReports) -> None:
        """Updates tracks by one report of each of some contacts. A contact that was silent for too long begins a new track.

        So does one whose last two bearings agree with each other, and not with those before: its number is another vessel's now. A
        single bearing far from the others is not used.
        """
        c = self.column
        wanted = reports.sensor * CONTACTS + reports.contact
        rows = np.flatnonzero(c["contact"] >= 0)
        row = np.append(rows, -1)[row_of(c["sensor"][rows] * CONTACTS + c["contact"][rows], wanted)]
        ended = (row >= 0) & (reports.time_s - np.append(c["updated_s"], np.nan)[row] > self.drop_after_s[reports.sensor])
        known = np.flatnonzero((row >= 0) & ~ended)
        far, agrees = self._is_far_off(row[known], reports.take(known))
        ended[known[far & agrees]] = True
        doubted = known[far & ~agrees]
        c["doubt_s"][row[doubted]] = reports.time_s[doubted]
        c["doubt_rad"][row[doubted]] = wrap_rad(np.radians(reports.bearing_deg[doubted]))
        self.far_off += int(far.sum())
        self.update(row[known[~far]], reports.take(known[~far]))
        begun = reports.take((row < 0) | ended)
        if ended.any():
            others = np.ones(len(c["sensor"]), np.bool_)
            others[row[ended]] = False
            self.keep(others)
        self.initialise(begun)

    def _is_far_off(self, row: Ints, reports: BearingReports) -> tuple[Bools, Bools]:
        """Which bearings no vessel at sea could have after those of their contact, and which of them agree with one before. (M,), (M,)"""
        c, turn_rad_s = self.column, np.radians(self.settings.rate_sigma_deg_s)
        slots = Slots.newest(c, row, self.settings.rate_length)
        bearing, _, covariance = line(slots, reports.time_s, self.noise_rad, turn_rad_s)
        own = self.noise_rad[reports.sensor] ** 2 / relative_weight(reports, self.sigma_rad)
        said, limit = wrap_rad(np.radians(reports.bearing_deg)), self.settings.far_off_sigmas**2
        turned = (turn_rad_s * np.maximum(reports.time_s - c["updated_s"][row], self.spacing_s)) ** 2
        far = wrap_rad(said - bearing) ** 2 > limit * (covariance[:, 0, 0] + own + turned)
        far &= reports.time_s > c["updated_s"][row]
        turned = (turn_rad_s * np.maximum(reports.time_s - c["doubt_s"][row], self.spacing_s)) ** 2
        return far, wrap_rad(said - c["doubt_rad"][row]) ** 2 <= limit * (2.0 * own + turned)

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
        c["doubt_s"][row] = c["doubt_rad"][row] = np.nan
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
            "started_s": reports.time_s,
        }
        self.counter += np.bincount(reports.sensor, minlength=len(self.counter))
        before = len(self.column["track_id"])
        new = vars(BearingMemory.empty(N=n, W=self.settings.length)) | vars(Measured.empty(N=n)) | columns
        for name, old in self.column.items():
            self.column[name] = np.concatenate([old, new[name]])
        self.update(before + np.arange(n), reports)

    def count_look(self, rows: Ints, time_s: Floats, hit: Ints) -> None:
        """Counts one look of the sensor at each of these rows, and a miss where it had no bearing. In one turn a row is counted once."""
        c = self.column
        counted = time_s - c["looked_s"][rows] >= SAME_SLOT * self.turn_s[c["sensor"][rows]]
        rows, time_s = rows[counted], time_s[counted]
        c["looks"][rows] += 1
        c["misses"][rows] += 1
        c["looked_s"][rows] = time_s
        c["misses"][hit] = 0

    def learn_turn(self, row: Ints, reports: BearingReports) -> None:
        """Learns the turn of sensors that give each bearing its own time. Args: row: (M,) tracks that the reports are entered in next."""
        off = np.abs(wrap_rad(np.radians(reports.bearing_deg) - self.column["bearing_rad"][row, -1]))
        near = off <= NEAR_SIGMAS * self.noise_rad[reports.sensor]  # the others may be of another vessel
        row, reports = row[near], reports.take(near)
        between_s = reports.time_s - self.column["updated_s"][row]
        count, median = kernels.tables.groups.median_of_groups(reports.sensor, between_s, len(self.turn_s))
        some = np.flatnonzero(count >= FEWEST_TURNED)
        known = self.turn_s[some] > 0.0
        self.turn_s[some] += np.where(known, TURN_GAIN, 1.0) * (median[some] - self.turn_s[some])

    def keep(self, rows: Bools) -> None:
        """Forgets the other rows."""
        if not rows.all():
            self.column = {name: values[rows] for name, values in self.column.items()}

    def learn_noise(self) -> None:
        """Learns the noise of each sensor from how far the bearings of tracks heard in this cycle are from a smooth curve through them."""
        c = self.column
        heard = np.flatnonzero(c["measured_weight"] > 0.0)
        ratio = scatter(Slots.newest(c, heard, self.settings.rate_length), self.sigma_rad)
        known = np.isfinite(ratio)
        count, median = kernels.tables.groups.median_of_groups(c["sensor"][heard[known]], ratio[known], len(self.noise))
        some = count > 0
        self.noise[some] += NOISE_GAIN * (np.minimum(median[some], MOST_NOISE) - self.noise[some])

    def memory(self, dropped: int, far_off: int, left_out: int) -> BearingMemory:
        """The columns, sorted by track_id. Args: reports that were dropped, far off and left out, up to now."""
        order = np.argsort(self.column["track_id"], kind="stable")
        columns = {name: self.column[name][order] for name in ROWS}
        return BearingMemory(
            **columns,
            counter=self.counter,
            noise=self.noise,
            turn_s=self.turn_s,
            dropped=dropped,
            far_off=far_off,
            left_out=left_out,
        )

    def measured(self) -> Measured:
        """Mean of the bearings of this cycle, its weight, 0 where there was none, and its certainty; sorted by track_id."""
        order = np.argsort(self.column["track_id"], kind="stable")
        return Measured(**{name: self.column[name][order] for name in Measured.__dataclass_fields__})


def _between_deg(first: Floats, second: Floats, share: Floats) -> Floats:
    """Positions at this share of the way from the first to the second. (M, 2)"""
    off = second - first
    off[:, 1] = wrap_deg(off[:, 1])
    mean = first + off * share[:, None]
    mean[:, 1] = wrap_deg(mean[:, 1])
    # Wrapping rounds: the position of a fixed sensor must keep its bits.
    return np.where(off == 0.0, first, mean)


def _is_alone(reports: BearingReports) -> Bools:
    """Which sensors give each bearing of a look its own time, and gave several. (K,) Args: reports: sorted by sensor, then time."""
    count = np.bincount(reports.sensor)
    same = (np.diff(reports.sensor) == 0) & (np.diff(reports.time_s) == 0.0)
    return np.asarray((count > 1) & (np.bincount(reports.sensor[1:][same], minlength=len(count)) == 0))


class BearingWindow(Method):
    """One track for each contact that a sensor numbers; tracks of our own where it gives bearings without numbers (contact -1).

    Bearings fall into slots of `window_s / length` seconds that hold their mean, so that a camera needs no more memory than a
    sonar. Bearing and rate are the least squares line through the newest `rate_length` slots, the rate with a wide prior, so
    that one bearing is enough. What is not newer than what its contact has is left out. So is a bearing far from the others of
    its contact, unless the next one agrees with it: then a new track begins. Scatter of twice the stated variance is learned.
    Own tracks: at each look of the sensor, bearings are assigned one to one to the tracks whose prediction is within
    `gate_sigmas`; what is left begins new tracks. A track is yielded once `start_hits` of its first `start_looks` looks had a
    bearing, and ends after `end_misses` looks without. Every track ends when it is silent for longer than `drop_after_s`.
    Where a gate holds `crowd` vessels of the picture on average, these predict the bearings, one track for each, and only what is
    left goes to own tracks. Of very many bearings in a cycle an even choice is used, and the others are counted.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, eq. 10 (bearing and angular velocity from successive bearings over a given time).
    """

    method: Literal["bearing_window"] = "bearing_window"
    window_s: Positive = 300.0
    length: Annotated[int, Field(ge=2, le=1000)] = 100  # slots
    rate_length: Annotated[int, Field(ge=2)] = 10  # slots
    rate_sigma_deg_s: Positive = 0.5  # standard deviation of bearing rates before anything is known
    drop_after_s: Positive = 30.0  # of silence, or 2.5 intervals of the sensor
    far_off_sigmas: Positive = 5.0  # of a bearing from the others of its contact, from which it is doubted
    gate_sigmas: Positive = 3.5
    start_hits: Count = 3
    start_looks: Count = 5
    end_misses: Count = 10
    ahead_s: Positive = 5.0  # a report stamped more than this after the cycle is dropped
    crowd: NotNegative = 0.25  # vessels of the picture in a gate, on average, from which these predict the bearings
    detection_probability: Probability = 0.95  # that a sensor hears a vessel of the picture in its coverage, in a look

    def init(self) -> BearingMemory:
        return BearingMemory.empty(W=self.length)

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
        windows = Windows(memory, self, first, sensors.sonars)
        sensors = replace(sensors, sonars=replace(sensors.sonars, bearing_sigma_rad=windows.noise_rad))
        keys = (reports.bearing_deg, reports.contact, reports.sensor, reports.time_s)
        order = np.lexsort(keys)
        usable = np.isfinite(reports.bearing_deg) & np.isfinite(reports.time_s) & (reports.time_s <= time_s + self.ahead_s)
        dropped = memory.dropped + int((~usable).sum())
        reports = reports.take(order[usable[order]])
        look = looks_of(reports, SAME_DIRECTION * windows.noise_rad, SAME_SLOT * sensors.sonars.interval_s)
        used = few(reports, look)
        left_out, reports, look = memory.left_out + int((~used).sum()), reports.take(used), look[used]
        numbered, own = reports.take(reports.contact >= 0), reports.take(reports.contact < 0)
        for rows in rounds(numbered.sensor * CONTACTS + numbered.contact, np.arange(len(numbered))):
            windows.update_contacts(numbered.take(rows))
        own = replace(own, contact=np.full(len(own), OWN))
        for rows in rounds(own.sensor, look[look >= 0]):
            self._look(windows, own.take(rows), expected, sensors)
        windows.learn_noise()
        c = windows.column
        windows.keep(time_s - c["updated_s"] <= windows.drop_after_s[c["sensor"]])
        after = windows.memory(dropped, memory.far_off + windows.far_off, left_out)
        return after, self._tracks(after, windows.measured(), time_s, sensors)

    def _look(self, windows: Windows, reports: BearingReports, expected: ExpectedVessels, sensors: Sensors) -> None:
        """One look of each of some sensors that do not number contacts: assign, begin and end tracks."""
        c = windows.column
        reports = reports.take(np.argsort(reports.sensor, kind="stable"))
        start = np.searchsorted(reports.sensor, c["sensor"])
        count = np.searchsorted(reports.sensor, c["sensor"], side="right") - start
        looked = np.flatnonzero((c["contact"] < 0) & (count > 0))
        time_s = 0.5 * (reports.time_s[start[looked]] + reports.time_s[start[looked] + count[looked] - 1])
        hit, begun, rest = self._of_vessels(windows, reports, expected, sensors)
        seen = np.flatnonzero(c["contact"][looked] == OWN)
        pair, report = self._of_own_tracks(windows, looked[seen], time_s[seen], rest)
        turns = _is_alone(reports)[rest.sensor[report]]
        windows.learn_turn(pair[turns], rest.take(report[turns]))
        windows.update(pair, rest.take(report))
        windows.count_look(looked, time_s, np.append(hit, pair))
        ended = (c["misses"] >= self.end_misses) | ((c["looks"] >= self.start_looks) & (c["hits"] < self.start_hits))
        windows.keep((c["contact"] >= 0) | ~ended)
        unused = np.ones(len(rest), np.bool_)
        unused[report] = False
        before = len(windows.column["looks"])
        windows.initialise(BearingReports.join([begun, rest.take(unused)]))
        windows.column["looks"][before:] = 1
        windows.column["looked_s"][before:] = windows.column["updated_s"][before:]

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
        noise = sensors.sonars.bearing_sigma_rad[reports.sensor] ** 2 / relative_weight(reports, windows.sigma_rad)
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

    def _of_own_tracks(self, windows: Windows, seen: Ints, time_s: Floats, reports: BearingReports) -> tuple[Ints, Ints]:
        """The best one-to-one pairs of our own tracks and bearings of a look: rows of tracks (B,) and of reports (B,).

        Args: seen: (T,) rows of tracks whose sensor had the look; time_s: (T,) of it; reports: (M,) sorted by sensor.
        """
        c, sigma_rad = windows.column, windows.noise_rad
        slots = Slots.newest(c, seen, self.rate_length)
        bearing, _, covariance = line(slots, time_s, sigma_rad, np.radians(self.rate_sigma_deg_s))
        weight = relative_weight(reports, windows.sigma_rad)
        widest = np.zeros(len(sigma_rad))
        np.maximum.at(widest, reports.sensor, sigma_rad[reports.sensor] ** 2 / weight)
        half = self.gate_sigmas * np.sqrt(covariance[:, 0, 0] + widest[c["sensor"][seen]])
        pair, report = near_in_bearing(bearing, half, c["sensor"][seen], reports)
        waited_s = reports.time_s[report] - c["updated_s"][seen[pair]]
        again = waited_s >= AGAIN * windows.turn_s[c["sensor"][seen[pair]]]
        pair, report = pair[again], report[again]
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

    def _tracks(self, memory: BearingMemory, measured: Measured, time_s: float, sensors: Sensors) -> BearingTracks:
        out = np.flatnonzero((memory.contact >= 0) | (memory.hits >= self.start_hits))
        slots = Slots.newest(vars(memory), out, self.rate_length)
        now_s, rate_sigma_rad_s = np.full(len(out), time_s), np.radians(self.rate_sigma_deg_s)
        bearing, rate, covariance = line(slots, now_s, sensors.sonars.bearing_sigma_rad, rate_sigma_rad_s)
        window_s = memory.time_s[out]
        old = ~(window_s >= time_s - self.window_s)
        site, sigma = memory.site_deg[out], sensors.sonars.bearing_sigma_rad[memory.sensor[out]]
        measured = measured.take(out)
        none = measured.measured_weight == 0.0
        variance = sigma**2 / np.where(none, 1.0, measured.measured_weight)
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
            window_time_s=np.where(old, np.nan, window_s),
            window_bearing_rad=np.where(old, np.nan, memory.bearing_rad[out]),
            window_site_deg=np.where(old[:, :, None], np.nan, site),
            window_variance=np.where(old, np.nan, sigma[:, None] ** 2 / memory.precision[out]),
            signatures=memory.signatures[out],
            origin=memory.origin[out],
            measured_s=np.where(none, np.nan, measured.measured_s),
            measured_rad=np.where(none, np.nan, measured.measured_rad),
            measured_variance=np.where(none, np.nan, variance),
            measured_site_deg=np.where(none[:, None], np.nan, measured.measured_site_deg),
            certainty=measured.certainty,
        )
