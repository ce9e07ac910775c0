"""Rows of events. They are written only when a flag is set or cleared, or an alarm begins or ends.

A gap within an event is a row of `event_gap`: from it a run that goes on from an older checkpoint restores when the event had ended.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from sqlalchemy import Connection, delete, func, select, update

from coastwatch.batches import BegunEvents, EventChanges, EventSpans, Floats, Ints
from coastwatch.batches.kinds import EVENT_KINDS, IS_ALARM
from coastwatch.store.rows import Categorical, Column, NullableId, clear_columns, insert, update_rows
from coastwatch.store.schema.tables import EVENT, EVENT_GAP

NAMES = [EVENT_KINDS.get(number, "") for number in range(max(EVENT_KINDS) + 1)]


@dataclass(frozen=True)
class Timeline:
    """Cycle c ends at start_s + period_s * (c + 1)."""

    start_s: float
    period_s: float

    def cycle_at(self, time_s: Floats) -> Ints:
        """The cycle that ends at each instant. Args: (E,), each the end of a cycle. Returns: (E,)."""
        return np.rint((time_s - self.start_s) / self.period_s).astype(np.int64) - 1


def write_events(connection: Connection, run_id: int, number: int, changes: EventChanges, timeline: Timeline) -> int:
    """Write what a cycle changed. Args: number: of the cycle; timeline: of the run. Returns: rows inserted."""
    of_run, ended, returned = {"run_id": run_id}, changes.ended, changes.returned
    if len(ended):
        ends: dict[str, Column] = {"to_cycle": timeline.cycle_at(ended.end_s), "end_s": ended.end_s}
        update_rows(connection, EVENT, _key(ended, timeline), of_run, ends)
    rows = 0
    if len(returned):
        clear_columns(connection, EVENT, _key(returned, timeline), of_run, ("to_cycle", "end_s"))
        key, last = _key(returned, timeline).values(), timeline.cycle_at(returned.end_s)
        rows += insert(connection, EVENT_GAP, [run_id, *key, number, last, returned.end_s])
    if len(changes.begun):
        begun = changes.begun
        of_event: list[Column] = [run_id, *_key(begun, timeline).values(), None, begun.start_s, None]
        of_event += [
            *begun.position_deg.T,
            begun.speed_kn,
            NullableId(begun.mmsi),
            begun.evidence.tolist(),
            IS_ALARM[begun.kind],
        ]
        rows += insert(connection, EVENT, of_event)
    return rows


def _key(events: EventSpans | BegunEvents, timeline: Timeline) -> Mapping[str, Column]:
    """The columns of the primary key behind that of the run."""
    kind, from_cycle = Categorical(events.kind, NAMES), timeline.cycle_at(events.start_s)
    return {"vessel_id": events.vessel_id, "kind": kind, "subject": events.subject, "from_cycle": from_cycle}


def truncate_events(connection: Connection, run_id: int, number: int) -> None:
    """The events as they were after the cycle before this one. The rows of `event_gap` since this cycle are needed, and left."""
    e, g = EVENT.c, EVENT_GAP.c
    connection.execute(delete(EVENT).where(e.run_id == run_id, e.from_cycle >= number))
    later = update(EVENT).where(e.run_id == run_id, e.to_cycle >= number - 1)
    connection.execute(later.values(to_cycle=None, end_s=None))
    of_event = [g.vessel_id, g.kind, g.subject, g.from_cycle]
    first = select(*of_event, func.min(g.last_cycle), func.min(g.last_s))
    first = first.where(g.run_id == run_id, g.cycle >= number).group_by(*of_event)
    gaps = [row for row in connection.execute(first) if row[4] < number - 1]
    if gaps:
        vessel, kind, subject, from_cycle, last_cycle, last_s = map(list, zip(*gaps, strict=True))
        keys: dict[str, Column] = {"vessel_id": vessel, "kind": kind, "subject": subject, "from_cycle": from_cycle}
        update_rows(connection, EVENT, keys, {"run_id": run_id}, {"to_cycle": last_cycle, "end_s": last_s})
