"""Where sensors of a kind should see a vessel, by their ranges. One that is silent, or was never heard, covers nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from coastwatch import kernels
from coastwatch.batches.hearing import Hearing, SensorHearing
from coastwatch.batches.sensors import Radars, Sensors, Stations
from coastwatch.batches.struct import Bools, Floats

if TYPE_CHECKING:
    from coastwatch.kernels.geometry.sensor_coverage import Coverage  # numba takes half a second to load


@dataclass(frozen=True, eq=False)
class SensorCover:
    """Where the sensors of a kind cover in a cycle."""

    heard: Coverage  # of those that are heard
    silent: tuple[tuple[float, Coverage], ...]  # of those that are silent, by the time from which clocks stand, ascending
    returned_s: float = -np.inf  # when the last one of those that are heard was heard again after it was silent

    def within(self, position_deg: Floats, candidates: Bools) -> Bools:
        """Which of the candidates a sensor covers that is heard. Args: position_deg: (V, 2); candidates: (V,). Returns: (V,)."""
        return _within(self.heard, position_deg, candidates)

    def stands_from_s(self, position_deg: Floats, candidates: Bools) -> Floats:
        """From when the clocks of candidates stand that silent sensors reach; inf elsewhere. (V,) Args: as of `within`."""
        out = np.full(len(candidates), np.inf)
        for from_s, coverage in self.silent:  # the last one to fall silent counts
            out[_within(coverage, position_deg, candidates)] = from_s
        return out


def sensor_covers(sensors: Sensors, margin: float, hearing: SensorHearing | None = None) -> tuple[SensorCover, SensorCover]:
    """Where AIS stations and radars cover. Args: margin: share of a range that counts; hearing: none: all are heard."""
    if hearing is None:
        ais, radars = (_all(sensors, margin, kind) for kind in ("stations", "radars"))
        return SensorCover(ais, ()), SensorCover(radars, ())
    return _cover(sensors, margin, "stations", hearing.stations), _cover(sensors, margin, "radars", hearing.radars)


def _cover(sensors: Sensors, margin: float, kind: str, hearing: Hearing) -> SensorCover:
    heard = hearing.heard
    returned_s = float(hearing.returned_s[heard].max(initial=-np.inf))
    if heard.all():
        return SensorCover(_all(sensors, margin, kind), (), returned_s)
    times = np.unique(hearing.stands_from_s[hearing.silent]).tolist()
    silent = ((from_s, hearing.silent & (hearing.stands_from_s == from_s)) for from_s in times)
    return SensorCover(
        _some(sensors, margin, kind, heard.tobytes()),
        tuple((from_s, _some(sensors, margin, kind, rows.tobytes())) for from_s, rows in silent),
        returned_s,
    )


def _all(sensors: Sensors, margin: float, kind: str) -> Coverage:
    return _some(sensors, margin, kind, np.ones(len(getattr(sensors, kind)), np.bool_).tobytes())


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
