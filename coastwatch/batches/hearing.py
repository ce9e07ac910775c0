"""Which sensors are heard, and where sensors of a kind should see a vessel, by their ranges.

What a sensor that is not heard would say of a vessel is not known. One that is silent, or was never heard, covers nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from coastwatch import kernels
from coastwatch.batches.sensors import Radars, Sensors, Stations
from coastwatch.batches.struct import Batch, column, optional_column
from coastwatch.kernels.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from coastwatch.kernels.geometry.sensor_coverage import Coverage  # numba takes half a second to load


@dataclass(frozen=True, eq=False)
class Hearing(Batch):
    """One row for each sensor of a kind.

    Clocks stand while a sensor is silent. Those of a radar stand in the cycle in which it returns too: the detection that is known
    in it is of the cycle before.
    """

    heard_s: Floats = column(np.float64, "R")  # newest report; -inf: none since the start; a new row is given its own
    usual_s: Floats = column(np.float64, "R", new=np.nan)  # interval between reports before; NaN: not known
    amount: Floats = column(np.float64, "R")  # vessels on AIS, or plots or tracks of a cycle, when it was heard
    silent: Bools = column(np.bool_, "R")  # no report for much longer than usual
    stands_from_s: Floats = column(np.float64, "R", new=np.inf)  # from when clocks stand in this cycle; inf: they run
    returned_s: Floats = column(np.float64, "R", new=-np.inf)  # cycle in which it was heard again after a silence; -inf: never
    # Until when it would have heard a vessel that sends: its newest report; inf where too few vessels are heard to tell
    known_until_s: Floats = optional_column("R", new=np.inf)

    @property
    def heard(self) -> Bools:
        """(R,) heard since the start, and not silent."""
        return np.isfinite(self.heard_s) & ~self.silent

    @property
    def stands(self) -> Bools:
        """(R,) whose clocks stand."""
        return np.isfinite(self.stands_from_s)


@dataclass(frozen=True, eq=False)
class SensorHearing:
    """Which sensors are heard in a cycle."""

    radars: Hearing
    stations: Hearing  # all silent where AIS is
    track_sources: Hearing
    ais: Hearing  # one row: all AIS reports together


@dataclass(frozen=True, eq=False)
class SensorCover:
    """Where the sensors of a kind cover in a cycle."""

    heard: Coverage  # of those that are heard
    silent: tuple[tuple[float, Coverage], ...]  # of those whose clocks stand, by the time from which they do, ascending
    returned_s: Floats  # (H,) of `heard.site`: when each was heard again after it was silent; -inf: it never was
    known_until_s: Floats  # (H,) of `heard.site`: as of `Hearing`

    def within(self, position_deg: Floats, candidates: Bools) -> Bools:
        """Which of the candidates a sensor covers that is heard. Args: position_deg: (V, 2); candidates: (V,). Returns: (V,)."""
        return _within(self.heard, position_deg, candidates)

    def stands_from_s(self, position_deg: Floats, candidates: Bools) -> Floats:
        """From when the clocks of candidates stand that silent sensors reach; inf elsewhere. (V,) Args: as of `within`."""
        out = np.full(len(candidates), np.inf)
        for from_s, coverage in self.silent:  # the last one to fall silent counts
            out[_within(coverage, position_deg, candidates)] = from_s
        return out

    def begins_s(self, position_deg: Floats, candidates: Bools, time_s: float, returns_s: Floats) -> Floats:
        """From when something may begin to hold at candidates that a sensor covers: this cycle, or later. (V,)

        It is `returns_s`, (V,), after the first one of the sensors there was heard again: what the others miss it would have heard.
        """
        out = np.full(len(candidates), float(time_s))
        if not (self.returned_s + returns_s.max(initial=0.0) > time_s).any():
            return out
        rows = np.flatnonzero(candidates)
        row, sensor = self._reached(position_deg[rows])
        first_s = np.full(len(rows), np.inf)
        np.minimum.at(first_s, row, self.returned_s[sensor])
        reached = np.isfinite(first_s)
        out[rows[reached]] = np.maximum(time_s, first_s[reached] + returns_s[rows[reached]])
        return out

    def until_s(self, position_deg: Floats, time_s: float) -> Floats:
        """Until when the sensors there would have heard a vessel that sends, this cycle at most. (V,) Args: position_deg: (V, 2)."""
        out = np.full(len(position_deg), -np.inf)
        row, sensor = self._reached(position_deg)
        np.maximum.at(out, row, self.known_until_s[sensor])
        return np.where(np.isneginf(out), time_s, np.minimum(out, time_s))

    def _reached(self, position_deg: Floats) -> tuple[Ints, Ints]:
        """Pairs of a position and a sensor that is heard and reaches it. (P,), (P,)"""
        site = self.heard.site
        site_deg = np.stack([site["latitude"], site["longitude"]], axis=1)
        row, sensor, _ = kernels.geometry.sensor_coverage.pairs_in_range(
            site_deg, site["range"].copy(), position_deg, np.zeros(len(position_deg))
        )
        return row, sensor


def sensor_covers(sensors: Sensors, margin: float, hearing: SensorHearing | None = None) -> tuple[SensorCover, SensorCover]:
    """Where AIS stations and radars cover. Args: margin: share of a range that counts; hearing: none: all are heard."""
    if hearing is None:
        radars, stations = Hearing.empty(R=len(sensors.radars)), Hearing.empty(R=len(sensors.stations))
    else:
        radars, stations = hearing.radars, hearing.stations
    return _cover(sensors, margin, "stations", stations), _cover(sensors, margin, "radars", radars)


def _cover(sensors: Sensors, margin: float, kind: str, hearing: Hearing) -> SensorCover:
    heard = hearing.heard & ~hearing.stands
    returned_s, known_until_s = hearing.returned_s[heard], hearing.known_until_s[heard]
    if heard.all():
        return SensorCover(_some(sensors, margin, kind, heard.tobytes()), (), returned_s, known_until_s)
    times = np.unique(hearing.stands_from_s[hearing.stands]).tolist()
    silent = ((from_s, hearing.stands_from_s == from_s) for from_s in times)
    return SensorCover(
        _some(sensors, margin, kind, heard.tobytes()),
        tuple((from_s, _some(sensors, margin, kind, rows.tobytes())) for from_s, rows in silent),
        returned_s,
        known_until_s,
    )


@lru_cache(maxsize=64)
def _some(sensors: Sensors, margin: float, kind: str, chosen: bytes) -> Coverage:
    """Coverage of some sensors. It is cached: the sensors are the same object throughout a run. Args: chosen: (R,) booleans."""
    of: Radars | Stations = getattr(sensors, kind)
    rows = np.flatnonzero(np.frombuffer(chosen, np.bool_))
    found: Coverage = kernels.geometry.sensor_coverage.coverage_of(of.site_deg[rows], margin * of.range_m[rows], 0.0)
    return found


def _within(coverage: Coverage, position_deg: Floats, candidates: Bools) -> Bools:
    out, rows = np.zeros(len(candidates), np.bool_), np.flatnonzero(candidates)
    out[rows] = kernels.geometry.sensor_coverage.in_any_range(coverage, position_deg[rows])
    return out
