"""The table of bearing tracks while a cycle is worked on: rows are added and written here, never in anybody's memory."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from coastwatch.batches import CLASSES, Array, BearingReports, Bools, Floats, Ints
from coastwatch.geodesy import wrap_deg, wrap_rad

SAME_SLOT = 0.75  # of the spacing: a clock that jitters by a quarter still fills one slot a report
CONTACTS = 2**40  # contact numbers of one sensor


@dataclass(frozen=True, eq=False)
class WindowMemory:
    """All tracks, sorted by track_id; the window is oldest first, NaN before the first slot."""

    track_id: Ints  # (N,)
    sensor: Ints  # (N,)
    contact: Ints  # (N,) -1: the sensor gives none and the track is our own
    updated_s: Floats  # (N,)
    started_s: Floats  # (N,)
    begin_s: Floats  # (N,) first report of the newest slot
    hits: Ints  # (N,) reports
    looks: Ints  # (N,) looks of the sensor since the track began; own tracks only
    misses: Ints  # (N,) looks without a report, in a row; own tracks only
    origin: Ints  # (N,)
    time_s: Floats  # (N, W) mean of the slot
    bearing_rad: Floats  # (N, W) mean of the slot
    weight: Floats  # (N, W) reports in the slot, 0 where there is none
    site_deg: Floats  # (N, W, 2)
    signatures: Ints  # (N, C) reports that said each VesselClass
    counter: Ints  # (K,) tracks that each sensor has had

    @staticmethod
    def empty(window: int) -> WindowMemory:
        n, x, ring = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, window))
        return WindowMemory(
            n, n, n, x, x, x, n, n, n, n, ring, ring, ring, np.zeros((0, window, 2)), np.zeros((0, CLASSES), np.int64), n
        )


ROWS = tuple(f.name for f in fields(WindowMemory) if f.name != "counter")
FRESH = {"time_s": np.nan, "bearing_rad": np.nan, "weight": 0.0, "site_deg": np.nan, "begin_s": np.nan}


class Table:
    """Columns of WindowMemory under their names, open for writing."""

    def __init__(self, memory: WindowMemory, spacing_s: float, first_id: Ints) -> None:
        """Args: spacing_s: of slots; first_id: (K,) the first track id of each sensor."""
        self.column: dict[str, Array] = {name: getattr(memory, name).copy() for name in ROWS}
        self.counter = memory.counter.copy() if len(memory.counter) == len(first_id) else np.zeros(len(first_id), np.int64)
        self.spacing_s, self.first_id = spacing_s, first_id

    def numbered(self, reports: BearingReports, drop_after_s: float) -> None:
        """Takes one report of each of some contacts; a contact silent for longer than `drop_after_s` begins a new track."""
        c = self.column
        wanted = reports.sensor * CONTACTS + reports.contact
        rows = np.flatnonzero(c["contact"] >= 0)
        key = c["sensor"][rows] * CONTACTS + c["contact"][rows]
        rows = rows[np.argsort(key, kind="stable")]
        key = np.sort(key)
        at = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
        row = np.where(key[at] == wanted, rows[at], -1) if len(key) else np.full(len(wanted), -1)
        silent = (row >= 0) & (reports.time_s - c["updated_s"][row] > drop_after_s) if len(key) else np.zeros(len(row), bool)
        stale = np.ones(len(c["sensor"]), bool)
        stale[row[silent]] = False
        known = (row >= 0) & ~silent
        self.record(row[known], reports.take(known))
        begun = ~known
        if silent.any():
            self.keep(stale)
        self.begin(reports.take(begun))

    def record(self, row: Ints, reports: BearingReports) -> None:
        """Writes one report into the window of each of these rows, unless it is older than what the row has."""
        c = self.column
        newer = reports.time_s > c["updated_s"][row]
        row, reports = row[newer], reports.take(newer)
        same = reports.time_s - c["begin_s"][row] < SAME_SLOT * self.spacing_s
        self._new_slot(row[~same], reports.take(~same))
        self._same_slot(row[same], reports.take(same))
        c["updated_s"][row], c["origin"][row] = reports.time_s, reports.origin
        c["hits"][row] += 1
        told = reports.signature >= 0
        c["signatures"][row[told], reports.signature[told]] += 1

    def _new_slot(self, row: Ints, reports: BearingReports) -> None:
        bearing = wrap_rad(np.radians(reports.bearing_deg))
        values = {"time_s": reports.time_s, "bearing_rad": bearing, "weight": np.ones(len(row)), "site_deg": reports.site_deg}
        for name, value in values.items():
            ring = self.column[name]
            ring[row, :-1] = ring[row, 1:]
            ring[row, -1] = value
        self.column["begin_s"][row] = reports.time_s

    def _same_slot(self, row: Ints, reports: BearingReports) -> None:
        c = self.column
        weight = c["weight"][row, -1] + 1.0
        bearing, site = c["bearing_rad"][row, -1], c["site_deg"][row, -1]
        off = reports.site_deg - site
        off[:, 1] = wrap_deg(off[:, 1])
        c["weight"][row, -1] = weight
        c["time_s"][row, -1] += (reports.time_s - c["time_s"][row, -1]) / weight
        c["bearing_rad"][row, -1] = wrap_rad(bearing + wrap_rad(np.radians(reports.bearing_deg) - bearing) / weight)
        moved = site + off / weight[:, None]
        moved[:, 1] = wrap_deg(moved[:, 1])
        c["site_deg"][row, -1] = np.where(
            off == 0.0, site, moved
        )  # wrapping rounds: a sensor that stands still stays, to the bit

    def begin(self, reports: BearingReports) -> None:
        """Adds a track for each report."""
        n = len(reports)
        if n == 0:
            return
        order = np.argsort(reports.sensor, kind="stable")
        sensor = reports.sensor[order]
        number = np.empty(n, np.int64)
        number[order] = np.arange(n) - np.searchsorted(sensor, sensor)
        made = {
            "track_id": self.first_id[reports.sensor] + self.counter[reports.sensor] + number,
            "sensor": reports.sensor,
            "contact": np.maximum(reports.contact, -1),
            "updated_s": np.full(n, -np.inf),
            "started_s": reports.time_s,
        }
        self.counter += np.bincount(reports.sensor, minlength=len(self.counter))
        before = len(self.column["track_id"])
        for name, old in self.column.items():
            fresh = np.full((n, *old.shape[1:]), FRESH.get(name, 0), old.dtype)
            self.column[name] = np.concatenate([old, made.get(name, fresh)])
        self.record(before + np.arange(n), reports)

    def look(self, rows: Ints, hit: Ints) -> None:
        """Counts one look of the sensor at each of these rows, and a miss where it saw nothing."""
        c = self.column
        c["looks"][rows] += 1
        c["misses"][rows] += 1
        c["misses"][hit] = 0

    def keep(self, rows: Bools) -> None:
        """Forgets the other rows."""
        if not rows.all():
            self.column = {name: values[rows] for name, values in self.column.items()}

    def frozen(self) -> WindowMemory:
        """The table as memory, sorted by track_id."""
        order = np.argsort(self.column["track_id"], kind="stable")
        return WindowMemory(**{name: values[order] for name, values in self.column.items()}, counter=self.counter)
