"""Which sensors are heard: what a sensor that is not heard would say of a vessel is not known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches.struct import Batch, column
from coastwatch.kernels.arrays import Bools, Floats


@dataclass(frozen=True, eq=False)
class Hearing(Batch):
    """One row for each sensor of a kind.

    Clocks stand while a sensor is silent. Those of a radar stand in the cycle in which it returns too: the detection that is known
    in it is of the cycle before.
    """

    heard_s: Floats = column(np.float64, "R")  # newest report; -inf: none since the start
    usual_s: Floats = column(np.float64, "R")  # interval between reports before; NaN: not known
    amount: Floats = column(np.float64, "R")  # vessels on AIS, or plots or tracks of a cycle, when it was heard
    silent: Bools = column(np.bool_, "R")  # no report for much longer than usual
    stands_from_s: Floats = column(np.float64, "R")  # from when clocks stand in this cycle; inf: they run
    returned_s: Floats = column(np.float64, "R")  # cycle in which it was heard again after it was silent; -inf: it never was

    @property
    def heard(self) -> Bools:
        """(R,) heard since the start, and not silent."""
        return np.isfinite(self.heard_s) & ~self.silent

    @property
    def stands(self) -> Bools:
        """(R,) whose clocks stand."""
        return np.isfinite(self.stands_from_s)

    @classmethod
    def always(cls, sensors: int) -> Hearing:
        """All of them are heard."""
        number = np.zeros(sensors)
        return cls(number, number + np.nan, number, np.zeros(sensors, np.bool_), number + np.inf, number - np.inf)


@dataclass(frozen=True, eq=False)
class SensorHearing:
    """Which sensors are heard in a cycle."""

    radars: Hearing
    stations: Hearing  # all silent where AIS is
    track_sources: Hearing
    ais: Hearing  # one row: all AIS reports together
