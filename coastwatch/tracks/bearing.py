"""Bearing tracks: a window of the newest bearings of each contact, bearing and rate by least squares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Array, BearingReports, BearingTracks, Floats, Ints, Sensors
from coastwatch.geodesy import wrap_rad
from coastwatch.stage import Method
from coastwatch.tracks.bearing_table import CONTACTS, Table, WindowMemory

Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]

ID_STRIDE = 2**40  # track ids of one source
WIDEST = 100.0  # more than any gate with the logarithm of its width, so that what is in a gate has a gain


class BearingWindow(Method):
    """One track for each contact that a sensor numbers; tracks of our own where it gives bearings without numbers (contact -1).

    Bearings fall into slots of `window_s / length` seconds that hold their mean, so that a camera needs no more room than a
    sonar. Bearing and rate are the least squares line through the newest `rate_length` slots, the rate with a wide prior, so
    that one bearing is enough. A report that is not newer than what its contact already has is left out.
    Own tracks: at each look of the sensor, bearings are assigned one to one to the tracks whose prediction is within
    `gate_sigmas`; what is left begins new tracks. A track is yielded once `start_hits` of its first `start_looks` looks had a
    bearing, and ends after `end_misses` looks without. Every track ends when it is silent for longer than `drop_after_s`.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, eq. 10 (bearing and angular velocity from successive bearings over a given time).
    """

    method: Literal["bearing_window"] = "bearing_window"
    window_s: Positive = 300.0
    length: Annotated[int, Field(ge=2, le=1000)] = 100
    rate_length: Annotated[int, Field(ge=2)] = 10  # slots
    rate_sigma_deg_s: Positive = 0.5  # standard deviation of bearing rates before anything is known
    drop_after_s: Positive = 30.0
    gate_sigmas: Positive = 3.5
    start_hits: Count = 3
    start_looks: Count = 5
    end_misses: Count = 10

    def init(self) -> WindowMemory:
        return WindowMemory.empty(self.length)

    def step(
        self, memory: WindowMemory, reports: BearingReports, time_s: float, sensors: Sensors
    ) -> tuple[WindowMemory, BearingTracks]:
        """Tracks after the reports of this cycle, predicted to time_s.

        Args: reports: in any order within the cycle; a bearing that is not finite is left out.
        Returns: memory and BearingTracks, sorted by track_id, W = `length`.
        Raises: ValueError for a contact number of 2^40 or more, or a sensor that the scenario has not.
        """
        _check(reports, len(sensors.sonars))
        first = (sensors.sonar_source(0) + np.arange(len(sensors.sonars))) * ID_STRIDE
        table = Table(memory, self.window_s / self.length, first)
        keys = (reports.bearing_deg, reports.contact, reports.sensor, reports.time_s)
        order = np.lexsort(keys)
        reports = reports.take(order[np.isfinite(keys[0][order]) & np.isfinite(keys[3][order])])
        numbered, own = reports.take(reports.contact >= 0), reports.take(reports.contact < 0)
        for rows in _rounds(numbered.sensor * CONTACTS + numbered.contact):
            table.numbered(numbered.take(rows), self.drop_after_s)
        for rows in _looks(own):
            self._look(table, own.take(rows), sensors.sonars.bearing_sigma_rad)
        table.keep(time_s - table.column["updated_s"] <= self.drop_after_s)
        after = table.frozen()
        return after, self._tracks(after, time_s, sensors)

    def _look(self, table: Table, reports: BearingReports, sigma_rad: Floats) -> None:
        """One look of each of some sensors without numbers of their own: assign, begin, end."""

        c = table.column
        reports = reports.take(np.argsort(reports.sensor, kind="stable"))
        start = np.searchsorted(reports.sensor, c["sensor"])
        count = np.searchsorted(reports.sensor, c["sensor"], side="right") - start
        seen = np.flatnonzero((c["contact"] < 0) & (count > 0))
        bearing, _, covariance = self._line({k: c[k][seen] for k in WINDOW}, reports.time_s[start[seen]], sigma_rad)
        pair = np.repeat(np.arange(len(seen)), count[seen])
        report = np.arange(len(pair)) - np.repeat(np.cumsum(count[seen]) - count[seen] - start[seen], count[seen])
        off = wrap_rad(np.radians(reports.bearing_deg[report]) - bearing[pair])
        noise = sigma_rad[c["sensor"][seen[pair]]] ** 2
        spread = covariance[pair, 0, 0] + noise
        # The width of a gate counts against it, and a proven track goes first: else one that knows nothing wins every bearing.
        tier = WIDEST * (1.0 + (c["hits"][seen[pair]] >= self.start_hits))
        gain = np.where(off**2 < self.gate_sigmas**2 * spread, tier - off**2 / spread - np.log(spread / noise), 0.0)
        chosen = np.asarray(
            kernels.association.assignment.assign(pair.astype(np.int64), report.astype(np.int64), gain), np.bool_
        )
        hit = seen[pair[chosen]]
        table.record(hit, reports.take(report[chosen]))
        table.look(seen, hit)
        ended = (c["misses"] >= self.end_misses) | ((c["looks"] >= self.start_looks) & (c["hits"] < self.start_hits))
        table.keep((c["contact"] >= 0) | ~ended)
        unused = np.ones(len(reports), np.bool_)
        unused[report[chosen]] = False
        before = len(table.column["looks"])
        table.begin(reports.take(unused))
        table.column["looks"][before:] = 1

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

    def _tracks(self, memory: WindowMemory, time_s: float, sensors: Sensors) -> BearingTracks:
        out = np.flatnonzero((memory.contact >= 0) | (memory.hits >= self.start_hits))
        window = {name: getattr(memory, name)[out] for name in WINDOW}
        bearing, rate, covariance = self._line(window, np.full(len(out), time_s), sensors.sonars.bearing_sigma_rad)
        old = ~(window["time_s"] >= time_s - self.window_s)
        site = memory.site_deg[out]
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
            signatures=memory.signatures[out],
            origin=memory.origin[out],
        )


WINDOW = ("sensor", "time_s", "bearing_rad", "weight")  # columns that a line is drawn through


def _check(reports: BearingReports, sensors: int) -> None:
    if len(reports) and not 0 <= reports.sensor.min() <= reports.sensor.max() < sensors:
        raise ValueError(f"BearingReports.sensor: got {reports.sensor.max()}, needed 0 to {sensors - 1}")
    if len(reports) and reports.contact.max() >= CONTACTS:
        raise ValueError(f"BearingReports.contact: got {reports.contact.max()}, needed less than 2^40")


def _rounds(key: Ints) -> Iterator[Ints]:
    """First the rows with the first of each key, then those with the second, and so on. Args: key: (M,)."""
    order = np.argsort(key, kind="stable")
    rank = np.empty(len(key), np.int64)
    rank[order] = np.arange(len(key)) - np.searchsorted(key[order], key[order])
    for r in range(int(rank.max(initial=-1)) + 1):
        yield np.flatnonzero(rank == r)


def _looks(reports: BearingReports) -> Iterator[Ints]:
    """Rows of the first look of every sensor, then of the second, and so on; a look is what one sensor says of one time."""
    look, of = np.unique(np.column_stack([reports.sensor, reports.time_s]), axis=0, return_inverse=True)
    sensor = look[:, 0]
    rank = (np.arange(len(look)) - np.searchsorted(sensor, sensor))[of.reshape(-1)]
    for r in range(int(rank.max(initial=-1)) + 1):
        yield np.flatnonzero(rank == r)
