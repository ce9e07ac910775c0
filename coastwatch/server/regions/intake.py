"""The cycles of a region as reports of a track source: each is used in the cycle of the centre in whose span it ends, once."""

from __future__ import annotations

import math
import time
from typing import Any

from coastwatch.batches import Fault, TrackReports
from coastwatch.server.regions.client import Connection
from coastwatch.server.regions.message import RegionCycle
from coastwatch.store import Intake

MISSING = "cycle of the region that it did not have any more"
LATE = "cycle of the region later than its cycle here"
WITHOUT = "cycle without tracks of the region"


class RegionIntake:
    """The cycles of one region that wait for their cycle here."""

    def __init__(self, connection: Connection, source: int) -> None:
        """Args: source: number of its track source."""
        self.connection, self._source = connection, source
        self._began_s = time.time()
        self.newest_s, self.first_s = -math.inf, math.inf
        self.late = self.used = self.without = 0
        self._waiting: list[RegionCycle] = []
        self._intake: list[Intake] = []

    @property
    def name(self) -> str:
        """Name of its track source."""
        return self.connection.address.name

    def take(self, until_s: float) -> None:
        """Take what has come, until a cycle ends at this instant or later. What follows stays with the region: memory is bounded."""
        while self.newest_s < until_s and (cycle := self.connection.next()) is not None:
            self._waiting.append(cycle)
            self.newest_s = max(self.newest_s, cycle.time_s)
            self.first_s = min(self.first_s, cycle.time_s)

    def cut(self, after_s: float, until_s: float) -> TrackReports:
        """The tracks of the cycles that end in a span. Older ones are late: counted and left out."""
        due = [cycle for cycle in self._waiting if cycle.time_s <= until_s]
        self._waiting = [cycle for cycle in self._waiting if cycle.time_s > until_s]
        used = [cycle for cycle in due if cycle.time_s > after_s]
        self.late, self.used = self.late + len(due) - len(used), self.used + len(used)
        self.without += not used
        self._intake = [_intake(self.name, [c for c in due if c.run == run], after_s) for run in _runs(due)]
        return TrackReports.join([cycle.reports(self._source) for cycle in used])

    def intake(self) -> list[Intake]:
        """What the newest `cut` used, by run of the region."""
        return self._intake

    def faults(self) -> list[Fault]:
        """What was late, missing or away."""
        counted = (LATE, self.late), (MISSING, self.connection.incoming.missing), (WITHOUT, self.without)
        return [Fault(kind, count, f"region {self.name}", self.connection.error or "") for kind, count in counted if count]

    def counters(self) -> dict[str, Any]:
        """Its state for operators, as of a feed."""
        link = self.connection
        return {
            "name": f"region {self.name}",
            "connected": link.connected,
            "connections": link.connections,
            "error": link.error,
            "bytes": link.size,
            "received": link.incoming.position.seq,
            "records": self.used,
            "refused": link.refused,
            "late": self.late,
            "dropped": link.incoming.missing,
            "heard_s": link.heard_s or None,
            "silent_s": round(time.time() - max(link.heard_s, self._began_s), 1),
            "newest_s": self.newest_s if math.isfinite(self.newest_s) else None,
            "faults": {fault.kind: fault.count for fault in self.faults()},
        }


def _runs(cycles: list[RegionCycle]) -> list[str]:
    """The runs of these cycles, in order."""
    return list(dict.fromkeys(cycle.run for cycle in cycles))


def _intake(name: str, cycles: list[RegionCycle], after_s: float) -> Intake:
    late = sum(cycle.time_s <= after_s for cycle in cycles)
    return Intake(name, cycles[0].run, cycles[0].seq - cycles[0].merged, cycles[-1].seq, late)
