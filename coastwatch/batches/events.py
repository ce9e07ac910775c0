"""Events: from when until when a vessel had a flag or an alarm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches.struct import Batch, column
from coastwatch.kernels.arrays import Array, Floats, Ints


@dataclass(frozen=True, eq=False)
class EventSpans(Batch):
    """Events by what tells them apart, with their ends. Sorted by vessel, kind and subject, each of them once."""

    vessel_id: Ints = column(np.int64, "E")  # 0: of a sensor
    kind: Ints = column(np.int64, "E")  # of EVENT_KINDS
    subject: Ints = column(np.int64, "E")  # of an alarm: number of the zone or sensor, or id of the other vessel; 0: none
    start_s: Floats = column(np.float64, "E")  # time of the first cycle with the flag or alarm
    end_s: Floats = column(np.float64, "E")  # of the last one; NaN: it lasts


@dataclass(frozen=True, eq=False)
class BegunEvents(Batch):
    """Events that begin in a cycle, with what is known of their vessels then."""

    vessel_id: Ints = column(np.int64, "E")
    kind: Ints = column(np.int64, "E")
    subject: Ints = column(np.int64, "E")
    start_s: Floats = column(np.float64, "E")
    position_deg: Floats = column(np.float64, "E", 2)
    speed_kn: Floats = column(np.float64, "E")  # NaN: not known
    mmsi: Ints = column(np.int64, "E")  # -1: none
    evidence: Array = column(object, "E")  # texts


@dataclass(frozen=True, eq=False)
class EventChanges:
    """What a cycle changes in the events."""

    begun: BegunEvents
    ended: EventSpans  # whose flag or alarm held until the cycle before
    returned: EventSpans  # that go on, with the end that they had

    @classmethod
    def empty(cls) -> EventChanges:
        """Nothing changes."""
        return cls(BegunEvents.empty(), EventSpans.empty(), EventSpans.empty())

    def __len__(self) -> int:
        return len(self.begun) + len(self.ended) + len(self.returned)
